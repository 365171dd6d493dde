"""Why a sensor is not used, in plain English: what is wrong, the likely cause, the cure.

A pilot reads these beside a map, wet and in a hurry: one or two sentences, no jargon, no blame.
"""

from __future__ import annotations

from enum import StrEnum


class Fault(StrEnum):
    """What makes a sensor's values useless in themselves."""

    NOT_A_NUMBER = "not_a_number"
    FROM_THE_FUTURE = "from_the_future"
    TOO_OLD = "too_old"
    REPEATED_TIME = "repeated_time"
    FROZEN = "frozen"
    SATURATED = "saturated"
    IMPOSSIBLE = "impossible"
    SILENT = "silent"
    IMU_UPSIDE_DOWN = "imu_upside_down"
    IMU_ON_ITS_SIDE = "imu_on_its_side"
    MAGNETIC_STRENGTH = "magnetic_strength"
    MAGNETIC_DIP = "magnetic_dip"
    NULL_ISLAND = "null_island"
    GPS_JUMP = "gps_jump"
    PRESSURE_RANGE = "pressure_range"
    PWM_RANGE = "pwm_range"
    DVL_CONFIDENCE = "dvl_confidence"
    ECHO_WEAK = "echo_weak"


class Wait(StrEnum):
    """Why a healthy sensor cannot be used yet."""

    GPS_NO_FIX = "gps_no_fix"
    GPS_UNDER_WATER = "gps_under_water"
    GPS_POOR = "gps_poor"
    GPS_SETTLING = "gps_settling"
    NO_ATTITUDE = "no_attitude"
    THRUSTERS_OFF = "thrusters_off"
    NO_ORIGIN = "no_origin"
    AMBIGUOUS_PULSE = "ambiguous_pulse"
    NO_BEACON = "no_beacon"
    NOT_FUSED = "not_fused"
    INSTEAD_OF_ANGLES = "instead_of_angles"


_GENERAL = {
    Fault.NOT_A_NUMBER: "It sends values that are not numbers. The sensor or its driver is faulty: restart it.",
    Fault.FROM_THE_FUTURE: "Its time stamps lie in the future. Its clock was set while it ran: restart the sender.",
    Fault.TOO_OLD: (
        "Its values arrive more than a second late. The link or the computer is overloaded: send less, or less often."
    ),
    Fault.REPEATED_TIME: "It sends the same time stamp again and again. The sender hangs: restart it.",
    Fault.FROZEN: (
        "It repeats exactly the same value, which no working sensor does. It hangs: switch its power off and on."
    ),
    Fault.SATURATED: "It is at the end of its range: a knock, or a faulty sensor.",
    Fault.IMPOSSIBLE: "Its values are physically impossible. Check its wiring and supply.",
    Fault.SILENT: "It has fallen silent. Check its cable and power.",
}

_SPECIAL = {
    ("imu", Fault.FROZEN): (
        "The IMU repeats exactly the same values, which no working one does. It hangs: switch the vehicle's power off "
        "and on. Until then the position is carried on without it."
    ),
    ("imu", Fault.SATURATED): (
        "The IMU is at the end of its range (16 g or 2000 deg/s): a knock, a fast spin by hand, or a faulty sensor. "
        "Its values count again as soon as they are inside the range."
    ),
    ("imu", Fault.IMPOSSIBLE): (
        "The IMU does not feel gravity, or feels far too much of it. Check its supply; if it stays, replace it."
    ),
    ("imu", Fault.SILENT): (
        "The IMU has fallen silent. Position and heading are carried on from the other sensors with growing "
        "uncertainty. Check its cable and its 5 V; restart the ESP32."
    ),
    ("imu", Fault.IMU_UPSIDE_DOWN): (
        "The IMU feels gravity upwards: it is mounted upside down, or the vehicle lies on its back. Turn the vehicle "
        "upright; if it is upright, turn the IMU or set its mounting to 180 deg roll in the settings."
    ),
    ("imu", Fault.IMU_ON_ITS_SIDE): (
        "The IMU feels gravity sideways: it is mounted on its side, or the vehicle lies on its side. Level the "
        "vehicle; if it is level, correct the IMU's mounting in the settings."
    ),
    ("compass", Fault.FROZEN): (
        "The magnetometer repeats the same value while the vehicle turns. It hangs or is saturated by a magnet or a "
        "motor right beside it: move it away, switch the IMU's power off and on."
    ),
    ("compass", Fault.SATURATED): (
        "The magnetometer is at the end of its range: a magnet or a motor is right beside it. Move it away."
    ),
    ("compass", Fault.IMPOSSIBLE): "The magnetometer reads no field at all. Switch the IMU's power off and on.",
    ("compass", Fault.MAGNETIC_STRENGTH): (
        "The magnetic field is much stronger or weaker than usual: iron, a cable or a running motor is near. The "
        "heading is carried on by the gyroscope. If it stays, calibrate the compass again."
    ),
    ("compass", Fault.MAGNETIC_DIP): (
        "The magnetic field points the wrong way up or down: iron, a cable or a running motor is near. The heading is "
        "carried on by the gyroscope. If it stays, calibrate the compass again."
    ),
    ("depth", Fault.FROZEN): (
        "The pressure does not change by a single digit, which no working sensor manages. Restart the ESP32; if it "
        "stays, check the plug of the depth sensor."
    ),
    ("depth", Fault.PRESSURE_RANGE): (
        "The pressure is outside what the sensor can measure. Restart the ESP32; if it stays, replace the sensor."
    ),
    ("depth", Fault.SILENT): (
        "No pressure comes from the depth sensor. Check SDA 21, SCL 22 and its plug. The depth is held with growing "
        "uncertainty."
    ),
    ("gps", Fault.NULL_ISLAND): (
        "The receiver says 0 N 0 E, which is what it sends when it knows nothing. Wait for a real fix; restart the "
        "receiver if it stays."
    ),
    ("gps", Fault.GPS_JUMP): (
        "The position jumped further than the vehicle can move. Not used until it either comes back or stays for "
        "20 seconds; then it is believed and the jump is counted."
    ),
    ("gps", Fault.FROZEN): (
        "The receiver repeats the same position although the vehicle moves. It has lost its satellites or hangs: "
        "lift the antenna out of the water, restart it if it stays."
    ),
    ("gps", Fault.SILENT): "Nothing comes from the GPS receiver. Check its supply and wires (RX 27, TX 14).",
    ("position", Fault.IMPOSSIBLE): (
        "The position system sends a place that does not exist, or an impossible uncertainty. Check its set-up."
    ),
    ("position", Fault.FROZEN): (
        "The position system repeats exactly the same place, which no working one does. It hangs, or has lost the "
        "vehicle's beacon: check the beacon, restart the system."
    ),
    ("position", Fault.SILENT): "No position fixes come any more. Check the position system and its beacon.",
    ("thrust", Fault.PWM_RANGE): (
        "The autopilot reports impossible thruster signals. Check that channels 1 to 6 or 8 drive the thrusters."
    ),
    ("thrust", Fault.SILENT): (
        "The autopilot does not report its thruster signals. Speed is only a guess now. Switch on SERVO_OUTPUT_RAW "
        "for the extension's MAVLink connection."
    ),
    ("acoustics", Fault.SILENT): (
        "No pulses of the transmitter come any more: out of range, hidden, or off. The position is carried on without."
    ),
    ("dvl", Fault.DVL_CONFIDENCE): (
        "The DVL has lost the bottom: too far, too near, or too steep. Its values count again once it sees the bottom."
    ),
    ("altitude", Fault.ECHO_WEAK): (
        "The echo sounder does not believe its own echo: too far from the bottom, too near, or fish and bubbles below."
    ),
    ("altitude", Fault.SILENT): (
        "The autopilot tells no height any more. Check the echo sounder and that DISTANCE_SENSOR reaches the extension."
    ),
    ("dvl", Fault.SILENT): "Nothing comes from the DVL any more. Check its cable and its driver.",
}

