import asyncio
import math
import stat
from types import SimpleNamespace

import aiohttp
import numpy as np
import pytest
from aiohttp import web

from bluerov_slam.errors import RecordingError
from bluerov_slam.protocol.kogger_frame import KoggerId, build_frame
from bluerov_slam.records import Channel, SonarFrames
from bluerov_slam.services.esp_link import CommandOutcome, CommandResult
from bluerov_slam.services.hub import Hub
from bluerov_slam.services.viewer_link import ViewerFacts, ViewerLink
from nav_samples import nav_state
from patience import PATIENCE_S
from samples import ctd_sample, sensor_sample

GREETING = [
    {"type": "settings", "mirror": True},
    {"type": "fed", "addresses": ["192.168.2.1"]},
    {"type": "recording", "name": None},
    {"type": "health", "chips": [{"id": "link", "state": "ok"}]},
]
CHART = build_frame(KoggerId.CHART, bytes(20))
ANSWER = build_frame(KoggerId.TRANSCEIVER, b"\xa3\x02\x0a\x01")


class Annotations:
    """One recording's annotations in memory."""

    def __init__(self):
        self.kept = {}

    def annotations(self, name):
        assert name == "active"
        return list(self.kept.values())

    def add_annotation(self, name, given):
        if not given:
            raise RecordingError("nothing is being recorded: start a recording first")
        self.kept["1"] = {"id": "1", **given}
        return self.kept["1"]

    def change_annotation(self, name, annotation_id, given):
        self.kept[annotation_id].update(given)
        return self.kept[annotation_id]

    def remove_annotation(self, name, annotation_id):
        del self.kept[annotation_id]


@pytest.fixture
async def rig(tmp_path):
    rig = SimpleNamespace(hub=Hub(), commands=[], gate=asyncio.Event(), recording=None, annotations=Annotations())
    rig.chips = [{"id": "link", "state": "ok"}]
    rig.gate.set()

    async def command(channel, frame):
        rig.commands.append((channel, frame))
        await rig.gate.wait()
        return CommandResult(CommandOutcome.OK, "done")

    facts = ViewerFacts(lambda: ["192.168.2.1"], lambda: {"mirror": True}, lambda: rig.recording, lambda: rig.chips)
    rig.token_file = tmp_path / "state" / "viewer-link.token"
    rig.link = ViewerLink(rig.hub, rig.token_file, command, rig.annotations, facts)
    rig.link.write_token()
    app = web.Application()
    app.router.add_get("/link", rig.link.handle)
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=1)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    port = site._server.sockets[0].getsockname()[1]
    async with aiohttp.ClientSession(f"http://127.0.0.1:{port}") as rig.client:
        yield rig
    await rig.link.close()
    await runner.cleanup()


def connect(rig, token=None):
    token = rig.token_file.read_text() if token is None else token
    return rig.client.ws_connect("/link", headers={"Authorization": f"Bearer {token}"})


async def greeted(socket):
    assert [await socket.receive_json(timeout=PATIENCE_S) for _ in GREETING] == GREETING


async def ask(socket, **message):
    await socket.send_json(message)
    return await socket.receive_json(timeout=PATIENCE_S)


async def test_a_viewer_is_told_at_once_what_it_must_know(rig):
    async with connect(rig) as socket:
        await greeted(socket)
        assert rig.link.viewers == 1


def test_the_token_can_be_read_by_its_owner_only(rig):
    assert stat.S_IMODE(rig.token_file.stat().st_mode) == 0o600
    token = rig.token_file.read_text()
    assert len(token) == 32
    assert int(token, 16) >= 0


@pytest.mark.parametrize("token", ["", "0" * 32, "wrong"])
async def test_without_the_token_nobody_gets_in(rig, token):
    with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
        await connect(rig, token)
    assert caught.value.status == 401


async def test_only_this_machine_gets_in():
    from bluerov_slam.services.viewer_link import _is_loopback

    for address, inside in (
        ("127.0.0.1", True),
        ("::1", True),
        ("::ffff:127.0.0.1", True),
        ("192.168.2.1", False),
        ("fe80::1%eth0", False),
        ("::ffff:10.0.0.1", False),
        (None, False),
        ("nonsense", False),
    ):
        assert _is_loopback(address) is inside, address


async def test_a_command_goes_down_and_its_result_comes_back_under_its_number(rig):
    async with connect(rig) as socket:
        await greeted(socket)
        answer = await ask(socket, type="command", id=7, channel="B", frame=ANSWER.hex())
        assert answer == {"type": "command_result", "id": 7, "result": "ok", "message": "done"}
        assert rig.commands == [(Channel.B, ANSWER)]


async def test_commands_of_both_sonars_do_not_wait_for_each_other(rig):
    rig.gate.clear()
    async with connect(rig) as socket:
        await greeted(socket)
        for number, channel in ((1, "A"), (2, "B")):
            await socket.send_json({"type": "command", "id": number, "channel": channel, "frame": "00"})
        async with asyncio.timeout(PATIENCE_S):
            while len(rig.commands) < 2:
                await asyncio.sleep(0)
        rig.gate.set()
        assert {(await socket.receive_json(timeout=PATIENCE_S))["id"] for _ in range(2)} == {1, 2}


@pytest.mark.parametrize("message", ["{", "[]", '{"type": "command"}', '{"id": 1}', '{"type": "other", "id": 1}'])
async def test_what_cannot_be_read_is_ignored_and_the_link_lives_on(rig, message):
    async with connect(rig) as socket:
        await greeted(socket)
        await socket.send_str(message)
        answer = await ask(socket, type="command", id=2, channel="A", frame="0102")
        assert answer["id"] == 2


