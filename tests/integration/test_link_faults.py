import asyncio
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

from bluerov_slam.protocol.esp32_messages import Esp32FrameDecoder, MessageType, encode_frame
from bluerov_slam.records import Channel, Ping, SensorSample
from bluerov_slam.simulation.boot_text import PROBE_BYTES
from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from firmware_build import board_in_the_loop
from running_system import chips, diving, faults, missing_ts, shape

PERIOD_MS = 100.0
# A frame that the fault only just met, or that waited behind one.
SLACK_MS = 110.0
UNTIL_MENDED_S = 1e6
# What the computer that runs the tests may have by itself.
HOST_FAULTS = ("disk_nearly_full", "wall_clock")
SCENARIO = replace(SCENARIOS["survey"], samples=500, mission_start_s=60.0, sensors_rate_mhz=10_000)
NOBODY = 65534
OPEN_AND_PROBE = """
import os, sys
node, data, user = sys.argv[1], bytes.fromhex(sys.argv[2]), int(sys.argv[3])
if os.geteuid() == 0 and user:
    os.chmod(node, 0o666)
    os.setgroups([])
    os.setgid(user)
    os.setuid(user)
os.write(os.open(node, os.O_RDWR | os.O_NOCTTY), data)
"""


def board(*, baud=115_200, **changes):
    scenario = replace(SCENARIO, **changes)
    return VirtualEsp32(scenario, baud, board=board_in_the_loop(scenario))


class ForeignFirmware(VirtualEsp32):
    """Packs its sonar data in a way of its own; everything else is as it should be."""

    def __init__(self, scenario):
        super().__init__(scenario, board=board_in_the_loop(scenario))
        self._frames = Esp32FrameDecoder()

    def advance(self, until_s):
        return b"".join(
            encode_frame(kind, payload[::-1] if kind == MessageType.KOGGER_COMPRESSED else payload)
            for kind, payload in self._frames.feed(super().advance(until_s))
        )


async def open_and_probe(node, user):
    """Do what the vehicle's Ping service does to every port, as that user; returns what it complains of."""
    command = [sys.executable, "-c", OPEN_AND_PROBE, node, PROBE_BYTES.hex(), str(user)]
    return (await asyncio.to_thread(subprocess.run, command, capture_output=True, text=True)).stderr


def assert_only_lost_within(dive, *windows):
    lost = [ts for ts in missing_ts(dive.ts, PERIOD_MS) if not any(window.holds(ts, SLACK_MS) for window in windows)]
    assert lost == []


async def test_noise_costs_only_what_it_hits(tmp_path):
    async with diving(tmp_path, board()) as dive:
        windows = []
        for fault in ("kind=bit_errors rate=1e-3", "kind=garbage rate=10", "kind=drop rate=5e-3"):
            before = (await dive.state())["link"]
            windows.append(dive.inject(fault, 1.0))
            await dive.past(windows[-1])
            after = (await dive.state())["link"]
            moved = {key: after[key] - before[key] for key in ("crc_errors", "bytes_skipped", "resyncs", "frames")}
            assert all(moved.values()), (fault, moved)
            state = await dive.state(lambda s: "link_errors" in faults(s))
            assert set(faults(state)) <= {"link_errors", "sonar_a_gaps", "sonar_b_gaps", "mavlink_silent", *HOST_FAULTS}
            assert "shielded USB cable" in chips(state)["link"]["cure"]
            assert chips(state)["link"]["state"] == "warn"
            await dive.whole_pings()
        assert_only_lost_within(dive, *windows)
        await dive.finish()


async def test_a_reset_with_boot_text_is_told_and_time_goes_on(tmp_path):
    async with diving(tmp_path, board(uptime_s=100.0)) as dive:
        before = await dive.state(lambda s: s["firmware"] and s["firmware"]["boots"] == 7)
        at = len(dive.sensors)
        dive.inject("kind=reset reason=9", 0.0)
        await dive.until(lambda: min(dive.ts[at:], default=1e9) < dive.ts[at - 1], "first frame of the new start")
        await dive.whole_pings()
        restart = await dive.fault("brownout")
        assert "supply of at least 1 A" in restart["cure"]
        state = await dive.state(lambda s: s["firmware"]["boots"] == 8)
        assert state["firmware"]["reset_reason"] == 9
        assert chips(state)["link"]["state"] == "fault"
        assert state["link"]["bytes_skipped"] - before["link"]["bytes_skipped"] > 300, "the boot text is no frame"
        assert state["link"]["reconnects"] == 0
        boot = next(n for n, (a, b) in enumerate(pairwise(dive.ts), 1) if b < a)
        assert dive.ts[boot] < 700, "not even the first frame of the new start is lost"
        assert missing_ts(dive.ts[:boot], PERIOD_MS) == missing_ts(dive.ts[boot:], PERIOD_MS) == []
        measured = [message["extra"]["measured_unix_s"] for message in dive.sensors]
        assert [(a, b) for a, b in pairwise(measured) if b < a] == []
        ages_s = [message["t"] - message["extra"]["measured_unix_s"] for message in dive.sensors]
        assert all(abs(age_s) < 20.0 for age_s in ages_s), "the board's clock went back by 100 s, ours did not"
        await dive.finish()


