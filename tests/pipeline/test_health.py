import dataclasses
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from bluerov_slam.pipeline.health import (
    Chip,
    ChipState,
    FaultLevel,
    Health,
    HealthFacts,
    HealthMonitor,
    LinkFacts,
    MavlinkFacts,
    PortState,
    RecorderFacts,
    RecorderState,
)
from bluerov_slam.pipeline.health_memory import RecentIncrease
from bluerov_slam.pipeline.link_decoder import LinkDecoder
from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.records import Channel
from pipeline.esp32_stream import compressed_ping, golden, gps, imu, sensors, status

CHIPS = ["link", "sonar_a", "sonar_b", "imu", "depth", "ctd", "gps", "recorder", "mavlink"]
CHIPS += ["navigation", "acoustics"]
PING = bytes(1000)
RECORDING = RecorderFacts(RecorderState.RECORDING, "session.jsonl", 1000, 9000.0, 0, 0, 50_000_000_000, 90_000.0)
MAVLINK_OFF = MavlinkFacts(enabled=False)
CONNECTED = LinkFacts(PortState.CONNECTED, port="/dev/ttyUSB0")


class Bench:
    """A decoder and a monitor on virtual time: half a second of link a step."""

    def __init__(self) -> None:
        self.decoder = LinkDecoder()
        self.monitor = HealthMonitor()
        self.now_s = 100.0
        self.link, self.recorder, self.mavlink = CONNECTED, RECORDING, MAVLINK_OFF
        self.wall_trusted: bool | None = True
        self.health = self.assess()

    def assess(self) -> Health:
        facts = HealthFacts(
            self.link, self.recorder, self.mavlink, self.decoder.counters, self.wall_trusted, extension_version="0.1.0"
        )
        self.health = self.monitor.assess(self.now_s, facts)
        # True of every test: texts fit their chips, and nothing is wrong without a cause and a cure.
        assert all(0 < len(chip.text) <= 40 for chip in self.health.chips)
        assert all(all(dataclasses.astuple(fault)) for fault in self.health.faults)
        return self.health

    def feed(self, data: bytes) -> None:
        for record in self.decoder.feed(data, self.now_s):
            self.monitor.observe(record)

    def run(self, seconds: float, make: Callable[[int], bytes]) -> Health:
        for _ in range(int(seconds * 2)):
            self.now_s += 0.5
            self.feed(make(round(self.now_s * 2)))
            self.assess()
        return self.health

    def chip(self, chip_id: str) -> Chip:
        return next(chip for chip in self.health.chips if chip.id == chip_id)

    def fault(self, fault_id: str) -> Any:
        return next((fault for fault in self.health.faults if fault.id == fault_id), None)


def healthy(k: int, **changes: int) -> bytes:
    counters = {"device_ms": 500 * k, "imu_packets": 40 * k, "a_packets": 5 * k, "b_packets": 5 * k, **changes}
    pings = compressed_ping(PING, Channel.A, number=k, t_us=500_000 * k % 2**32)
    pings += compressed_ping(PING, Channel.B, number=k, t_us=500_000 * k % 2**32)
    return sensors(**counters) + imu(500_000 * k) + b"".join(pings)


def without_sonars(k: int, **changes: int) -> bytes:
    return sensors(**{"device_ms": 500 * k, "a_packets": 0, "b_packets": 0, **changes})


def test_a_healthy_system_is_all_ok() -> None:
    bench = Bench()
    health = bench.run(12, healthy)
    assert [chip.id for chip in health.chips] == CHIPS
    states = {chip.id: chip.state for chip in health.chips}
    assert states == {**dict.fromkeys(CHIPS, ChipState.OK), **dict.fromkeys(CHIPS[-3:], ChipState.OFF)}
    assert health.faults == ()
    assert bench.chip("sonar_a").text == "2.0 pings/s, 20 m"
    assert bench.chip("imu").text == "Nine axes, 20 Hz"
    assert bench.chip("ctd").text.startswith("34.0 PSU, 1508")
    assert bench.chip("depth").text == "0.50 m"
    assert bench.chip("gps").text == "Fix, 8 satellites"
    assert bench.chip("recorder").text == "Recording, 25 h left"
    assert all(chip.age_s == 0.0 for chip in health.chips if chip.state is ChipState.OK)