@pytest.mark.parametrize("fields", [{"channel": "C", "frame": "00"}, {"channel": "A", "frame": "xyz"}, {"frame": "00"}])
async def test_an_unreadable_command_is_rejected_with_the_reason(rig, fields):
    async with connect(rig) as socket:
        await greeted(socket)
        answer = await ask(socket, type="command", id=1, **fields)
        assert answer["result"] == "rejected"
        assert "unreadable" in answer["message"]
        assert rig.commands == []


async def test_annotations_are_added_listed_changed_and_removed(rig):
    async with connect(rig) as socket:
        await greeted(socket)

        async def annotate(operation, **annotation):
            answer = await ask(socket, type="annotation", id=1, operation=operation, annotation=annotation)
            return answer["ok"], answer["annotations"], answer["message"]

        contact = {"id": "1", "kind": "contact", "name": "wreck"}
        assert await annotate("add", kind="contact", name="wreck") == (True, [contact], "")
        assert await annotate("list") == (True, [contact], "")
        assert (await annotate("change", id="1", name="bow"))[1][0]["name"] == "bow"
        assert await annotate("remove", id="1") == (True, [], "")
        assert await annotate("add") == (False, [], "nothing is being recorded: start a recording first")
        assert (await annotate("remove"))[0] is False
        assert "expected list, add, change or remove" in (await annotate("explode"))[2]


async def test_every_frame_but_the_echograms_is_passed_on(rig):
    async with connect(rig) as socket:
        await greeted(socket)
        rig.hub.publish(SonarFrames(Channel.A, 1.0, 1.0, (CHART, ANSWER, CHART), None))
        assert await socket.receive_json(timeout=PATIENCE_S) == {
            "type": "sonar_frame",
            "channel": "A",
            "frame": ANSWER.hex(),
        }


async def test_the_vehicle_is_told_at_most_twice_a_second(rig):
    async with connect(rig) as socket:
        await greeted(socket)
        for tenth in range(11):
            rig.hub.publish(sensor_sample(arrived_s=tenth / 10, yaw_rad=-0.1))
            rig.hub.publish(ctd_sample(arrived_s=tenth / 10, depth_m=float(tenth)))
        rig.recording = "session_1"
        rig.link.tick()
        messages = []
        while not messages or messages[-1]["type"] != "recording":
            messages.append(await socket.receive_json(timeout=PATIENCE_S))
        assert [message.get("depth_m") for message in messages[:-1]] == [0.0, 5.0, 10.0]
        assert messages[0]["heading_deg"] == pytest.approx(354.27)
        assert messages[-1] == {"type": "recording", "name": "session_1"}


async def test_the_viewer_is_told_each_second_how_every_part_is(rig):
    async with connect(rig) as socket:
        await greeted(socket)
        rig.chips = [{"id": "link", "state": "fault", "text": "ESP32 not found"}]
        rig.link.tick()
        assert await socket.receive_json(timeout=PATIENCE_S) == {"type": "health", "chips": rig.chips}


async def test_a_viewer_that_left_is_forgotten(rig):
    async with connect(rig) as socket:
        await greeted(socket)
    async with asyncio.timeout(PATIENCE_S):
        while rig.link.viewers:
            await asyncio.sleep(0)
    rig.link.tell_fed()


async def test_the_estimate_goes_along_while_it_is_fresh_and_only_as_far_as_it_is_known(rig):
    async with connect(rig) as socket:
        await greeted(socket)

        async def estimate(at_s: float, **pose: object) -> dict[str, object]:
            if pose:
                rig.hub.publish(nav_state(**pose))
            rig.hub.publish(sensor_sample(arrived_s=at_s))
            rig.hub.publish(ctd_sample(arrived_s=at_s))
            return (await socket.receive_json(timeout=PATIENCE_S))["estimate"]

        unknown = dict.fromkeys(
            ("latitude_deg", "longitude_deg", "within_m", "heading_deg", "heading_std_deg", "altitude_m")
        )
        assert await estimate(1.0) == unknown
        covariance = np.diag([4.0, 1.0, 0.01, 1e-4, 1e-4, math.radians(2.0) ** 2])
        known = {
            "measured_s": 2.0,
            "origin_deg": (47.6, -2.7),
            "position_ned_m": (111.2, 0.0, 5.0),
            "quaternion_ned_frd": (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)),
            "pose_covariance": covariance,
            "altitude_m": 6.5,
        }
        told = await estimate(2.0, **known)
        assert told["latitude_deg"] == pytest.approx(47.601, abs=2e-6)
        assert told["longitude_deg"] == pytest.approx(-2.7)
        # 95 % of two degrees of freedom: 2.4477 times the larger deviation of 2 m.
        assert told["within_m"] == pytest.approx(4.9, abs=0.01)
        assert (told["heading_deg"], told["heading_std_deg"], told["altitude_m"]) == (90.0, 2.0, 6.5)
        assert await estimate(2.0 + 3.0) == unknown
        nowhere = await estimate(
            6.0, **known | {"measured_s": 6.0, "origin_deg": None, "position_ned_m": None, "altitude_m": None}
        )
        assert (nowhere["latitude_deg"], nowhere["within_m"], nowhere["heading_deg"]) == (None, None, 90.0)
