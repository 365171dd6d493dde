import asyncio
import socket
from collections import Counter
from dataclasses import replace

import aiohttp.web
import numpy as np
import orjson
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.pipeline.health import Fault, FaultLevel
from bluerov_slam.records import ImuBurst, VehicleAttitude, VehicleBattery, VehicleMotionDelta
from bluerov_slam.sinks import mavlink_bridge
from bluerov_slam.sinks.mavlink_bridge import MavlinkBridge, MavlinkOptions
from bluerov_slam.sinks.mavlink_transport import wanted_frames
from free_ports import free_port
from patience import PATIENCE_S
from samples import ctd_sample, gps_fix, sensor_sample


class Router(asyncio.DatagramProtocol):
    """A UDP endpoint as BlueOS opens it, with a pymavlink receiver and an autopilot's voice."""

    def __init__(self):
        self.mav = mavlink.MAVLink(None)
        self.messages = []
        self.peer = None
        self.arrived = asyncio.Event()

    def connection_made(self, transport):
        self.transport = transport
        self.port = transport.get_extra_info("sockname")[1]

    def datagram_received(self, data, addr):
        self.peer = addr
        self.messages += self.mav.parse_buffer(bytearray(data)) or []
        self.arrived.set()

    def say(self, message, system_id=1, component_id=1):
        self.transport.sendto(bytes(message.pack(mavlink.MAVLink(None, system_id, component_id))), self.peer)

    def names(self):
        return Counter(message.get_type() for message in self.messages)

    async def until(self, condition):
        while not condition():
            self.arrived.clear()
            await asyncio.wait_for(self.arrived.wait(), PATIENCE_S)


class Clock:
    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
async def router():
    transport, protocol = await asyncio.get_running_loop().create_datagram_endpoint(Router, local_addr=("127.0.0.1", 0))
    yield protocol
    transport.close()


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
async def make_bridge(router, clock, monkeypatch):
    monkeypatch.setattr(mavlink_bridge, "HEARTBEAT_PERIOD_S", 0.02)  # the first is sent before there is a socket
    bridges, records = [], []

    async def make(**options):
        bridge = MavlinkBridge(MavlinkOptions(enabled=True, target_port=router.port, **options), records.append, clock)
        await bridge.start()
        bridges.append(bridge)
        bridge.records = records
        await router.until(lambda: router.peer is not None)
        clock.now += 10.0  # past the time in which it only listens
        return bridge

    yield make
    for bridge in bridges:
        await bridge.stop()


async def heard(bridge, count=1):
    while sum(bridge.counters()["received"].values()) < count:
        await asyncio.sleep(0.005)


def burst(rate_radps):
    samples = np.full((2, 3), rate_radps)
    return ImuBurst(1.0, 1.0, 0.05, samples, samples, np.zeros((2, 3), np.int16))


async def test_it_introduces_itself_as_an_onboard_controller(router, make_bridge):
    await make_bridge()
    await router.until(lambda: router.names()["HEARTBEAT"])
    heartbeat = router.messages[0]
    assert heartbeat.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    assert heartbeat.autopilot == mavlink.MAV_AUTOPILOT_INVALID
    assert (heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (1, 197)
    assert heartbeat.get_msgbuf()[0] == mavlink.PROTOCOL_MARKER_V2


async def test_sensors_ctd_and_gps_become_their_messages(router, make_bridge):
    bridge = await make_bridge()
    for record in (burst(0.25), gps_fix(), sensor_sample(), ctd_sample()):
        bridge.on_record(record)
    await router.until(lambda: router.names()["NAMED_VALUE_FLOAT"] == 4)
    assert router.names()["ATTITUDE"] == router.names()["SCALED_PRESSURE"] == router.names()["GPS_RAW_INT"] == 1
    attitude = next(m for m in router.messages if m.get_type() == "ATTITUDE")
    assert attitude.rollspeed == pytest.approx(0.25)
    stamps = {message.time_boot_ms for message in router.messages if hasattr(message, "time_boot_ms")}
    assert stamps == {sensor_sample().device_ms}, "one clock for everything"


@pytest.mark.parametrize(
    ("switch", "name"),
    [
        ("send_attitude", "ATTITUDE"),
        ("send_scaled_pressure", "SCALED_PRESSURE"),
        ("send_gps_raw_int", "GPS_RAW_INT"),
        ("send_named_values", "NAMED_VALUE_FLOAT"),
    ],
)
async def test_each_message_has_its_switch(router, make_bridge, switch, name):
    bridge = await make_bridge(**{switch: False})
    for record in (gps_fix(), sensor_sample(), ctd_sample()):
        bridge.on_record(record)
    others = {"ATTITUDE", "SCALED_PRESSURE", "GPS_RAW_INT", "NAMED_VALUE_FLOAT"} - {name}
    await router.until(lambda: others <= router.names().keys())
    assert router.names()[name] == 0


async def test_nothing_is_sent_while_switched_off(router, clock):
    bridge = MavlinkBridge(MavlinkOptions(target_port=router.port), lambda record: None, clock)
    await bridge.start()
    bridge.on_record(sensor_sample())
    bridge.update_faults([Fault("x", FaultLevel.ERROR, "title", "cause", "cure")])
    assert bridge.facts().sent == 0
    assert not bridge.facts().enabled


async def test_nothing_invalid_is_sent(router, make_bridge):
    bridge = await make_bridge()
    bridge.on_record(
        sensor_sample(imu_alive=False, pressure_pa=None, gps_alive=False, gps_latitude_deg=None, gps_longitude_deg=None)
    )
    bridge.on_record(ctd_sample(temperature_degc=None, sound_speed_mps=None, salinity_psu=None, depth_m=None))
    await router.until(lambda: router.names()["HEARTBEAT"] >= 2)
    assert router.names().keys() == {"HEARTBEAT"}


async def test_the_autopilots_attitude_and_gps_stay_undisturbed(router, make_bridge, clock):
    """A ground station shows ATTITUDE and GPS_RAW_INT of system 1 whoever sent them: only one may speak."""
    bridge = await make_bridge()
    router.say(mavlink.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0))
    router.say(mavlink.MAVLink_gps_raw_int_message(1, 0, 0, 0, 0, 65535, 65535, 65535, 65535, 0))
    await heard(bridge, 2)
    bridge.on_record(gps_fix())
    bridge.on_record(sensor_sample())
    await router.until(lambda: router.names()["SCALED_PRESSURE"])
    assert router.names()["ATTITUDE"] == router.names()["GPS_RAW_INT"] == 0
    assert bridge.counters()["held_back"] == {"GPS_RAW_INT": 1, "ATTITUDE": 1}
    clock.now += 4.0  # the autopilot falls silent
    bridge.on_record(sensor_sample())
    await router.until(lambda: router.names()["ATTITUDE"])


