import asyncio
import contextlib
import math
import signal
import sys
from collections import Counter
from dataclasses import replace

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.simulation.scenario import SCENARIOS
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from bluerov_slam.sources.recording_reader import open_recording
from firmware_build import board_in_the_loop
from free_ports import free_port
from patience import PATIENCE_S
from real_data import recording
from running_system import diving, faults

SUBMERGED = replace(SCENARIOS["survey"], samples=500, mission_start_s=60.0, uptime_s=100.0)
AFLOAT = replace(SUBMERGED, mission_start_s=0.0)
GUARDED = ("ATTITUDE", "GPS_RAW_INT")
DATA_MESSAGES = {"ATTITUDE", "SCALED_PRESSURE", "GPS_RAW_INT", "NAMED_VALUE_FLOAT"}


class GroundStation:
    """pymavlink's own UDP endpoint (udpin, as BlueOS opens it), which can speak as the autopilot as well."""

    def __init__(self):
        self.port = free_port()
        self.messages = []
        self._link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{self.port}", source_system=1, source_component=1)
        self._task = asyncio.create_task(self._listen())

    def received(self, name):
        """Messages of this name from our component so far."""
        return [m for m in self.messages if m.get_type() == name and m.get_srcComponent() == 197]

    def names(self):
        return Counter(message.get_type() for message in self.messages)

    def take_waiting(self):
        """Everything that was sent to us before this moment."""
        while (message := self._link.recv_msg()) is not None:
            self.messages.append(message)

    async def until(self, condition, what):
        try:
            async with asyncio.timeout(PATIENCE_S):
                while not condition():
                    await asyncio.sleep(0.02)
        except TimeoutError:
            raise AssertionError(f"no {what}; got {self.names()}") from None

    @contextlib.asynccontextmanager
    async def autopilot(self):
        """While this lasts, the autopilot reports its own attitude and position four times a second."""
        task = asyncio.create_task(self._fly())
        try:
            yield
        finally:
            task.cancel()

    async def close(self):
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        self._link.close()

    async def _listen(self):
        while True:
            self.take_waiting()
            await asyncio.sleep(0.01)

    async def _fly(self):
        mav = self._link.mav
        while True:
            mav.heartbeat_send(mavlink.MAV_TYPE_SUBMARINE, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 3)
            mav.attitude_send(1000, 0.5, -0.25, 1.0, 0.0, 0.0, 0.0)
            mav.gps_raw_int_send(1000, 3, 476123000, -27456000, 0, 90, 65535, 0, 0, 12)
            await asyncio.sleep(0.25)


@pytest.fixture
async def station():
    station = GroundStation()
    yield station
    await station.close()


def board(scenario):
    return VirtualEsp32(scenario, board=board_in_the_loop(scenario))


async def enable(dive, station):
    values = {"mavlink.target_port": station.port, "mavlink.enabled": True}
    status, answer = await dive.services.call("PATCH", "/api/settings", json=values)
    assert status == 200, answer


async def test_a_ground_station_hears_every_message_of_a_vehicle_afloat(tmp_path, station):
    async with diving(tmp_path, board(AFLOAT)) as dive:
        status, _ = await dive.services.call("PATCH", "/api/settings", json={"mavlink.target_port": station.port})
        assert status == 200
        status, _ = await dive.services.call("PATCH", "/api/settings", json={"mavlink.enabled": True}, headers={})
        assert status == 403, "without an Origin nothing is switched on"
        seen = len(dive.sensors)
        await dive.until(lambda: len(dive.sensors) > seen + 3, "sensors")
        assert (await dive.state())["mavlink"]["sent"] == 0
        assert station.messages == [], "nothing before it is switched on"

        await enable(dive, station)
        await station.until(lambda: station.names().keys() >= {*DATA_MESSAGES, "HEARTBEAT"}, "messages of every kind")
        assert {(m.get_srcSystem(), m.get_srcComponent()) for m in station.messages} == {(1, 197)}
        assert {m.get_msgbuf()[0] for m in station.messages} == {mavlink.PROTOCOL_MARKER_V2}
        assert "BAD_DATA" not in station.names()

        heartbeat = station.received("HEARTBEAT")[0]
        assert (heartbeat.type, heartbeat.autopilot) == (
            mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
            mavlink.MAV_AUTOPILOT_INVALID,
        )
        shown = dive.sensors[-1]["data"]
        attitude = station.received("ATTITUDE")[-1]
        assert abs(attitude.roll) < 0.3
        assert abs(attitude.pitch) < 0.3
        await station.until(
            lambda: any(math.isfinite(m.rollspeed) for m in station.received("ATTITUDE")), "attitude with known rates"
        )
        pressure = station.received("SCALED_PRESSURE")[-1]
        assert pressure.press_abs == pytest.approx(shown["depth"]["press"], abs=50.0)
        assert pressure.temperature / 100 == pytest.approx(shown["celsius"]["temp"], abs=0.5)
        fix = station.received("GPS_RAW_INT")[-1]
        assert fix.fix_type == mavlink.GPS_FIX_TYPE_3D_FIX
        assert fix.lat / 1e7 == pytest.approx(shown["gps"]["lat"], abs=1e-4)
        assert fix.lon / 1e7 == pytest.approx(shown["gps"]["lon"], abs=1e-4)
        await dive.until(
            lambda: fix.satellites_visible in {message["data"]["gps"]["sat"] for message in dive.sensors},
            "as many satellites on the page",
        )
        values = {m.name: m.value for m in station.received("NAMED_VALUE_FLOAT")}
        assert values["SoundSpd"] == pytest.approx(dive.sensors[-1]["extra"]["sound_speed_mps"], abs=2.0)
        assert {"WaterTemp", "Salinity"} <= values.keys()

        dive.inject("kind=silent sensor=imu", 1e6)
        texts = lambda: [m.text for m in station.received("STATUSTEXT")]  # noqa: E731
        await station.until(lambda: "SLAM: IMU: Silent" in texts(), "STATUSTEXT of the fault")
        dive.let_speak("imu")
        await station.until(lambda: "SLAM: cleared: IMU: Silent" in texts(), "STATUSTEXT of its end")

        await dive.services.call("PATCH", "/api/settings", json={"mavlink.enabled": False})
        station.take_waiting()
        off = len(station.messages)
        seen = len(dive.sensors)
        await dive.until(lambda: len(dive.sensors) > seen + 4, "sensors")
        assert len(station.messages) - off <= 2, "at most what was under way"
        await dive.finish()