_WAITS = {
    Wait.GPS_NO_FIX: "The receiver has no fix yet. Keep the antenna above water with a free view of the sky.",
    Wait.GPS_UNDER_WATER: "Under water there is no GPS.",
    Wait.GPS_POOR: "The satellites stand badly: the fix is too uncertain to be used. Wait, or move into the open.",
    Wait.GPS_SETTLING: "Waiting for three fixes in a row that agree.",
    Wait.NO_ATTITUDE: "Waiting for the attitude.",
    Wait.THRUSTERS_OFF: "The thrusters have not run yet.",
    Wait.NO_ORIGIN: "Waiting for a first position.",
    Wait.NO_BEACON: "The transmitter's place or depth is not known. Enter it under Settings, acoustics.",
    Wait.AMBIGUOUS_PULSE: "Its delays may be one carrier period off, and the track is too uncertain to tell.",
    Wait.NOT_FUSED: "Shown, but not used for the position.",
    Wait.INSTEAD_OF_ANGLES: "Inside the IMU's own heading, which is used as it is.",
}

_REJECTED = {
    "imu": "Its angles contradict the other sensors. Check its mounting and calibrate its compass.",
    "compass": (
        "Its heading contradicts gyroscope and track. Something magnetic is near, or it needs a calibration. The "
        "heading is carried on by the gyroscope."
    ),
    "depth": "The depth jumps further than the vehicle can dive. Check the sensor; zero the depth at the surface.",
    "gps": "Its position contradicts the track by more than both uncertainties allow. It is believed once it stays.",
    "position": (
        "The fixes contradict the track by more than both uncertainties allow: echoes, or a wrong beacon position. "
        "They are believed once they stay."
    ),
    "acoustics": (
        "The direction of the transmitter contradicts the track: an echo, its place is wrong, or an array "
        "that is mounted otherwise than the settings say."
    ),
    "thrust": (
        "The speed from the thrusters contradicts everything else: the vehicle is held by something, a propeller is "
        "damaged, or the frame is set wrong."
    ),
    "dvl": "Its speed contradicts everything else: it sees something that moves, or it is mounted at another angle.",
}


def odd_thrust_text(off_percent: float) -> str:
    """A vehicle whose thrusters drive it much faster or slower than any usual one."""
    if off_percent < 0.0:
        return (
            f"The thrusters move the vehicle {-off_percent:.0f} % slower than they should: a propeller is lost or "
            "fouled, the vehicle drags something, or the frame is set wrong. Speed and current are trusted less."
        )
    return (
        f"The thrusters move the vehicle {off_percent:.0f} % faster than they should: the battery voltage or the frame "
        "is set wrong, or something tows it. Speed and current are trusted less."
    )


def fault_text(sensor: str, fault: Fault) -> str:
    """What is wrong with a sensor, the cause and the cure."""
    return _SPECIAL.get((sensor, fault)) or _GENERAL[fault]


def wait_text(wait: Wait) -> str:
    """What a sensor waits for."""
    return _WAITS[wait]


def rejected_text(sensor: str) -> str:
    """What it means that a sensor disagrees with all the others."""
    return _REJECTED.get(sensor, "Its values contradict the other sensors.")


UNCALIBRATED_COMPASS = (
    "The compass was never calibrated: the heading may be wrong by 10 deg or more, and says so in its uncertainty. "
    "Calibrate it on the Navigation page."
)