async def test_it_listens_before_it_speaks_for_the_autopilot(router, make_bridge, clock):
    bridge = await make_bridge()
    await bridge.apply(MavlinkOptions(enabled=True, target_port=router.port, system_id=2))
    bridge.on_record(sensor_sample())
    assert bridge.counters()["held_back"]["ATTITUDE"] == 1


async def test_a_user_may_want_both(router, make_bridge):
    bridge = await make_bridge(defer_to_autopilot=False)
    router.say(mavlink.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0))
    await heard(bridge)
    bridge.on_record(sensor_sample())
    await router.until(lambda: router.names()["ATTITUDE"])


async def test_the_vehicles_messages_become_records(router, make_bridge):
    bridge = await make_bridge()
    router.say(mavlink.MAVLink_attitude_message(7, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    router.say(mavlink.MAVLink_servo_output_raw_message(9, 0, *[1500 + i for i in range(16)]))
    router.say(mavlink.MAVLink_battery_status_message(0, 0, 0, 2000, [15200] + [65535] * 9, 1234, -1, -1, 80))
    router.say(mavlink.MAVLink_vision_position_delta_message(5, 50000, [0, 0, 0.1], [0.01, 0, 0], 80.0), 255, 0)
    router.say(mavlink.MAVLink_param_value_message(b"X", 1.0, 9, 1, 0))
    await heard(bridge, 4)
    attitude, servo, battery, delta = bridge.records
    assert isinstance(attitude, VehicleAttitude)
    assert attitude.yaw_rad == pytest.approx(0.3)
    assert servo.pwm_us == tuple(1500 + i for i in range(16))
    assert battery == VehicleBattery(battery.arrived_s, 15.2, 12.34, 80)
    assert isinstance(delta, VehicleMotionDelta)
    assert delta.displacement_frd_m == pytest.approx((0.01, 0, 0))


async def test_another_vehicles_messages_are_not_ours(router, make_bridge):
    bridge = await make_bridge()
    router.say(mavlink.MAVLink_attitude_message(7, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6), system_id=9)
    await heard(bridge)
    assert bridge.records == []


async def test_garbage_and_broken_frames_are_counted_not_raised(router, make_bridge):
    bridge = await make_bridge()
    frame = bytearray(mavlink.MAVLink_attitude_message(7, 0, 0, 0, 0, 0, 0).pack(mavlink.MAVLink(None, 1, 1)))
    frame[-1] ^= 0xFF
    for junk in (bytes(frame), b"", b"\xfd" * 300, bytes(range(256)) * 4):
        router.transport.sendto(junk, router.peer)
    router.say(mavlink.MAVLink_attitude_message(7, 0.1, 0, 0, 0, 0, 0))
    await heard(bridge)
    assert len(bridge.records) == 1


async def test_the_facts_say_whether_anyone_answers(router, make_bridge, clock):
    bridge = await make_bridge()
    assert not bridge.facts().peer_alive
    router.say(mavlink.MAVLink_heartbeat_message(12, 3, 0, 0, 3, 3))
    await heard(bridge)
    assert bridge.facts().peer_alive
    clock.now += 6.0
    assert not bridge.facts().peer_alive


async def test_faults_come_and_go_as_status_text(router, make_bridge):
    bridge = await make_bridge()
    fault = Fault("imu", FaultLevel.ERROR, "IMU silent: check its power and wiring before the dive", "cause", "cure")
    bridge.update_faults([fault])
    bridge.update_faults([fault])
    bridge.update_faults([])
    await router.until(lambda: any("cleared" in m.text for m in router.messages if m.get_type() == "STATUSTEXT"))
    texts = [m for m in router.messages if m.get_type() == "STATUSTEXT"]
    first = [m for m in texts if m.id == texts[0].id]
    assert "".join(m.text for m in first) == f"SLAM: {fault.title}"
    assert texts[0].severity == mavlink.MAV_SEVERITY_ERROR
    assert len({m.id for m in texts}) == 2


async def test_a_target_without_address_is_an_error_text_not_an_exception(clock, monkeypatch):
    async def no_address(*_args, **_options):  # a name server that is out of reach would take its time to say so
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(asyncio.get_running_loop(), "getaddrinfo", no_address)
    options = MavlinkOptions(enabled=True, target_host="nowhere.invalid")
    bridge = MavlinkBridge(options, lambda record: None, clock)
    await bridge.start()
    async with asyncio.timeout(PATIENCE_S):
        while bridge.facts().error is None:
            bridge.on_record(sensor_sample())
            await asyncio.sleep(0.01)
    await bridge.stop()


async def test_where_nobody_listens_nobody_answers_and_that_is_no_error(clock):
    """The state of every BlueOS before the endpoint is added: the page then says how to add it."""
    options = MavlinkOptions(enabled=True, target_port=free_port())
    bridge = MavlinkBridge(options, lambda record: None, clock)
    await bridge.start()
    async with asyncio.timeout(PATIENCE_S):
        while bridge.facts().sent < 5:
            bridge.on_record(sensor_sample())
            await asyncio.sleep(0.005)
    facts = bridge.facts()
    assert (facts.error, facts.peer_alive) == (None, False)
    await bridge.stop()


async def test_switching_a_message_off_keeps_the_link(router, make_bridge):
    bridge = await make_bridge()
    peer = router.peer
    await bridge.apply(replace(MavlinkOptions(enabled=True, target_port=router.port), send_attitude=False))
    bridge.on_record(sensor_sample())
    await router.until(lambda: router.names()["SCALED_PRESSURE"])
    assert router.peer == peer
    assert router.names()["ATTITUDE"] == 0


def test_only_wanted_frames_are_cut_out_of_a_datagram():
    mav = mavlink.MAVLink(None, 1, 1)
    wanted = bytes(mavlink.MAVLink_attitude_message(7, 0, 0, 0, 0, 0, 0).pack(mav))
    other = bytes(mavlink.MAVLink_vfr_hud_message(1, 2, 3, 4, 5, 6).pack(mav))
    old = bytes(mavlink.MAVLink_heartbeat_message(12, 3, 0, 0, 3, 3).pack(mav, force_mavlink1=True))
    assert wanted_frames(b"\x00" + other + wanted + old + wanted[:9]) == [wanted, old]


async def test_mavlink2rest_carries_the_same_messages(clock):
    received, client = [], {}

    async def handler(request):
        socket = aiohttp.web.WebSocketResponse()
        await socket.prepare(request)
        client["filter"] = request.query["filter"]
        attitude = {"type": "ATTITUDE", "time_boot_ms": 1, "roll": 0.5, "pitch": 0.0, "yaw": 0.0}
        rates = {"rollspeed": 0.0, "pitchspeed": 0.0, "yawspeed": 0.0}
        await socket.send_str("not json")
        await socket.send_bytes(b"x")
        await socket.send_json({"header": {"system_id": 1, "component_id": 1}, "message": attitude | rates})
        async for message in socket:
            received.append(orjson.loads(message.data))  # noqa: PERF401
        return socket

    app = aiohttp.web.Application()
    app.router.add_get("/v1/ws/mavlink", handler)
    runner = aiohttp.web.AppRunner(app)
    await runner.setup()
    site = aiohttp.web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    port = site._server.sockets[0].getsockname()[1]
    records = []
    options = MavlinkOptions(enabled=True, mavlink2rest_url=f"ws://127.0.0.1:{port}/v1/ws/mavlink")
    bridge = MavlinkBridge(options, records.append, clock)
    await bridge.start()
    try:
        await heard(bridge)
        clock.now += 10.0
        bridge.on_record(burst(0.1))
        for record in (sensor_sample(), gps_fix(), ctd_sample()):
            bridge.on_record(record)
        bridge.update_faults([Fault("x", FaultLevel.WARNING, "title", "cause", "cure")])
        while len(received) < 8:
            await asyncio.sleep(0.01)
    finally:
        await bridge.stop()
        await runner.cleanup()
    assert records[0].roll_rad == 0.5
    by_type = {document["message"]["type"]: document["message"] for document in received}
    assert by_type["GPS_RAW_INT"]["fix_type"] == {"type": "GPS_FIX_TYPE_3D_FIX"}
    assert len(by_type["NAMED_VALUE_FLOAT"]["name"]) == 10
    assert by_type["STATUSTEXT"]["severity"] == {"type": "MAV_SEVERITY_WARNING"}
    assert "ATTITUDE" in client["filter"]
