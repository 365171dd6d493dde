"""What crosses layers: frozen records in SI units, radians, world NED, body FRD.

A missing value is None (NaN inside arrays), never 0. Every record carries two instants on the host's monotonic
clock: `measured_s` (device clock mapped to the host's) and `arrived_s` (its last byte was read). Geodetic positions
stay in degrees, named so, because that is what they are exchanged in.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Channel(StrEnum):
    """One of the two side-scan sonars. A looks to starboard, B to port."""

    A = "A"
    B = "B"

    @property
    def index(self) -> int:  # type: ignore[override]  # str.index has no use on a channel
        """0 for A, 1 for B: the number the wire uses."""
        return 0 if self is Channel.A else 1


class Sender(IntEnum):
    """What the `pad[0]` byte of SENSORS says about who sent it."""

    LEGACY = 0
    FULL_RANGE = 1


class FixType(IntEnum):
    """GNSS fix as in the GPS frame."""

    NONE = 0
    FIX_2D = 2
    FIX_3D = 3


class AckResult(IntEnum):
    """Result byte of COMMAND_ACK."""

    OK = 0
    BAD_INNER_CHECKSUM = 1
    UNKNOWN = 2
    REJECTED = 3
    BUSY = 4


class EventLevel(StrEnum):
    """How much an event matters."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class SensorSample:
    """One SENSORS frame. Validity is in the values: what the wire marks unavailable is None here.

    `device_ms` is the ESP32's millis() as received (wraps after 49.7 days). The IMU fields hold the sensor's own
    angles and acceleration in the body frame as the firmware sends them; they are None while the IMU is silent.
    Conductivity and pressure are full range where the sender can (`sender`), else None when they cannot be trusted.
    `salinity_wire_psu`, `depth_wire_m` and `sound_speed_wire_mps` are what the firmware computed.
    """

    measured_s: float
    arrived_s: float
    device_ms: int
    sender: Sender
    roll_rad: float | None
    pitch_rad: float | None
    yaw_rad: float | None
    acceleration_frd_mps2: tuple[float, float, float] | None
    imu_packets: int
    imu_errors: int
    imu_alive: bool
    gps_latitude_deg: float | None
    gps_longitude_deg: float | None
    gps_altitude_m: float | None
    gps_satellites: int
    gps_alive: bool
    conductivity_s_per_m: float | None
    ec_salinity_psu: float | None
    ec_alive: bool
    pressure_pa: float | None
    depth_sensor_temperature_degc: float | None
    depth_ok: bool
    temperature_degc: float | None
    temperature_ok: bool
    sound_speed_wire_mps: float | None
    depth_wire_m: float | None
    salinity_wire_psu: float | None
    a_packets: int
    a_bytes: int
    b_packets: int
    b_bytes: int


@dataclass(frozen=True, slots=True)
class CtdSample:
    """Sea water from one SENSORS frame: practical salinity PSS-78 from conductivity, temperature and pressure.

    `sound_speed_mps` is the firmware's where it sent one, else computed here; None where no formula is valid.
    `depth_m` is below the surface pressure in use (`surface_pressure_pa`).
    """

    measured_s: float
    arrived_s: float
    temperature_degc: float | None
    conductivity_s_per_m: float | None
    pressure_pa: float | None
    depth_m: float | None
    salinity_psu: float | None
    sound_speed_mps: float | None
    surface_pressure_pa: float


@dataclass(frozen=True, slots=True)
class ImuBurst:
    """IMU_BURST: raw nine-axis samples, body FRD as mounted in the firmware.

    `acceleration_mps2`, `angular_rate_radps`: float64 (n, 3). `magnetic_field_raw`: int16 (n, 3), device units.
    Sample k was taken at `measured_s + k * interval_s`.
    """

    measured_s: float
    arrived_s: float
    interval_s: float
    acceleration_mps2: NDArray[np.float64]
    angular_rate_radps: NDArray[np.float64]
    magnetic_field_raw: NDArray[np.int16]


@dataclass(frozen=True, slots=True)
class GpsFix:
    """GPS frame: one per report of the receiver. Position is None without a fix."""

    measured_s: float
    arrived_s: float
    fix: FixType
    satellites: int
    hdop: float | None
    latitude_deg: float | None
    longitude_deg: float | None
    altitude_m: float | None
    speed_mps: float | None
    course_rad: float | None
    utc_unix_s: float | None