# Every state of the port: fault id, and a word its cure must hold.
@pytest.mark.parametrize(
    ("link", "fault_id", "cure"),
    [
        (LinkFacts(PortState.ABSENT), "port_absent", "USB cable"),
        (LinkFacts(PortState.ABSENT, waiting_for="/dev/ttyUSB7"), "port_absent", "Settings"),
        (LinkFacts(PortState.ABSENT, device_folder_seen=False), "no_device_folder", "/dev:/dev"),
        (LinkFacts(PortState.BUSY, port="/dev/ttyUSB0"), "port_busy", "Stop the other program"),
        (LinkFacts(PortState.DENIED, port="/dev/ttyUSB0"), "port_denied", "dialout"),
        (LinkFacts(PortState.FAILED, port="/dev/ttyUSB0", detail="I/O error"), "port_failed", "Unplug"),
    ],
)
def test_a_port_that_cannot_be_used(link: LinkFacts, fault_id: str, cure: str) -> None:
    bench = Bench()
    bench.link = link
    bench.assess()
    fault = bench.fault(fault_id)
    assert cure in fault.cure
    assert (link.waiting_for or link.detail or "") in fault.cause
    chip = bench.chip("link")
    assert (chip.state, chip.cause, chip.cure) == (ChipState.FAULT, fault.cause, fault.cure)
    assert fault.title == f"Link: {chip.text}", "a title alone says what it is about"


def test_an_open_port_without_data() -> None:
    bench = Bench()
    bench.run(2, lambda k: b"")
    assert bench.chip("link").state is ChipState.UNKNOWN
    bench.run(4, lambda k: b"")
    assert "EN button" in bench.fault("link_silent").cure


def test_bytes_without_frames_point_to_the_baud_rate() -> None:
    bench = Bench()
    bench.run(5, lambda k: b"\x00\xff garbage")
    assert "serial.baud" in bench.fault("no_frames").cure


def test_a_link_that_falls_silent() -> None:
    bench = Bench()
    bench.run(5, healthy)
    bench.run(5, lambda k: b"")
    assert bench.chip("link").text == "No data for 5 s"
    assert bench.chip("link").age_s == 5.0
    assert bench.chip("sonar_a").text == "No link"
    assert {bench.chip(name).state for name in ("imu", "depth", "ctd", "gps")} == {ChipState.UNKNOWN}


def test_a_replug_starts_a_new_wait() -> None:
    bench = Bench()
    bench.run(5, healthy)
    bench.link = LinkFacts(PortState.ABSENT)
    bench.run(10, lambda k: b"")
    bench.link = CONNECTED
    bench.run(2, lambda k: b"")
    assert bench.health.faults == ()


def test_damaged_frames() -> None:
    bench = Bench()
    bad = sensors()[:-1] + b"\x00"
    bench.run(6, lambda k: healthy(k) + bad)
    assert bench.chip("link").state is ChipState.WARN
    assert "cable" in bench.fault("link_errors").cure
    bench.run(15, healthy)
    assert bench.chip("link").state is ChipState.OK


@pytest.mark.parametrize(("reason", "fault_id", "level"), [(9, "brownout", "error"), (4, "restarted", "warning")])
def test_a_board_that_restarts_says_why(reason: int, fault_id: str, level: str) -> None:
    bench = Bench()
    bench.run(5, lambda k: healthy(k) + status(uptime_ms=500 * k, boot_count=7))
    bench.run(1, lambda k: healthy(k, device_ms=1000) + status(uptime_ms=1000, boot_count=8, reset_reason=reason))
    assert bench.fault(fault_id).level == level
    assert (fault_id == "restarted") == ("crash" in bench.fault(fault_id).cause)
    bench.run(70, lambda k: healthy(k, device_ms=1000 + 500 * k))
    assert bench.fault(fault_id) is None


