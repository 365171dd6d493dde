import math

import pytest

from bluerov_slam.protocol import mavlink_navigation as nav
from bluerov_slam.sinks.mavlink_transport import Mavlink2RestTransport, rest_message
from nav_samples import nav_state


async def test_odometry_with_what_it_does_not_know_does_not_go_through_mavlink2rest():
    transport = Mavlink2RestTransport("ws://127.0.0.1:1/", 1, 197, lambda *_: None)
    transport._connected = True
    assert transport.send("ODOMETRY", nav.odometry_fields(nav_state(), max_std_m=10.0)) is False


def test_commands_and_parameters_go_with_names_of_enums_and_padded_text():
    command = rest_message("COMMAND_LONG", nav.ask_origin_fields(1, 1))
    assert command["command"] == {"type": "MAV_CMD_REQUEST_MESSAGE"}
    fields = {"target_system": 1, "target_component": 1, "param_id": b"VISO_TYPE", "param_value": 1.0, "param_type": 2}
    message = rest_message("PARAM_SET", fields)
    assert message["param_type"] == {"type": "MAV_PARAM_TYPE_INT8"}
    assert nav.parameter_name(message["param_id"]) == "VISO_TYPE"
    assert len(message["param_id"]) == 16


@pytest.mark.parametrize("value", [math.nan, [1.0, math.nan], [[math.inf]]])
async def test_what_json_cannot_say_does_not_go_that_way(value):
    transport = Mavlink2RestTransport("ws://127.0.0.1:1/", 1, 197, lambda *_: None)
    transport._connected = True
    assert transport.send("ODOMETRY", {"x": value}) is False
    assert transport.send("HEARTBEAT", {"x": [1.0, 2.0]}) is True