@dataclass(frozen=True, slots=True)
class DeviceStatus:
    """STATUS: the firmware's own account, counters since its boot."""

    measured_s: float
    arrived_s: float
    layout_version: int
    firmware_version: tuple[int, int, int]
    uptime_ms: int
    boot_count: int
    reset_reason: int
    link_load_percent: int
    tx_bytes: int
    a_pings_dropped: int
    b_pings_dropped: int
    a_frame_errors: int
    b_frame_errors: int
    a_overflow_bytes: int
    b_overflow_bytes: int
    i2c_errors: int
    imu_errors: int
    gps_errors: int
    ec_errors: int
    bad_commands: int
    echoed_host_us: int | None
    echo_device_us: int | None


@dataclass(frozen=True, slots=True)
class CommandAck:
    """COMMAND_ACK: the ESP32's answer to one downward frame."""

    arrived_s: float
    acked_type: int
    sequence: int
    result: AckResult


@dataclass(frozen=True, slots=True)
class SonarFrames:
    """Whole, validated, mod-256 BB55 frames of one sonar, in order, as forwarded (before ROUTE is rewritten).

    From raw pass-through they are the sonar's own bytes (mod-255 senders re-summed); from KOGGER_COMPRESSED they
    are rebuilt chart frames. `last_of_ping` is the firmware's flag, None where it does not say.
    """

    channel: Channel
    measured_s: float
    arrived_s: float
    frames: tuple[bytes, ...]
    last_of_ping: bool | None


@dataclass(frozen=True, slots=True)
class Ping:
    """One whole echogram of one sub-channel.

    `samples`: uint8 (n,), sample i lies at slant range `(first_sample + i) * resolution_m`. `gaps`: half-open sample
    ranges that never arrived (zero in `samples`). `decimation`: link samples per true sample run (1 = undecimated).
    `number` counts pings of this channel since start, lost ones not included. `sub_channel` is 0, or 0/1 for a
    dual-channel (chart v1) sonar.
    """

    channel: Channel
    sub_channel: int
    route: int
    number: int
    measured_s: float
    arrived_s: float
    resolution_m: float
    first_sample: int
    samples: NDArray[np.uint8]
    gaps: tuple[tuple[int, int], ...] = ()
    decimation: int = 1


@dataclass(frozen=True, slots=True)
class UnknownFrame:
    """A valid AA55 frame of a type this version does not decode."""

    arrived_s: float
    frame_type: int
    length: int


@dataclass(frozen=True, slots=True)
class LinkBytes:
    """Bytes as one read of the link returned them: what a recording must hold before anything else."""

    data: bytes
    arrived_s: float


@dataclass(frozen=True, slots=True)
class LinkBytesSent:
    """One whole AA55 frame sent down to the ESP32."""

    data: bytes
    sent_s: float


@dataclass(frozen=True, slots=True)
class AcousticBytes:
    """One datagram of an acoustic board's UDP port, for the recording; `source` is "address:port"."""

    data: bytes
    arrived_s: float
    source: str


@dataclass(frozen=True, slots=True)
class Event:
    """Something a user should be able to read later: a change of state, a fault, a clock step."""

    at_s: float
    level: EventLevel
    text: str


@dataclass(frozen=True, slots=True)
class VehicleAttitude:
    """ATTITUDE of the autopilot."""

    arrived_s: float
    boot_ms: int
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    angular_rate_frd_radps: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class VehicleServoOutput:
    """SERVO_OUTPUT_RAW: what the autopilot commands its thrusters, microseconds, channels 1 to 16."""

    arrived_s: float
    boot_us: int
    pwm_us: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class VehicleBattery:
    """BATTERY_STATUS."""

    arrived_s: float
    voltage_v: float | None
    current_a: float | None
    remaining_percent: int | None


@dataclass(frozen=True, slots=True)
class VehicleMotionDelta:
    """VISION_POSITION_DELTA as a DVL driver sends it: body-frame displacement over an interval.

    `confidence_percent` 0 means do not use.
    """

    arrived_s: float
    boot_us: int
    interval_s: float
    rotation_frd_rad: tuple[float, float, float]
    displacement_frd_m: tuple[float, float, float]
    confidence_percent: float