def test_an_old_board_that_restarts_is_told_by_its_clock() -> None:
    bench = Bench()
    bench.run(5, without_sonars)
    bench.run(1, lambda k: without_sonars(k, device_ms=500 * k - 99_000))
    assert bench.fault("restarted") is not None


def test_a_sonar_that_is_not_there() -> None:
    bench = Bench()
    bench.run(6, without_sonars)
    assert "RX 16" in bench.fault("sonar_a_silent").cure
    assert "RX 25" in bench.fault("sonar_b_silent").cure
    assert all(word in bench.fault("sonar_a_silent").cause for word in ("12 V", "921600", "pins"))


def test_a_sonar_that_talks_without_pings() -> None:
    bench = Bench()
    bench.run(6, lambda k: without_sonars(k, a_packets=k))
    assert "period" in bench.fault("sonar_a_no_pings").cure
    assert bench.chip("sonar_a").state is ChipState.WARN


def test_sonar_data_of_an_unknown_layout() -> None:
    bench = Bench()
    unknown = encode_frame(MessageType.KOGGER_COMPRESSED, b"\7 not ours")
    bench.run(6, lambda k: without_sonars(k, a_packets=k) + unknown + status(uptime_ms=500 * k))
    fault = bench.fault("unknown_layout")
    assert "1.2.3" in fault.cause
    assert "0.1.0" in fault.cause
    assert "pio run" in fault.cure
    assert bench.chip("sonar_a").text == "Unknown data layout"


def test_a_damaged_frame_that_passes_its_check_is_no_unknown_layout() -> None:
    bench = Bench()
    unknown = encode_frame(MessageType.KOGGER_COMPRESSED, b"\7 not ours")
    bench.run(6, lambda k: healthy(k) + (unknown if k % 4 == 0 else b""))
    assert bench.decoder.counters.unknown_layouts == 3
    assert bench.fault("unknown_layout") is None


def test_what_a_starting_board_does_not_have_yet_is_no_fault() -> None:
    bench = Bench()

    def just_started(k: int) -> bytes:
        ms = 500 * (k - 200)  # the bench begins at 100 s
        return sensors(device_ms=ms, gps_alive=0, imu_alive=0, ec_alive=0, a_packets=0, b_packets=0)

    bench.run(4, just_started)
    assert {bench.chip(name).text for name in ("sonar_a", "imu", "ctd", "gps")} == {"Starting"}
    assert not [fault for fault in bench.health.faults if fault.level is FaultLevel.ERROR]
    bench.run(2, just_started)
    assert {bench.chip(name).state for name in ("sonar_a", "imu", "ctd", "gps")} == {ChipState.FAULT}


def test_joining_a_sonar_in_the_middle_of_a_ping_is_no_fault() -> None:
    bench = Bench()
    bench.run(1, healthy)
    bench.feed(compressed_ping(PING, Channel.A, number=203, t_us=101_100_000)[1])  # its tail
    bench.run(1, healthy)
    assert bench.decoder.counters.sonars[Channel.A].pings_incomplete == 1
    assert bench.chip("sonar_a").state is ChipState.OK


def test_pings_with_gaps() -> None:
    bench = Bench()

    def make(k: int) -> bytes:
        frames = compressed_ping(PING, Channel.A, number=k, t_us=500_000 * k % 2**32)
        return without_sonars(k) + b"".join(frames[1:] if k % 4 == 0 else frames)

    bench.run(10, make)
    assert bench.chip("sonar_a").text == "5 of 20 pings have gaps"


def test_pings_left_out_by_a_full_link() -> None:
    bench = Bench()
    bench.run(5, lambda k: healthy(k) + status(uptime_ms=500 * k, a_pings_dropped=0, b_pings_dropped=k))
    assert bench.fault("pings_dropped_a") is None
    assert "fewer samples" in bench.fault("pings_dropped_b").cure