async def test_the_vehicles_own_probe_is_kept_out_or_does_no_harm(tmp_path):
    async with diving(tmp_path, board()) as dive:
        node = (await dive.state())["link"]["port"]
        refused = await open_and_probe(node, NOBODY)
        assert "Device or resource busy" in refused
        if os.geteuid() == 0:  # nothing keeps root out
            heard = dive.simulator.counters.bytes_received
            assert await open_and_probe(node, 0) == ""
            await dive.until(lambda: dive.simulator.counters.bytes_received > heard, "probe at the board")
        bad = (await dive.state(lambda s: s["firmware"]))["firmware"]["bad_commands"]
        window = dive.inject("kind=probe rate=5", 1.0)
        await dive.past(window)
        state = await dive.state(lambda s: s["firmware"]["bad_commands"] > bad)
        assert (state["link"]["crc_errors"], state["link"]["reconnects"], state["link"]["connected"]) == (0, 0, True)
        assert await dive.services.configure_esp32(decimation=4) == (200, {"result": "ok", "message": "done"})
        await dive.whole_pings()
        assert missing_ts(dive.ts, PERIOD_MS) == []
        await dive.finish()


async def test_replugged_under_a_new_node_name_it_is_found_again(tmp_path):
    async with diving(tmp_path, board(uptime_s=100.0)) as dive:
        before = (await dive.state())["link"]
        names = set(os.listdir(tmp_path / "dev"))
        last = len(dive.sensors)
        dive.inject("kind=unplug", UNTIL_MENDED_S)
        absent = await dive.fault("port_absent")
        assert "Plug the ESP32's USB cable" in absent["cure"]
        state = await dive.state()
        assert chips(state)["link"]["state"] == "fault"
        assert (state["link"]["connected"], state["link"]["waiting_for"]) == (False, dive.services.serial_port)
        assert (await dive.services.get("/health")) | {"frames": 0} == {
            "status": "healthy", "serial": False, "frames": 0, "protocol": "binary_v4",
        }  # fmt: skip
        await dive.assert_healthy()
        dive.replug()
        await dive.until(lambda: len(dive.sensors) > last + 10, "sensors after the replug")
        after = (await dive.state(lambda s: s["link"]["connected"]))["link"]
        assert set(os.listdir(tmp_path / "dev")) != names
        assert after["port"] != before["port"]
        assert after["reconnects"] == 1
        await dive.whole_pings()
        boot = next(n for n, (a, b) in enumerate(pairwise(dive.ts), 1) if b < a)
        assert missing_ts(dive.ts[:boot], PERIOD_MS) == missing_ts(dive.ts[boot:], PERIOD_MS) == []
        measured = [message["extra"]["measured_unix_s"] for message in dive.sensors]
        assert [(a, b) for a, b in pairwise(measured) if b < a] == []
        await dive.finish()


async def test_each_silent_sensor_is_named_and_comes_back(tmp_path):
    async with diving(tmp_path, board()) as dive:
        await dive.state(lambda s: all(chips(s)[c]["state"] in ("ok", "off") for c in ("imu", "depth", "ctd", "gps")))
        silent = ("imu", "gps", "depth", "celsius", "b")
        for sensor in (*silent, "ec"):
            dive.inject(f"kind=silent sensor={sensor}", UNTIL_MENDED_S)
        expected = {
            "imu_silent": ("imu", "wires"),
            "gps_silent": ("gps", "wires"),
            "depth_missing": ("depth", "SDA 21"),
            "temperature_missing": ("ctd", "SDA 21"),
            "sonar_b_silent": ("sonar_b", "12 V"),
        }
        state = await dive.state(lambda s: expected.keys() <= faults(s).keys())
        for fault_id, (chip_id, cure) in expected.items():
            chip = chips(state)[chip_id]
            assert (chip["state"], cure in chip["cure"]) == ("fault", True), (fault_id, chip)
        assert chips(state)["sonar_a"]["state"] == "ok"
        assert chips(state)["link"]["state"] == "ok"
        latest = await dive.services.get("/api/latest")
        assert (latest["imu"]["alive"], latest["imu"]["r"]) == (False, None)
        assert (latest["gps"]["alive"], latest["gps"]["lat"]) == (False, None)
        assert (latest["depth"]["ok"], latest["depth"]["press"]) == (False, None)
        assert (latest["celsius"]["ok"], latest["celsius"]["temp"]) == (False, None)
        assert (latest["kb"]["alive"], latest["ka"]["alive"]) == (False, True)
        dive.let_speak(*silent)
        conductivity = await dive.fault("conductivity_silent")
        assert "UART mode" in conductivity["cure"]
        dive.let_speak("ec")
        quiet = ("imu", "depth", "ctd", "gps", "sonar_a", "sonar_b")
        await dive.state(lambda s: all(chips(s)[c]["state"] in ("ok", "off") for c in quiet))
        await dive.whole_pings()
        assert missing_ts(dive.ts, PERIOD_MS) == []
        await dive.finish()