@dataclass(frozen=True, slots=True)
class VehicleDepth:
    """The vehicle's own water pressure sensor: SCALED_PRESSURE2, BARO instance 1 or a log's depth column.

    `pressure_pa` is absolute, `depth_m` lies below the surface as the vehicle zeroed it; a source has one or the other.
    """

    arrived_s: float
    boot_ms: int
    pressure_pa: float | None
    depth_m: float | None
    temperature_degc: float | None


@dataclass(frozen=True, slots=True)
class VehicleRange:
    """DISTANCE_SENSOR that looks down: height of the vehicle's echo sounder above the bottom.

    `quality_percent` is None where the sender says none.
    """

    arrived_s: float
    boot_ms: int
    distance_m: float
    quality_percent: int | None


@dataclass(frozen=True, slots=True)
class LinkCounters:
    """Counters of one byte-stream decoder since it was made."""

    bytes_received: int = 0
    frames_ok: int = 0
    frames_by_type: dict[int, int] = field(default_factory=dict)
    checksum_errors: int = 0
    length_errors: int = 0
    bytes_skipped: int = 0
    resyncs: int = 0


class NavMode(StrEnum):
    """What the navigator's position rests on at this moment."""

    STARTING = "starting"  # no attitude yet: nothing is estimated
    ATTITUDE = "attitude"  # attitude and depth are estimated, the horizontal position is not: no fix so far
    DEAD_RECKONING = "dead_reckoning"  # position carried on from velocities; its uncertainty grows
    AIDED = "aided"  # a position fix was accepted within the last few seconds


class SensorTrust(StrEnum):
    """How the navigator treats one sensor."""

    ABSENT = "absent"  # never heard
    WAITING = "waiting"  # heard, but not usable yet (no fix, not calibrated, under water)
    USED = "used"
    REJECTED = "rejected"  # its newest values disagree with everything else
    IGNORED = "ignored"  # faulty in itself: frozen, saturated, stale, time-travelling, not a number


@dataclass(frozen=True, slots=True)
class PositionFix:
    """A horizontal position from outside the link: an acoustic system, GPS_INPUT of the autopilot, an imported log.

    `covariance_ne_m2` is (north variance, north-east covariance, east variance); None where the source states none.
    """

    measured_s: float
    arrived_s: float
    source: str
    latitude_deg: float
    longitude_deg: float
    covariance_ne_m2: tuple[float, float, float] | None
    depth_m: float | None = None


@dataclass(frozen=True, slots=True)
class TimeDifferenceReading:
    """ACOUSTIC_TDOA: what the acoustic board itself measured on one pulse.

    `delays_s`: float64 (n-1,), arrival at the reference minus arrival at each other receiver, ascending; NaN where the
    board measured none. `signal_std_counts`: float64 (n,), all receivers. `frame_bits`: the 14 bits as received.
    """

    measured_s: float
    arrived_s: float
    reference: int
    delays_s: NDArray[np.float64]
    signal_std_counts: NDArray[np.float64]
    frame_bits: int | None


@dataclass(frozen=True, slots=True)
class AcousticRecord:
    """One record of all receivers, put together from ACOUSTIC_RECORD chunks or read from a file.

    `samples`: int16 (receivers, samples), `measured_s` belongs to sample 0. `missing_samples` of each receiver never
    arrived: they are zero in `samples` and lie in the half-open ranges of `holes`.
    """

    measured_s: float
    arrived_s: float
    record_id: int
    sample_rate_hz: float
    samples: NDArray[np.int16]
    bits: int
    trigger_index: int
    missing_samples: int = 0
    holes: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, slots=True)