def test_a_sonar_with_the_other_checksum() -> None:
    bench = Bench()
    bench.decoder = LinkDecoder(kogger_checksum="mod255")
    bench.run(3, healthy)
    assert bench.fault("mod255_a").level is FaultLevel.INFO


@pytest.mark.parametrize(
    ("changes", "chip_id", "fault_id", "word"),
    [
        ({"imu_alive": 0}, "imu", "imu_silent", "restart"),
        (
            dict.fromkeys(["roll_cdeg", "pitch_cdeg", "yaw_cdeg", "acceleration_x_mg", "acceleration_z_mg"], 0),
            "imu",
            "imu_zero",
            "power",
        ),
        ({"depth_ok": 0}, "depth", "depth_missing", "4.7 kOhm"),
        ({"full_pressure_pa": 0xFFFFFF}, "depth", "depth_range", "Restart"),
        ({"temperature_ok": 0}, "ctd", "temperature_missing", "4.7 kOhm"),
        ({"ec_alive": 0}, "ctd", "conductivity_silent", "UART mode"),
        ({"full_conductivity_dus": 0xFFFFFF}, "ctd", "conductivity_unknown", "probe"),
        ({"gps_alive": 0}, "gps", "gps_silent", "wires"),
        ({"latitude_e7": 0, "longitude_e7": 0, "full_pressure_pa": 101_325}, "gps", "gps_no_fix", "sky"),
    ],
)
def test_a_sensor_that_fails(changes: dict[str, int], chip_id: str, fault_id: str, word: str) -> None:
    bench = Bench()
    bench.run(3, lambda k: healthy(k, **changes))
    assert word in bench.fault(fault_id).cure
    assert bench.chip(chip_id).state in (ChipState.FAULT, ChipState.WARN)
    if fault_id.endswith(("_silent", "_missing")):
        # The frame that tells of the silence is not data of the sensor.
        assert bench.chip(chip_id).age_s is None
    others = [chip.id for chip in bench.health.chips if chip.state is not ChipState.OK]
    assert set(others) - {"mavlink", "navigation", "acoustics"} <= {chip_id, "ctd"}


def test_no_fix_under_water_is_nothing_wrong() -> None:
    bench = Bench()
    bench.run(3, lambda k: healthy(k, latitude_e7=0, longitude_e7=0, full_pressure_pa=300_000))
    assert (bench.chip("gps").state, bench.chip("gps").text) == (ChipState.OFF, "No fix under water")
    assert bench.health.faults == ()


def test_the_gps_frame_knows_the_fix_better() -> None:
    bench = Bench()
    bench.run(3, lambda k: healthy(k, full_pressure_pa=101_325) + gps("gps_no_fix", t_us=500_000 * k))
    assert bench.chip("gps").text == "No fix, 8 satellites"


def test_old_firmware_and_what_it_costs() -> None:
    bench = Bench()

    def make(k: int) -> bytes:
        return sensors("sensors_legacy", device_ms=500 * k, conductivity_dus=26464, pressure_dmbar=60_000 * (k % 2) + 1)

    bench.run(4, make)
    assert "55 m" in bench.fault("old_firmware").cause
    assert bench.fault("depth_wrapped") is not None
    assert bench.fault("conductivity_wrapped") is not None


def test_a_refused_command_is_shown_until_one_succeeds() -> None:
    bench = Bench()
    bench.run(1, lambda k: healthy(k) + golden("command_ack_rejected"))
    assert bench.fault("command_error").cause == "KOGGER_COMMAND_A was answered with REJECTED."
    bench.run(1, lambda k: healthy(k) + golden("command_ack_ok"))
    assert bench.fault("command_error") is None


