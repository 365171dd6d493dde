"""ODOMETRY, parameters and GPS_INPUT over real datagrams, with pymavlink as the autopilot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.config import Settings
from bluerov_slam.errors import CommandError
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.records import NavMode, PositionFix
from fake_autopilot import EKF_PARAMETERS
from vehicle_rig import ON, ORIGIN, rig


async def test_nothing_is_sent_before_the_user_wants_it():
    async with rig() as made:
        await made.run(2.0)
        assert "ODOMETRY" not in made.autopilot.names
        assert "SET_GPS_GLOBAL_ORIGIN" not in made.autopilot.names
        assert made.vehicle.odometry.json() == {"enabled": False, "sent": 0, "text": "Nothing is sent to the autopilot"}


@pytest.mark.parametrize(("rate_hz", "expected"), [(4.0, 4), (5.0, 5), (10.0, 10)])
async def test_an_autopilot_without_origin_gets_ours_and_then_positions_at_the_rate(rate_hz, expected):
    async with rig(ON | {"odometry_rate_hz": rate_hz}) as made:
        await made.run(6.0)
        assert made.autopilot.origin == (543219000, 101356000)
        before = len(made.autopilot.odometry)
        await made.run(3.0)
        assert len(made.autopilot.odometry) - before == pytest.approx(3 * expected, abs=1)
        assert made.autopilot.dropped_frames == 0
        taken = made.autopilot.odometry[-1]
        assert taken.position_ned_m == pytest.approx((20.0, -5.0, 3.0), abs=1e-4)
        assert taken.velocity_ned_mps == pytest.approx((0.4, 0.1, 0.05), abs=1e-6)
        assert taken.message.reset_counter == 2
        assert taken.message.quality == 90
        assert made.text == "Position goes to the autopilot"
        assert made.vehicle.odometry.problem is None


async def test_positions_count_from_the_autopilots_own_origin():
    async with rig(ON, autopilot={"origin": (543210000, 101360000)}) as made:
        await made.run(2.0)
        taken = made.autopilot.odometry[-1]
        vehicle_deg = LocalFrame(*ORIGIN).to_geodetic(20.0, -5.0, 3.0)
        north_m, east_m, _ = LocalFrame(54.321, 10.136).to_ned_m(vehicle_deg[0], vehicle_deg[1])
        assert taken.position_ned_m == pytest.approx((north_m, east_m, 3.0), abs=0.01)
        assert "SET_GPS_GLOBAL_ORIGIN" not in made.autopilot.names


async def test_a_new_origin_of_ours_is_no_jump_for_the_autopilot_and_one_of_its_is():
    async with rig(ON, autopilot={"origin": (543219000, 101356000)}) as made:
        await made.run(1.0)
        here = LocalFrame(*ORIGIN).to_geodetic(20.0, -5.0)[:2]
        await made.run(1.0, origin_deg=here, position_ned_m=(0.0, 0.0, 3.0))
        assert made.autopilot.odometry[-1].position_ned_m == pytest.approx((20.0, -5.0, 3.0), abs=0.01)
        assert made.autopilot.odometry[-1].message.reset_counter == 2
        made.autopilot.origin = (543220000, 101356000)
        made.autopilot._tell_origin()
        await made.run(1.0, origin_deg=here, position_ned_m=(0.0, 0.0, 3.0))
        assert made.autopilot.odometry[-1].message.reset_counter == 3


async def test_an_autopilot_that_never_tells_its_origin_gets_positions_all_the_same():
    async with rig(ON, autopilot={"tells_origin": False}) as made:
        await made.run(12.0)
        assert made.autopilot.odometry[-1].position_ned_m == pytest.approx((20.0, -5.0, 3.0), abs=1e-4)
        assert "taken to be ours" in made.text


async def test_an_origin_on_another_continent_stops_it():
    async with rig(ON, autopilot={"origin": (350000000, 1390000000)}) as made:
        await made.run(2.0)
        assert made.autopilot.odometry == []
        assert "km away" in made.text


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"mode": NavMode.ATTITUDE, "position_ned_m": None, "pose_covariance": None}, "not known yet"),
        ({"pose_covariance": np.diag([150.0, 1.0, 0.01, 1e-4, 1e-4, 1e-3])}, "limit is 10 m"),
        ({"pose_covariance": np.full((6, 6), math.nan)}, "not known yet"),
        ({"velocity_ned_mps": None}, "velocity or attitude"),
    ],
)
async def test_a_position_that_is_not_known_well_enough_is_not_sent(changes, word):
    async with rig(ON, autopilot={"origin": (543219000, 101356000)}) as made:
        await made.run(1.0)
        sent = len(made.autopilot.odometry)
        assert sent
        await made.run(1.0, **changes)
        assert len(made.autopilot.odometry) == sent
        assert word in made.text
        assert made.vehicle.odometry.problem == made.text


@pytest.mark.parametrize(("options", "word"), [({"replay": True}, "replay"), ({"simulated": True}, "simulated")])
async def test_a_replay_and_a_simulated_vehicle_send_nothing(options, word):
    async with rig(ON, **options) as made:
        await made.run(6.0)
        assert "ODOMETRY" not in made.autopilot.names
        assert word in made.text


async def test_odometry_needs_the_udp_endpoint_and_says_so():
    async with rig(ON) as made:
        mavlink2rest = {"enabled": True, "mavlink2rest_url": "ws://127.0.0.1:6040/v1/ws/mavlink"}
        made.settings = Settings.model_validate({"navigation": ON, "mavlink": mavlink2rest})
        await made.run(6.0)
        assert "ODOMETRY" not in made.autopilot.names
        assert "mavlink2rest" in made.text


async def test_a_simulated_vehicle_may_send_to_a_simulated_autopilot_but_a_replay_never():
    wanted = ON | {"odometry_when_simulated": True}
    async with rig(wanted, simulated=True, autopilot={"origin": (543219000, 101356000)}) as made:
        await made.run(1.0)
        assert made.autopilot.odometry
    async with rig(wanted, simulated=True, replay=True, autopilot={"origin": (543219000, 101356000)}) as made:
        await made.run(1.0)
        assert "ODOMETRY" not in made.autopilot.names


async def test_a_restarted_autopilot_is_asked_for_its_origin_again():
    async with rig(ON, autopilot={"origin": (543219000, 101356000)}) as made:
        await made.run(1.0)
        made.clock.now += 10.0
        made.vehicle.tick()
        made.autopilot.origin = None
        await made.run(6.0)
        assert made.autopilot.origin == (543219000, 101356000)


async def test_parameters_are_shown_with_what_they_are():
    parameters = {name: value for name, value in EKF_PARAMETERS.items() if name != "EK3_GPS_TYPE"}
    async with rig(autopilot={"parameters": parameters}) as made:
        made.vehicle.parameters._answer_s = 0.2
        rows = {row["name"]: row for row in await made.vehicle.parameters.read()}
        assert (rows["EK3_SRC1_POSXY"]["needed"], rows["EK3_SRC1_POSXY"]["current"]) == (6.0, 3.0)
        assert rows["VISO_TYPE"]["current"] == 0.0
        assert rows["EK3_GPS_TYPE"]["current"] is None
        assert made.autopilot.writes == []
        asked = made.autopilot.names.count("PARAM_REQUEST_READ")
        await made.vehicle.parameters.read()
        assert made.autopilot.names.count("PARAM_REQUEST_READ") == asked, "what is known need not be asked for again"


async def test_the_needed_ones_are_set_acknowledged_and_read_back():
    async with rig() as made:
        rows = await made.vehicle.parameters.set_needed()
        assert all(row["current"] in (row["needed"], None) for row in rows)
        assert made.autopilot.writes == [
            ("VISO_TYPE", 1.0), ("EK3_SRC1_POSXY", 6.0), ("EK3_SRC1_VELXY", 6.0), ("EK3_SRC1_VELZ", 0.0)
        ]  # fmt: skip
        for name, _ in made.autopilot.writes:
            assert made.autopilot.names.count("PARAM_SET") == 4, name
        await made.vehicle.parameters.set_needed()
        assert len(made.autopilot.writes) == 4, "what is right is not written again"


async def test_our_heading_is_asked_for_only_where_the_user_wants_it():
    async with rig({"odometry_heading": True}) as made:
        await made.vehicle.parameters.set_needed()
        assert made.autopilot.parameters["EK3_SRC1_YAW"] == 6.0


async def test_nothing_is_set_on_an_armed_vehicle():
    async with rig(autopilot={"armed": True}) as made:
        with pytest.raises(CommandError, match="armed: disarm"):
            await made.vehicle.parameters.set_needed()
        assert made.autopilot.writes == []


async def test_a_parameter_that_does_not_stay_is_an_error_that_says_so():
    async with rig(autopilot={"stubborn": {"EK3_SRC1_POSXY"}}) as made:
        with pytest.raises(CommandError, match="reads back as 3"):
            await made.vehicle.parameters.set_needed()


async def test_an_autopilot_that_does_not_have_a_parameter_is_an_error_with_a_cure():
    parameters = {name: value for name, value in EKF_PARAMETERS.items() if name != "EK3_SRC1_VELXY"}
    async with rig(autopilot={"parameters": parameters}) as made:
        made.vehicle.parameters._answer_s = 0.02
        with pytest.raises(CommandError, match=r"EK3_SRC1_VELXY.*restart"):
            await made.vehicle.parameters.set_needed()


async def test_an_autopilot_that_is_not_heard_is_not_asked():
    async with rig() as made:
        made.clock.now += 60.0
        rows = await made.vehicle.parameters.read()
        assert all("not heard" in row["text"] for row in rows)
        with pytest.raises(CommandError, match="not heard"):
            await made.vehicle.parameters.set_needed()


def gps_input(latitude: int, **changes: Any) -> Any:
    fields = {
        "time_usec": 0, "gps_id": 0, "ignore_flags": 0, "time_week_ms": 0, "time_week": 0, "fix_type": 3,
        "lat": latitude, "lon": 101356000, "alt": 0.0, "hdop": 1.0, "vdop": 1.0, "vn": 0.0, "ve": 0.0, "vd": 0.0,
        "speed_accuracy": 0.0, "horiz_accuracy": 1.2, "vert_accuracy": 0.0, "satellites_visible": 10,
    }  # fmt: skip
    return mavlink.MAVLink_gps_input_message(**(fields | changes))


async def test_gps_input_becomes_fixes_only_when_wanted_and_only_when_it_is_one():
    for wanted, expected in (("off", 0), ("gps_input", 2)):
        async with rig({"external_position": wanted}) as made:
            fixes: list[PositionFix] = []
            made.hub.subscribe(fixes.append, PositionFix)
            made.autopilot.say(gps_input(543219000))
            made.autopilot.say(gps_input(543219000))  # frozen
            made.autopilot.say(gps_input(543219100, hdop=99.99))
            made.autopilot.say(gps_input(543219200, fix_type=0))
            made.autopilot.say(gps_input(543219300))
            await made.settle()
            assert len(fixes) == expected
            if fixes:
                assert fixes[0].covariance_ne_m2 == pytest.approx((1.44, 0.0, 1.44))
                assert made.vehicle.frozen_positions == 1