class AcousticMessage:
    """ACOUSTIC_MESSAGE: what the transmitter said, decoded and error-corrected by the acoustic board."""

    measured_s: float
    arrived_s: float
    corrected_errors: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class AcousticFix:
    """What one pulse of the transmitter tells, good or not: every pulse gives one, `reason` says what is wrong with it.

    `receivers` are the used ones, the reference first; `delays_s`, `residuals_s` and `delay_covariance_s2` belong to
    the others in that order (seconds, reference minus receiver). `snr_db` and `signal_std_counts` are of all receivers.
    `alternatives` are delays one carrier period off that remain possible, with their probabilities. `azimuth_rad`
    (right positive) and `elevation_rad` (down positive) point from the array to the transmitter in body FRD, with the
    covariance of the two. `beacon_deg_m` is the transmitter's latitude, longitude and depth as `beacon_source` gave it.
    `position_deg` and `covariance_ned_m2` are the vehicle's.
    """

    measured_s: float
    arrived_s: float
    accepted: bool
    reason: str
    sound_speed_mps: float
    receivers: tuple[int, ...] = ()
    delays_s: tuple[float, ...] = ()
    delay_covariance_s2: tuple[tuple[float, ...], ...] = ()
    residuals_s: tuple[float, ...] = ()
    slip_probability: float | None = None
    alternatives: tuple[tuple[tuple[float, ...], float], ...] = ()
    azimuth_rad: float | None = None
    elevation_rad: float | None = None
    direction_covariance_rad2: tuple[tuple[float, float], tuple[float, float]] | None = None
    range_m: float | None = None
    range_std_m: float | None = None
    snr_db: tuple[float | None, ...] = ()
    signal_std_counts: tuple[float | None, ...] = ()
    excluded: tuple[tuple[int, str], ...] = ()
    frame_bits: int | None = None
    record_id: int | None = None
    beacon_deg_m: tuple[float, float, float | None] | None = None
    beacon_std_m: float | None = None
    beacon_source: str | None = None
    position_deg: tuple[float, float] | None = None
    covariance_ned_m2: tuple[tuple[float, ...], ...] | None = None


@dataclass(frozen=True, slots=True)
class NavSensor:
    """What the navigator makes of one sensor.

    `nis_ratio` is the mean of NIS / degrees of freedom over the last `nis_count` tested values (near 1 when the stated
    errors are right), None before the first. `reason` says in words why it is not used, with the cure, or what
    is odd about one that is; else empty.
    """

    name: str
    trust: SensorTrust
    reason: str
    accepted: int
    rejected: int
    last_used_s: float | None
    nis_ratio: float | None
    nis_count: int


@dataclass(frozen=True, slots=True)
class NavState:
    """One estimate of the navigator, valid at `measured_s`, in world NED about the origin and body FRD.

    `pose_covariance`: float64 (6, 6) of (north, east, down m; rotation about north, east, down rad), the rotation being
    the left error `R_true = Exp(rotation) R_estimated`. `velocity_covariance_m2ps2`: float64 (3, 3). Position, its
    covariance and the origin are None until something said where the vehicle is; the other values are None while they
    are unknown. `quaternion_ned_frd` is (w, x, y, z) with w >= 0. `reset_counter` goes up with every jump of the
    position or heading that no motion explains. `current_ne_mps` is the water's velocity over ground.
    """

    measured_s: float
    arrived_s: float
    mode: NavMode
    origin_deg: tuple[float, float] | None
    position_ned_m: tuple[float, float, float] | None
    velocity_ned_mps: tuple[float, float, float] | None
    quaternion_ned_frd: tuple[float, float, float, float] | None
    angular_rate_frd_radps: tuple[float, float, float] | None
    pose_covariance: NDArray[np.float64] | None
    velocity_covariance_m2ps2: NDArray[np.float64] | None
    depth_m: float | None
    depth_std_m: float | None
    altitude_m: float | None
    current_ne_mps: tuple[float, float] | None
    current_std_mps: tuple[float, float] | None
    last_fix_s: float | None
    distance_m: float
    reset_counter: int
    sensors: tuple[NavSensor, ...] = ()


VehicleRecord = VehicleAttitude | VehicleServoOutput | VehicleBattery | VehicleMotionDelta | VehicleDepth | VehicleRange
"""What the vehicle's own messages say, beside the link."""

Record = (
    SensorSample
    | CtdSample
    | ImuBurst
    | GpsFix
    | DeviceStatus
    | CommandAck
    | SonarFrames
    | Ping
    | UnknownFrame
    | LinkBytes
    | LinkBytesSent
    | AcousticBytes
    | Event
    | VehicleRecord
    | PositionFix
    | TimeDifferenceReading
    | AcousticRecord
    | AcousticMessage
    | AcousticFix
    | NavState
)