@pytest.mark.parametrize(
    ("recorder", "fault_id", "text"),
    [
        (replace(RECORDING, state=RecorderState.DISK_FULL), "disk_full", "Disk full, not recording"),
        (replace(RECORDING, state=RecorderState.FAILED, error="read-only"), "recorder_failed", "Not recording"),
        (replace(RECORDING, dropped=3), "recorder_drops", "3 records lost"),
        (replace(RECORDING, seconds_left=1200.0), "disk_nearly_full", "Disk nearly full, 20 min left"),
        (replace(RECORDING, free_bytes=10, seconds_left=None), "disk_nearly_full", "Disk nearly full, little left"),
    ],
)
def test_recorder_faults(recorder: RecorderFacts, fault_id: str, text: str) -> None:
    bench = Bench()
    bench.recorder = recorder
    bench.assess()
    assert (bench.chip("recorder").text, bench.fault(fault_id).title) == (text, f"Recorder: {text}")
    assert (recorder.error or "") in bench.fault(fault_id).cause


@pytest.mark.parametrize(
    ("state", "chip_state"), [(RecorderState.OFF, ChipState.OFF), (RecorderState.WAITING, ChipState.UNKNOWN)]
)
def test_a_recorder_that_does_not_record_on_purpose(state: RecorderState, chip_state: ChipState) -> None:
    bench = Bench()
    bench.recorder = replace(RECORDING, state=state)
    bench.assess()
    assert bench.chip("recorder").state is chip_state
    assert bench.health.faults == ()


def test_mavlink_states() -> None:
    bench = Bench()
    started = MavlinkFacts(enabled=True, target="127.0.0.1:14401", enabled_since_s=100.0)
    bench.mavlink = started
    bench.assess()
    assert bench.chip("mavlink").state is ChipState.UNKNOWN
    bench.now_s = 110.0
    bench.assess()
    assert "UDP Server" in bench.fault("mavlink_silent").cure
    bench.mavlink = replace(started, peer_alive=True, peer="ArduSub", last_heard_s=109.5)
    bench.assess()
    assert (bench.chip("mavlink").text, bench.chip("mavlink").age_s) == ("Heard from ArduSub", 0.5)
    bench.mavlink = replace(started, error="no route to host")
    bench.assess()
    assert "no route to host" in bench.fault("mavlink_error").cause


@pytest.mark.parametrize(("trusted", "shown"), [(None, False), (True, False), (False, True)])
def test_a_wall_clock_that_gps_contradicts(trusted: bool | None, shown: bool) -> None:
    bench = Bench()
    bench.wall_trusted = trusted
    bench.run(3, healthy)
    assert (bench.fault("wall_clock") is not None) is shown


def test_replay_is_named_and_ends_without_a_fault() -> None:
    bench = Bench()
    bench.link = LinkFacts(PortState.CONNECTED, kind="replay", port="dive.mcap")
    bench.run(4, healthy)
    assert bench.chip("link").text.startswith("Replay, ")
    bench.link = replace(bench.link, state=PortState.FINISHED)
    bench.run(10, lambda k: b"")
    assert (bench.chip("link").state, bench.chip("link").text) == (ChipState.OFF, "Replay finished")


def test_faults_come_worst_first() -> None:
    bench = Bench()
    bench.wall_trusted = False
    bench.decoder = LinkDecoder(kogger_checksum="mod255")
    bench.run(3, lambda k: healthy(k, depth_ok=0))
    levels = [fault.level for fault in bench.health.faults]
    assert set(levels) == set(FaultLevel)
    assert levels == sorted(levels, key=list(FaultLevel).index)


def test_large_numbers_still_fit() -> None:
    bench = Bench()
    bench.recorder = replace(RECORDING, dropped=123_456_789)
    bench.mavlink = MavlinkFacts(enabled=True, target="255.255.255.255:14401", peer="255.255.255.255:14401")
    bench.run(1, lambda k: healthy(k, latitude_e7=0, longitude_e7=0, satellites=255, full_pressure_pa=101_325))
    bench.now_s += 100_000
    bench.assess()
    assert bench.chip("link").text == "No data for 100000 s"


def test_recent_increase_forgets_and_survives_a_reset() -> None:
    recent = RecentIncrease(10.0)
    assert recent.increase == 0
    for k in range(30):
        recent.observe(5 * k, float(k))
    assert recent.increase == 50
    assert recent.rate_hz == 5.0
    recent.observe(0, 30.0)
    assert recent.increase == 0
