"""Health of the sensors: both sonars, IMU, depth, CTD and GPS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bluerov_slam.pipeline.health_model import ChipState, FaultLevel, Finding, wrong
from bluerov_slam.records import Channel, FixType, Sender

if TYPE_CHECKING:
    from collections.abc import Callable

    from bluerov_slam.pipeline.health_memory import HealthMemory
    from bluerov_slam.pipeline.health_model import HealthFacts
    from bluerov_slam.records import GpsFix, Ping, SensorSample

    Check = Callable[[float, HealthMemory, HealthFacts], Finding]

STALE_AFTER_S = 3.0
UNDER_WATER_M = 0.5
INCOMPLETE_SHARE_SHOWN = 0.02
# One ping with a gap is what joining a running sonar in the middle of a ping leaves.
INCOMPLETE_PINGS_EXCUSED = 1
# Sensors and sonars need a moment after power-up: what does not talk then is not yet missing.
STARTING_MS = 5000
SONAR_ERRORS_SHOWN = 3

_PINS = {Channel.A: "RX 16, TX 17", Channel.B: "RX 25, TX 26"}


def check_sonar(channel: Channel, now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """One side-scan sonar."""
    ping = memory.pings.get(channel)
    age_s = None if ping is None else max(0.0, now_s - ping.arrived_s)
    if age_s is None or age_s > STALE_AFTER_S:
        return _silent_sonar(channel, now_s, memory, age_s)
    assert ping is not None
    errors = memory.sonar_errors[channel].increase
    if errors >= SONAR_ERRORS_SHOWN:
        return wrong(
            f"sonar_{channel.value.lower()}_errors",
            f"{errors} damaged frames in 10 s",
            f"Frames of sonar {channel.value} reach the ESP32 damaged.",
            f"Check its ground wire and the pins {_PINS[channel]}; keep the wires short; both sides at 921600 baud.",
            level=FaultLevel.WARNING,
            age_s=age_s,
        )
    pings, incomplete = memory.ping_rate[channel].increase, memory.pings_incomplete[channel].increase
    if incomplete > max(INCOMPLETE_PINGS_EXCUSED, INCOMPLETE_SHARE_SHOWN * pings):
        return wrong(
            f"sonar_{channel.value.lower()}_gaps",
            f"{incomplete} of {max(pings, incomplete)} pings have gaps",
            f"Parts of the pings of sonar {channel.value} are lost on the way.",
            "See the link's CRC errors; use fewer samples or a longer period.",
            level=FaultLevel.WARNING,
            age_s=age_s,
        )
    return Finding(ChipState.OK, _sonar_text(ping, memory.ping_rate[channel].rate_hz), age_s=age_s)


def _sonar_text(ping: Ping, rate_hz: float) -> str:
    range_m = (ping.first_sample + len(ping.samples)) * ping.resolution_m
    return f"{rate_hz:.1f} pings/s, {range_m:.3g} m"


def _silent_sonar(channel: Channel, now_s: float, memory: HealthMemory, age_s: float | None) -> Finding:
    if not _link_alive(now_s, memory):
        return Finding(ChipState.UNKNOWN, "No link", age_s=age_s)
    if memory.sensors is None:
        return Finding(ChipState.UNKNOWN, "No data yet", age_s=age_s)
    name = f"sonar_{channel.value.lower()}"
    packets_s = memory.sonar_packets_s.get(channel)
    if packets_s is None or now_s - packets_s > STALE_AFTER_S:
        return wrong(
            f"{name}_silent",
            "Not detected",
            f"Nothing comes from sonar {channel.value}: 12 V missing, baud rate not 921600 on both sides, "
            "or wrong pins.",
            f"Check its 12 V, the pins {_PINS[channel]} and that RX and TX are crossed.",
            age_s=age_s,
        )
    if memory.layout_is_unknown:
        return wrong(
            f"{name}_layout",
            "Unknown data layout",
            "The firmware packs the sonar's data in a way that this version does not know.",
            "Flash the firmware of this release; compare the versions on the Health tab.",
            age_s=age_s,
        )
    return wrong(
        f"{name}_no_pings",
        "Talks, but sends no pings",
        f"Sonar {channel.value} is connected and its echogram output is off, or every ping is left out.",
        "Open the viewer's sonar settings, set a period above 0 and apply; save to flash to keep it.",
        level=FaultLevel.WARNING,
        age_s=age_s,
    )


def patient(check: Check) -> Check:
    """The check, silent about faults while the board is starting."""

    def check_patiently(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
        finding, sample = check(now_s, memory, facts), memory.sensors
        starting = sample is not None and sample.device_ms < STARTING_MS and _fresh(now_s, sample.arrived_s)
        if finding.fault is None or not starting:
            return finding
        return Finding(ChipState.UNKNOWN, "Starting", age_s=finding.age_s)

    return check_patiently


def check_imu(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """HWT905."""
    sample = memory.sensors
    if sample is None or not _fresh(now_s, sample.arrived_s):
        return _no_sensors(now_s, sample)
    age_s = now_s - sample.arrived_s
    if not sample.imu_alive:
        return wrong(
            "imu_silent",
            "Silent",
            "The IMU does not talk: no power, wrong pins (RX 13, TX 15), another baud rate than 9600, or more than "
            "three software serial ports in use.",
            "Check its 5 V and wires; restart the ESP32.",
        )
    if sample.roll_rad is None:
        return wrong(
            "imu_zero",
            "All values are zero",
            "The IMU's packets hold only zeros: a conflict of the software serial ports, or it has just lost power.",
            "Switch the vehicle's power off and on; if it stays, check the IMU's supply.",
            age_s=age_s,
        )
    burst = memory.imu_burst
    if burst is None or not _fresh(now_s, burst.arrived_s):
        return Finding(ChipState.OK, f"Angles only, {memory.imu_packets.rate_hz:.0f} packets/s", age_s=age_s)
    rate_hz = 1 / burst.interval_s if burst.interval_s > 0 else 0.0
    return Finding(ChipState.OK, f"Nine axes, {rate_hz:.0f} Hz", age_s=now_s - burst.arrived_s)


def check_depth(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """MS5837."""
    sample, ctd = memory.sensors, memory.ctd
    if sample is None or not _fresh(now_s, sample.arrived_s):
        return _no_sensors(now_s, sample)
    age_s = now_s - sample.arrived_s
    if not sample.depth_ok:
        return wrong(
            "depth_missing",
            "Depth sensor missing",
            "The MS5837 does not answer at I2C address 0x76: pull-ups missing, wires longer than 10 cm, "
            "or a loose plug.",
            "Check SDA 21, SCL 22, 4.7 kOhm to 3.3 V and the plug.",
        )
    if sample.pressure_pa is None:
        return _unbelievable_pressure(sample, age_s)
    depth = "" if ctd is None or ctd.depth_m is None else f"{ctd.depth_m:.2f} m"
    return Finding(ChipState.OK, depth or f"{sample.pressure_pa / 100:.0f} mbar", age_s=age_s)


def _unbelievable_pressure(sample: SensorSample, age_s: float) -> Finding:
    if sample.sender is Sender.LEGACY:
        return wrong(
            "depth_wrapped",
            "Not believable (old firmware)",
            "The old firmware's pressure ends at 55 m and then starts at 0 again; it jumped, so it is not shown.",
            "Flash the firmware of this release; until then unplug and plug in the ESP32 after surfacing.",
            age_s=age_s,
        )
    return wrong(
        "depth_range",
        "Outside its range",
        "The depth sensor answers with a pressure outside its range.",
        "Restart the ESP32; if it stays, replace the sensor.",
        age_s=age_s,
    )


def check_ctd(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """TSYS01 and EZO EC, and what is computed from them."""
    sample, ctd = memory.sensors, memory.ctd
    if sample is None or ctd is None or not _fresh(now_s, sample.arrived_s):
        return _no_sensors(now_s, sample)
    age_s = now_s - sample.arrived_s
    if not sample.temperature_ok:
        return wrong(
            "temperature_missing",
            "Temperature sensor missing",
            "The TSYS01 does not answer at I2C address 0x77: pull-ups missing, wires longer than 10 cm, "
            "or a loose plug.",
            "Check SDA 21, SCL 22, 4.7 kOhm to 3.3 V and the plug.",
        )
    if not sample.ec_alive:
        return wrong(
            "conductivity_silent",
            "Conductivity silent",
            "The EZO EC does not talk: no power, wires swapped (RX 19, TX 18), or set to I2C mode (blue light).",
            "Check its wires; switch it to UART mode (green light), 9600 baud.",
        )
    if sample.conductivity_s_per_m is None:
        return _unbelievable_conductivity(sample, age_s)
    if ctd.salinity_psu is None:
        return Finding(ChipState.WARN, "No salinity for these values", age_s=age_s)
    speed = "" if ctd.sound_speed_mps is None else f", {ctd.sound_speed_mps:.0f} m/s"
    return Finding(ChipState.OK, f"{ctd.salinity_psu:.1f} PSU{speed}", age_s=age_s)


def _unbelievable_conductivity(sample: SensorSample, age_s: float) -> Finding:
    if sample.sender is Sender.LEGACY:
        return wrong(
            "conductivity_wrapped",
            "Not believable (old firmware)",
            "The old firmware's conductivity ends at 6553 uS/cm and then starts at 0 again; it contradicts the "
            "probe's own salinity, so it is not shown.",
            "Flash the firmware of this release.",
            level=FaultLevel.WARNING,
            age_s=age_s,
        )
    return wrong(
        "conductivity_unknown",
        "Conductivity unknown",
        "The EZO EC is connected and has not sent a value.",
        "Check that its probe is plugged in and calibrated.",
        level=FaultLevel.WARNING,
        age_s=age_s,
    )


def check_gps(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """u-blox. Without a fix nothing is wrong under water."""
    sample, fix = memory.sensors, memory.gps
    if sample is None or not _fresh(now_s, sample.arrived_s):
        return _no_sensors(now_s, sample)
    age_s = now_s - sample.arrived_s
    if not sample.gps_alive:
        return wrong(
            "gps_silent",
            "Silent",
            "The GPS receiver does not talk: no power, wrong pins (RX 27, TX 14), or another baud rate than 9600.",
            "Check its supply and wires; restart the ESP32.",
        )
    if _has_fix(now_s, sample, fix):
        kind = "2D fix" if fix is not None and fix.fix is FixType.FIX_2D else "Fix"
        return Finding(ChipState.OK, f"{kind}, {sample.gps_satellites} satellites", age_s=age_s)
    depth_m = None if memory.ctd is None else memory.ctd.depth_m
    if depth_m is not None and depth_m > UNDER_WATER_M:
        return Finding(ChipState.OFF, "No fix under water", age_s=age_s)
    return wrong(
        "gps_no_fix",
        f"No fix, {sample.gps_satellites} satellites",
        "The receiver talks and does not see enough satellites yet; a cold start takes 30 to 60 s.",
        "Keep the antenna above water with a free view of the sky.",
        level=FaultLevel.WARNING,
        age_s=age_s,
    )


def _has_fix(now_s: float, sample: SensorSample, fix: GpsFix | None) -> bool:
    if fix is not None and _fresh(now_s, fix.arrived_s):
        return fix.latitude_deg is not None
    return sample.gps_latitude_deg is not None


def _no_sensors(now_s: float, sample: SensorSample | None) -> Finding:
    if sample is None:
        return Finding(ChipState.UNKNOWN, "No data yet")
    return Finding(ChipState.UNKNOWN, "No data", age_s=now_s - sample.arrived_s)


def _link_alive(now_s: float, memory: HealthMemory) -> bool:
    return memory.frame_s is not None and _fresh(now_s, memory.frame_s)


def _fresh(now_s: float, at_s: float) -> bool:
    return now_s - at_s <= STALE_AFTER_S