async def test_the_autopilots_own_attitude_and_position_stay_undisturbed(tmp_path, station):
    async with diving(tmp_path, board(AFLOAT)) as dive:
        await enable(dive, station)
        await station.until(lambda: station.received("HEARTBEAT"), "heartbeat")
        async with station.autopilot():
            await enable(dive, station)
            await station.until(lambda: len(station.received("SCALED_PRESSURE")) > 12, "pressure")
            assert [name for name in GUARDED if station.received(name)] == []
            state = await dive.state(lambda s: s["mavlink"]["peer_alive"])
            assert all(state["mavlink"]["by_message"]["held_back"][name] for name in GUARDED)
            assert state["mavlink"]["received"] > 0
        await station.until(lambda: station.received("ATTITUDE"), "our attitude, once the autopilot is silent")
        assert not any(m.get_type() in ("PARAM_SET", "COMMAND_LONG", "REQUEST_DATA_STREAM") for m in station.messages)
        await dive.finish()


async def test_under_water_no_position_is_sent_and_nothing_of_a_silent_sensor(tmp_path, station):
    async with diving(tmp_path, board(SUBMERGED)) as dive:
        dive.inject("kind=silent sensor=imu", 1000.0)
        dive.inject("kind=silent sensor=depth", 1000.0)
        await dive.state(lambda s: {"imu_silent", "depth_missing"} <= faults(s).keys())
        await enable(dive, station)
        await station.until(lambda: len(station.received("HEARTBEAT")) >= 6, "heartbeats past the listening time")
        assert station.names().keys() <= {"HEARTBEAT", "NAMED_VALUE_FLOAT", "STATUSTEXT"}
        assert {m.name for m in station.received("NAMED_VALUE_FLOAT")} <= {"WaterTemp", "SoundSpd", "Salinity"}
        await dive.finish()


@pytest.mark.data
async def test_a_real_vehicle_log_becomes_records_and_is_recorded(tmp_path):
    path = recording("bluerov2_ardusub_logs", "surface_ugps_2023-05-04.tlog")
    port = free_port()
    player = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "bluerov_slam", "simulate", "--tlog-only", "--tlog", str(path)),
        *("--tlog-target", f"127.0.0.1:{port}"),
    )
    wanted = ("ATTITUDE", "SERVO_OUTPUT_RAW", "BATTERY_STATUS")
    try:
        settings = {"mavlink__enabled": "true", "mavlink__target_port": str(port)}
        async with diving(tmp_path, board(SUBMERGED), **settings) as dive:
            state = await dive.state(
                lambda s: all(s["mavlink"]["by_message"]["received"].get(name, 0) > 3 for name in wanted)
            )
            assert state["mavlink"]["peer_alive"] is True
            assert "ATTITUDE" not in state["mavlink"]["by_message"]["sent"]
            chip = await dive.chip("mavlink", "ok")
            assert str(port) in chip["text"]
            await dive.finish()
    finally:
        player.send_signal(signal.SIGTERM)
        await player.wait()
    (session,) = (tmp_path / "state" / "recordings").glob("session_*")
    topics = ("/vehicle/attitude", "/vehicle/servo_output", "/vehicle/battery")
    kept = Counter(message.topic for message in open_recording(session).messages(topics))
    assert all(kept[topic] > 3 for topic in topics), kept
