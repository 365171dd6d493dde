"""Health of what carries the data: the serial link, the firmware, the recorder, MAVLink, the clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bluerov_slam.pipeline.health_model import (
    ChipState,
    Fault,
    FaultLevel,
    Finding,
    PortState,
    RecorderState,
    wrong,
)
from bluerov_slam.records import Channel, Sender

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bluerov_slam.pipeline.health_memory import HealthMemory
    from bluerov_slam.pipeline.health_model import HealthFacts, LinkFacts

SILENT_AFTER_S = 3.0
CHECKSUM_ERRORS_SHOWN = 3
NEARLY_FULL_S = 1800.0
NEARLY_FULL_BYTES = 1_000_000_000
# Room beyond this is told in days, as the Recordings page does.
LONG_ROOM_H = 48.0
BROWNOUT = 9

# esp_reset_reason() of ESP-IDF.
_RESET_REASONS = {
    0: "unknown",
    1: "power on",
    2: "reset pin",
    3: "software",
    4: "crash",
    5: "interrupt watchdog",
    6: "task watchdog",
    7: "watchdog",
    8: "deep sleep",
    BROWNOUT: "brown-out",
    10: "SDIO",
}

_FLASH_CURE = (
    "Flash the firmware of this release: connect the ESP32 to a computer and run "
    "'pio run -t upload' in the folder firmware/; compare the versions on the Health tab."
)


def check_link(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """The serial link, or the replay that stands in for it."""
    link = facts.link
    if link.state is PortState.FINISHED:
        return Finding(ChipState.OFF, "Replay finished", age_s=_age(now_s, memory.frame_s))
    if link.state is not PortState.CONNECTED:
        return _port_fault(link)
    age_s = _age(now_s, memory.frame_s)
    since_s = memory.connected_s if memory.connected_s is not None else now_s
    silent = now_s - max(since_s, memory.frame_s or since_s) > SILENT_AFTER_S
    if silent:
        return _silent_fault(now_s, since_s, memory, link, age_s)
    if memory.frame_s is None:
        return Finding(ChipState.UNKNOWN, "Waiting for the first frame")
    restarted_s = memory.restarted_ago_s(now_s)
    if restarted_s is not None:
        return _restart_fault(restarted_s, memory, age_s)
    errors = memory.checksum_errors.increase
    if errors >= CHECKSUM_ERRORS_SHOWN:
        return wrong(
            "link_errors",
            f"{errors} damaged frames in 10 s",
            "Frames arrive damaged: CRC errors on the USB serial link.",
            "Use a short, shielded USB cable, keep it away from motor wires, try another USB port; "
            "check that serial.baud is the firmware's.",
            level=FaultLevel.WARNING,
            age_s=age_s,
        )
    rate = f"{memory.frames.rate_hz:.0f} frames/s"
    return Finding(ChipState.OK, f"Replay, {rate}" if link.kind == "replay" else rate, age_s=age_s)


def _port_fault(link: LinkFacts) -> Finding:
    port = link.port or link.waiting_for or "the ESP32's port"
    if link.state is PortState.BUSY:
        return wrong(
            "port_busy",
            "Port is in use",
            f"Another program holds {port}: a second copy of this extension, the former system or a serial monitor.",
            "Stop the other program (in BlueOS: Extensions, disable the other one); this extension then connects "
            "by itself.",
        )
    if link.state is PortState.DENIED:
        return wrong(
            "port_denied",
            "No permission for the port",
            f"The system does not let this program open {port}.",
            "Run 'sudo usermod -aG dialout $USER' and log in again; in BlueOS install the extension with its own "
            "permissions unchanged.",
        )
    if link.state is PortState.FAILED:
        return wrong(
            "port_failed",
            "Port cannot be opened",
            f"Opening {port} failed: {link.detail or 'no reason given'}.",
            "Unplug the ESP32 and plug it in again; if that does not help, choose another port under Settings, serial.",
        )
    if not link.device_folder_seen:
        return wrong(
            "no_device_folder",
            "Container sees no devices",
            "The container was started without /dev, so no serial port can be found in it.",
            'Start it with the folder bound: "Binds": ["/dev:/dev"] in the extension\'s permissions.',
        )
    return wrong(
        "port_absent",
        "ESP32 not found",
        f"{link.waiting_for or 'No serial port'} is not there (ports looked for: /dev/serial/by-id, /dev/ttyUSB*, "
        "/dev/ttyACM*, /dev/ttyAMA0).",
        "Plug the ESP32's USB cable into the Pi and check its power light; or choose the port under Settings, serial.",
    )


def _silent_fault(now_s: float, since_s: float, memory: HealthMemory, link: LinkFacts, age_s: float | None) -> Finding:
    bytes_come = memory.bytes_s is not None and now_s - max(memory.bytes_s, since_s) <= SILENT_AFTER_S
    if bytes_come:
        return wrong(
            "no_frames",
            "Bytes, but no valid frames",
            f"{link.port or 'The port'} sends bytes that are no AA55 frames at {link.baud} baud.",
            "Set serial.baud to the firmware's (115200 unless changed); check that this port is the ESP32 and not "
            "the autopilot or a GPS.",
            age_s=age_s,
        )
    seconds = now_s - max(since_s, memory.frame_s or since_s)
    return wrong(
        "link_silent",
        f"No data for {seconds:.0f} s",
        f"{link.port or 'The port'} is open and nothing arrives: no firmware, a board held in reset, or "
        "another device.",
        "Press the ESP32's EN button; check its 5 V supply and that the right port is chosen; flash the firmware if "
        "the board is new.",
        age_s=age_s,
    )


def _restart_fault(restarted_s: float, memory: HealthMemory, age_s: float | None) -> Finding:
    status = memory.status
    if status is not None and status.reset_reason == BROWNOUT:
        return wrong(
            "brownout",
            f"ESP32 lost power {restarted_s:.0f} s ago",
            "The ESP32 restarted because its supply voltage broke down (brown-out).",
            "Feed it from a supply of at least 1 A with a short cable; do not power sonars or servos from its pins.",
            age_s=age_s,
        )
    reason = "" if status is None else f" (reason: {_RESET_REASONS.get(status.reset_reason, 'unknown')})"
    return wrong(
        "restarted",
        f"ESP32 restarted {restarted_s:.0f} s ago",
        f"The ESP32 started again{reason}.",
        "Nothing to do if you pressed its button or flashed it; if it happens by itself check cable and supply.",
        level=FaultLevel.WARNING,
        age_s=age_s,
    )


def check_recorder(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """The recorder and its disk."""
    recorder = facts.recorder
    if recorder.state is RecorderState.OFF:
        return Finding(ChipState.OFF, "Off")
    if recorder.state is RecorderState.DISK_FULL:
        return wrong(
            "disk_full",
            "Disk full, not recording",
            "Too little space is left for recordings; the rest is kept for the vehicle itself.",
            "Download recordings and delete them on the Recordings tab; recording then goes on by itself.",
        )
    if recorder.state is RecorderState.FAILED:
        return wrong(
            "recorder_failed",
            "Not recording",
            f"The recorder stopped: {recorder.error or 'no reason given'}.",
            "Check that the recordings folder exists and can be written (recording.folder), then start the recording "
            "again.",
        )
    if recorder.dropped:
        return wrong(
            "recorder_drops",
            f"{recorder.dropped} records lost",
            "The disk could not keep up, so the recording has holes.",
            "Use a faster card or an SSD, stop other programs that write; the lost part cannot be brought back.",
        )
    if _nearly_full(facts):
        left = (
            f"{(recorder.seconds_left or 0) / 60:.0f} min left" if recorder.seconds_left is not None else "little left"
        )
        return wrong(
            "disk_nearly_full",
            f"Disk nearly full, {left}",
            f"{(recorder.free_bytes or 0) / 1e9:.1f} GB are free for recordings.",
            "Download recordings and delete them on the Recordings tab before the dive.",
            level=FaultLevel.WARNING,
        )
    if recorder.state is RecorderState.WAITING:
        return Finding(ChipState.UNKNOWN, "Waits for the first frame")
    left = "" if recorder.seconds_left is None else f", {_room(recorder.seconds_left)} left"
    return Finding(ChipState.OK, f"Recording{left}", age_s=0.0)


def _room(seconds: float) -> str:
    hours = seconds / 3600
    return f"{hours:.0f} h" if hours < LONG_ROOM_H else f"{hours / 24:.0f} d"


def _nearly_full(facts: HealthFacts) -> bool:
    recorder = facts.recorder
    if recorder.seconds_left is not None and recorder.seconds_left < NEARLY_FULL_S:
        return True
    return recorder.free_bytes is not None and recorder.free_bytes < NEARLY_FULL_BYTES


def check_mavlink(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Finding:
    """The MAVLink bridge."""
    mavlink = facts.mavlink
    if not mavlink.enabled:
        return Finding(ChipState.OFF, "Off")
    age_s = _age(now_s, mavlink.last_heard_s)
    if mavlink.error:
        return wrong(
            "mavlink_error",
            "MAVLink cannot send",
            f"Sending to {mavlink.target} failed: {mavlink.error}.",
            "Check host and port under Settings, mavlink.",
            age_s=age_s,
        )
    if mavlink.peer_alive:
        return Finding(ChipState.OK, f"Heard from {mavlink.peer or mavlink.target}", age_s=age_s)
    started_s = mavlink.enabled_since_s
    if started_s is not None and now_s - started_s < 5.0:
        return Finding(ChipState.UNKNOWN, "Waiting for an answer")
    return wrong(
        "mavlink_silent",
        "Nobody answers",
        f"Messages go to {mavlink.target} and nothing comes back.",
        "In BlueOS open Vehicle, MAVLink Endpoints (pirate mode) and add a UDP Server endpoint on 0.0.0.0 with that "
        "port; or switch MAVLink off under Settings.",
        level=FaultLevel.WARNING,
        age_s=age_s,
    )


def system_faults(now_s: float, memory: HealthMemory, facts: HealthFacts) -> Iterator[Fault]:
    """What is wrong and belongs to no single chip."""
    counters = facts.counters
    if counters.sender is Sender.LEGACY:
        yield Fault(
            "old_firmware",
            FaultLevel.WARNING,
            "Old firmware",
            "It cannot carry conductivity above 6553 uS/cm nor pressure below 55 m, and wraps in silence: salinity and "
            "depth are shown only where they can be believed. There is no raw IMU, no GPS fix, no sonar settings.",
            _FLASH_CURE,
        )
    if memory.layout_is_unknown:
        version = "unknown" if memory.status is None else ".".join(map(str, memory.status.firmware_version))
        yield Fault(
            "unknown_layout",
            FaultLevel.ERROR,
            "Sonar data in an unknown layout",
            f"The firmware (version {version}) packs sonar data (type 0x04) in a way that this extension "
            f"({facts.extension_version or 'this version'}) does not know: {counters.unknown_layout_reason}.",
            _FLASH_CURE,
        )
    if facts.wall_trusted is False:
        yield Fault(
            "wall_clock",
            FaultLevel.WARNING,
            "Wall clock is wrong",
            "The Pi's clock disagrees with GPS time; recordings keep GPS time beside it, so nothing is lost.",
            "Let the Pi reach the internet or a time server once, or set the time in BlueOS.",
        )
    error = memory.command_error_text(now_s)
    if error is not None:
        yield Fault(
            "command_error",
            FaultLevel.WARNING,
            "A command was refused",
            f"{error}.",
            "BUSY: try again in a second. REJECTED or UNKNOWN: the value is outside the firmware's range or the "
            "firmware is older than this extension.",
        )
    yield from _sonar_link_faults(memory, facts)


def _sonar_link_faults(memory: HealthMemory, facts: HealthFacts) -> Iterator[Fault]:
    for channel in Channel:
        sonar = facts.counters.sonars.get(channel)
        if sonar is not None and sonar.checksum_in_use == "mod255":
            yield Fault(
                f"mod255_{channel.value.lower()}",
                FaultLevel.INFO,
                f"Sonar {channel.value} sums modulo 255",
                "Its frames carry the checksum of the old description, not the one KoggerApp accepts; they are "
                "accepted here and forwarded with the right one.",
                "Nothing to do; to refuse such frames set sonar.kogger_checksum to mod256.",
            )
        dropped = memory.pings_dropped[channel].increase
        if dropped:
            yield Fault(
                f"pings_dropped_{channel.value.lower()}",
                FaultLevel.WARNING,
                f"Sonar {channel.value}: {dropped} pings left out",
                "The link to the Pi is too slow for the sonar settings, so the firmware leaves out whole pings.",
                "Use fewer samples or a longer period, a higher decimation, or 921600 baud if the firmware allows.",
            )


def _age(now_s: float, at_s: float | None) -> float | None:
    return None if at_s is None else max(0.0, now_s - at_s)
