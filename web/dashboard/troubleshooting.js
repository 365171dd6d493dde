// @ts-check
// The states people stumble over, each with its cure. The faults reported tell which of them holds now.

/** @typedef {{title: string, faults: string[], cure: string[]}} Trouble  faults: the ids it is about */

/** @type {Trouble[]} */
export const TROUBLES = [
  {
    title: 'The serial port is not found',
    faults: ['port_absent', 'port_busy', 'port_denied', 'port_failed', 'no_device_folder'],
    cure: [
      'Check the USB cable between ESP32 and Pi; a charge-only cable carries no data.',
      'Look for /dev/serial/by-id, /dev/ttyUSB0, /dev/ttyACM0 or /dev/ttyAMA0, and set serial.port if it is not found by itself.',
      'In a container: bind /dev:/dev. Outside of one: add your user to the group dialout and log in again.',
      'Port busy: stop what holds it (a serial monitor, BlueOS bridges, a second copy of this extension).',
    ],
  },
  {
    title: 'The port is open but no sensor data comes',
    faults: ['no_frames', 'link_silent'],
    cure: [
      'Both sides need the same baud rate: 115200 unless the firmware was set to 921600.',
      'Press the reset button of the ESP32. If bytes arrive but no frames, flash the firmware of this version.',
    ],
  },
  {
    title: 'CRC errors grow',
    faults: ['link_errors'],
    cure: [
      'Use a shorter, shielded USB cable and keep it away from thruster wires.',
      'A few errors after plugging in are normal: BlueOS probes each new port.',
    ],
  },
  {
    title: 'A sonar is not detected',
    faults: ['sonar_a_silent', 'sonar_b_silent', 'sonar_a_no_pings', 'sonar_b_no_pings'],
    cure: [
      'Check its 12 V supply and its ground.',
      'Its baud rate must be 921600 on both sides.',
      'It answers but sends no pings: set a period above 0 ms in the sonar settings of the viewer.',
      'Pins: A on RX 16 and TX 17, B on RX 25 and TX 26. A looks to starboard, B to port; swap them in the settings if needed.',
    ],
  },
  {
    title: 'Sonar pings are lost',
    faults: [
      'sonar_a_gaps',
      'sonar_b_gaps',
      'sonar_a_errors',
      'sonar_b_errors',
      'sonar_a_layout',
      'sonar_b_layout',
    ],
    cure: [
      'Link load near 100 %: take fewer samples or a longer period in the viewer, or set 921600 baud on both sides.',
      'Checksum errors of one sonar alone: check its signal wires and ground.',
    ],
  },
  {
    title: 'The IMU is silent, or all its values are zero',
    faults: ['imu_silent', 'imu_zero'],
    cure: [
      'Check its power and pins (RX 13, TX 15, 9600 baud).',
      'At most three software-serial ports work at once; unplug one to see whether they disturb each other.',
    ],
  },
  {
    title: 'The GPS answers but has no fix',
    faults: ['gps_no_fix'],
    cure: [
      'It works at the surface only, under a free sky. A cold start takes 30 to 60 s.',
      'Until then the page says "No fix"; latitude 0, longitude 0 is never taken for a position.',
    ],
  },
  {
    title: 'The GPS is silent',
    faults: ['gps_silent'],
    cure: ['Check its power and pins (RX 27, TX 14, 9600 baud), and the software-serial limit of three.'],
  },
  {
    title: 'The depth or temperature sensor is missing',
    faults: ['depth_missing', 'depth_range', 'temperature_missing'],
    cure: [
      'I2C needs pull-ups of 4.7 kOhm to 3.3 V and wires under 10 cm (SDA 21, SCL 22).',
      'Addresses: depth MS5837 at 0x76, temperature TSYS01 at 0x77.',
    ],
  },
  {
    title: 'Conductivity or salinity is missing',
    faults: ['conductivity_silent', 'conductivity_unknown'],
    cure: [
      'Check the EZO EC (RX 19, TX 18, swapped against intuition).',
      'In air it reads next to nothing: dip the probe. In fresh water no salinity formula holds, and "-" is right.',
    ],
  },
  {
    title: 'Old firmware',
    faults: ['old_firmware', 'unknown_layout', 'depth_wrapped', 'conductivity_wrapped'],
    cure: [
      'Its depth cannot be told from a wrapped one below some 55 m, and sea-water conductivity overflows: both are shown as "-" where in doubt.',
      'Flash the firmware of this version to have the full range, IMU bursts and status.',
    ],
  },
  {
    title: 'The ESP32 restarts by itself',
    faults: ['brownout', 'restarted'],
    cure: [
      'Its supply drops: use a shorter USB cable or a powered hub, and feed the sonars from 12 V, never from the ESP32.',
      'A restart after plugging in, flashing or the reset button is normal; what it had been told is sent to it anew.',
    ],
  },
  {
    title: 'Recording stopped, or does not start',
    faults: ['disk_full', 'disk_nearly_full', 'recorder_failed', 'recorder_drops'],
    cure: [
      'Disk full: export and delete old recordings.',
      'Folder read-only: bind a folder of the vehicle (see recording.folder) and check its owner.',
    ],
  },
  {
    title: 'Nobody answers on MAVLink',
    faults: ['mavlink_error', 'mavlink_silent'],
    cure: ['Add the UDP server endpoint in BlueOS as Settings, MAVLink shows, then wait a few seconds.'],
  },
  {
    title: 'The acoustic array hears nothing, or its pulses are refused',
    faults: [
      'acoustics_silent',
      'acoustics_refused',
      'acoustics_receiver',
      'acoustics_direction_only',
      'acoustics_two',
      'acoustics_settings',
    ],
    cure: [
      'Nothing heard: the transmitter must be on, in the water and within some 200 m; the board sends by the serial link or to acoustics.udp_port.',
      'One receiver marked on the Acoustics card: check its cable and plug; the others go on as long as three remain.',
      'Refused because receivers seem exchanged: compare their plugs with acoustics.places_m. Two transmitters: switch one off.',
      'Direction only: enter acoustics.beacon and acoustics.beacon_depth_m, and zero the depth sensor at the surface.',
    ],
  },
  {
    title: 'This page cannot reach the extension',
    faults: ['page', 'stream'],
    cure: [
      'Is the extension running (BlueOS, Extensions, Installed) and the tether connected?',
      'BlueOS 1.4.3 passes no WebSocket: the page then uses ports 8099 and 8766 directly, so these must be mapped.',
      'With bridge networking use fixed host ports, or host networking.',
    ],
  },
];

/**
 * Whether one of the faults of now is what this trouble is about.
 * @param {Trouble} trouble
 * @param {Array<{id?: string}>} faults
 */
export function isRelated(trouble, faults) {
  return faults.some((fault) => fault.id !== undefined && trouble.faults.includes(fault.id));
}