async def test_a_sonar_switched_on_in_the_middle_of_a_ping_shows_whole_pings_only(tmp_path):
    async with diving(tmp_path, board(b_starts_mid_ping=True)) as dive:
        await dive.whole_pings()
        at, starts = len(dive.pings), 3
        for _ in range(starts):
            await dive.past(dive.inject("kind=mid_ping sensor=b", 0.0))
        await dive.whole_pings()
        torn = [ping for ping in dive.pings[at:] if not dive.is_whole(ping)]
        assert {ping.channel for ping in torn} == {Channel.B}
        assert {ping.samples.size for ping in torn} == {dive.samples}
        joined = [ping for ping in torn if ping.gaps[0][0] == 0]
        assert len(joined) >= starts, "what was missed before the first whole frame is marked"
        # The ping that was under way when the sonar started anew may be cut short as well.
        assert len(torn) <= 2 * starts, [shape(ping) for ping in torn]
        state = await dive.state(lambda s: "sonar_b_gaps" in faults(s))
        assert [state["sonars"][channel]["incomplete"] for channel in "AB"] == [0, len(torn)]
        assert "sonar_a_gaps" not in faults(state)
        assert missing_ts(dive.ts, PERIOD_MS) == []
        await dive.finish()


async def test_old_firmware_works_and_is_told_what_it_lacks(tmp_path):
    async with diving(tmp_path, board(legacy=True)) as dive:
        old = await dive.fault("old_firmware")
        assert "pio run -t upload" in old["cure"]
        await dive.whole_pings()
        state = await dive.state(lambda s: chips(s)["sonar_b"]["state"] == "ok")
        assert state["firmware"] is None
        assert state["link"]["frames_by_type"].keys() == {"0x01", "0x04"}
        assert {message["extra"]["sender"] for message in dive.sensors} == {"legacy"}
        assert dive.sensors[-1]["data"]["ec"]["conductivity"] is None, "53 000 uS/cm do not fit and wrap"
        assert dive.sensors[-1]["data"]["celsius"]["temp"] is not None
        status, answer = await dive.services.call("POST", "/api/esp32", json={"decimation": 4})
        assert (status, "old firmware takes no commands" in answer["error"]) == (409, True)
        assert missing_ts(dive.ts, PERIOD_MS) == []
        records = await dive.finish()
        assert {ping.channel for ping in records if isinstance(ping, Ping)} == set(Channel)


async def test_sonar_data_in_an_unknown_layout_is_told_and_the_rest_works(tmp_path):
    async with diving(tmp_path, ForeignFirmware(SCENARIO), pings=False) as dive:
        layout = await dive.fault("unknown_layout")
        assert "Flash the firmware" in layout["cure"]
        assert "0.1.0" in layout["cause"]
        state = await dive.state(lambda s: all(chips(s)[c]["state"] == "fault" for c in ("sonar_a", "sonar_b")))
        assert "Flash the firmware" in chips(state)["sonar_a"]["cure"]
        assert [state["sonars"][channel]["pings"] for channel in "AB"] == [0, 0]
        assert all(chips(state)[c]["state"] in ("ok", "off") for c in ("link", "imu", "depth", "ctd"))
        assert missing_ts(dive.ts, PERIOD_MS) == []
        records = await dive.finish()
        assert not any(isinstance(record, Ping) for record in records)
        assert any(isinstance(record, SensorSample) for record in records)


async def test_a_sonar_that_sums_modulo_255_is_understood_and_said_so(tmp_path):
    fast = board(baud=921_600, checksum_a="mod255")
    async with diving(tmp_path, fast) as dive:
        note = await dive.fault("mod255_a")
        assert note["level"] == "info"
        state = await dive.state()
        assert "mod255_b" not in faults(state)
        assert [state["sonars"][channel]["checksum_in_use"] for channel in "AB"] == ["mod255", "mod256"]
        viewer = (await dive.services.get("/api/status", "viewer"))["channels"]
        assert [viewer[channel]["checksum_in_use"] for channel in "AB"] == ["mod256", "mod256"]
        assert viewer["A"]["checksum_errors"] == 0
        await dive.whole_pings()
        assert missing_ts(dive.ts, PERIOD_MS) == []
        await dive.finish()
