import math
from dataclasses import replace

from bluerov_slam.records import NavMode
from bluerov_slam.services.navigation_assistant import DiveStartAssistant
from nav_samples import nav_state

KINDS = [{"kind": kind, "state": "none"} for kind in ("gyro", "magnetometer")]


def steps(assistant, state, kinds=KINDS):
    return {step["id"]: step for step in assistant.steps(state, kinds)}


def leg(assistant, heading_deg, seconds, start_s, **changes):
    half = math.radians(heading_deg) / 2
    velocity = (0.4 * math.cos(2 * half), 0.4 * math.sin(2 * half), 0.0)
    for i in range(int(seconds * 4)):
        state = nav_state(
            measured_s=start_s + i / 4, mode=NavMode.AIDED, velocity_ned_mps=velocity,
            quaternion_ned_frd=(math.cos(half), 0.0, 0.0, math.sin(half)), depth_m=0.1,
        )  # fmt: skip
        assistant.observe(replace(state, **changes))
    return start_s + seconds


def test_the_first_undone_step_is_active():
    assistant = DiveStartAssistant()
    states = [step["state"] for step in assistant.steps(None, KINDS)]
    assert states == ["active", "todo", "todo", "todo", "todo", "todo"]
    assistant.done("zero_depth")
    assert [step["state"] for step in assistant.steps(None, KINDS)][:2] == ["done", "active"]


def kind(name, state="none", **more):
    return {"kind": name, "state": state, **more}


def test_the_thrusters_field_is_offered_and_keeps_nothing_waiting():
    assistant = DiveStartAssistant()
    assistant.done("zero_depth")
    made = [kind("gyro", "done"), kind("thruster_field"), kind("swing"), kind("course_swing")]
    told = steps(assistant, None, made)
    assert (told["thruster_field"]["action"], told["thruster_field"]["kind"]) == ("start_calibration", "thruster_field")
    assert (told["thruster_field"]["state"], told["swing"]["state"]) == ("todo", "active")
    running = [*made[:1], kind("thruster_field", "running", instruction="Run thruster 3"), *made[2:]]
    assert steps(assistant, None, running)["thruster_field"]["text"] == "Run thruster 3"
    # The calibrations of the sensors are a step of their own.
    assert told["calibrate"]["state"] == "done"


def test_a_compass_swing_counts_whichever_way_it_was_made():
    assistant = DiveStartAssistant()
    offered = steps(assistant, None, [kind("swing"), kind("course_swing")])["swing"]
    assert (offered["action"], offered["kind"], offered["state"]) == ("start_calibration", "swing", "todo")
    driving = [kind("swing"), kind("course_swing", "running", instruction="Drive at one speed")]
    assert steps(assistant, None, driving)["swing"]["text"] == "Drive at one speed"
    ready = [kind("swing", "ready", instruction="Done: two turns were seen."), kind("course_swing")]
    told = steps(assistant, None, ready)["swing"]
    assert told["state"] != "done", "the result was not taken yet"
    assert "Take the result" in told["text"]
    for made in ("swing", "course_swing"):
        told = steps(assistant, None, [kind(made, "done", residual=1.2345, unit="deg")])["swing"]
        assert (told["state"], "1.2 deg" in told["text"]) == ("done", True)


def test_calibrations_count_when_all_are_made():
    assistant = DiveStartAssistant()
    made = [{**kind, "state": "done"} for kind in KINDS]
    assert steps(assistant, None, made)["calibrate"]["state"] == "done"
    assert "magnetometer" in steps(assistant, None, [made[0], KINDS[1]])["calibrate"]["text"]
    running = [{"kind": "gyro", "state": "running", "instruction": "keep it still"}]
    assert "keep it still" in steps(assistant, None, running)["calibrate"]["text"]


def test_a_surface_run_needs_two_legs_that_are_apart():
    assistant = DiveStartAssistant()
    known = nav_state(current_std_mps=(0.04, 0.05))
    at_s = leg(assistant, 10.0, 40.0, 0.0)
    assert steps(assistant, known)["surface_run"]["state"] != "done"
    at_s = leg(assistant, 30.0, 40.0, at_s)
    assert steps(assistant, known)["surface_run"]["state"] != "done", "20 degrees apart tell nothing of the current"
    leg(assistant, 190.0, 40.0, at_s)
    assert steps(assistant, known)["surface_run"]["state"] == "done"


def test_two_legs_that_left_the_current_open_are_a_warning():
    assistant = DiveStartAssistant()
    at_s = leg(assistant, 0.0, 40.0, 0.0)
    leg(assistant, 100.0, 40.0, at_s)
    step = steps(assistant, nav_state(current_std_mps=(0.2, 0.2)))["surface_run"]
    assert (step["state"], "0.20 m/s" in step["text"]) == ("warning", True)
    assert steps(assistant, nav_state(current_std_mps=None))["surface_run"]["state"] == "warning"


def test_only_legs_under_gps_at_the_surface_and_moving_count():
    for changes in ({"mode": NavMode.DEAD_RECKONING}, {"depth_m": 3.0}, {"velocity_ned_mps": (0.05, 0.0, 0.0)}):
        assistant = DiveStartAssistant()
        at_s = leg(assistant, 0.0, 40.0, 0.0, **changes)
        leg(assistant, 100.0, 40.0, at_s, **changes)
        assert steps(assistant, nav_state(current_std_mps=(0.01, 0.01)))["surface_run"]["state"] != "done", changes


def test_a_gap_in_the_data_is_no_time_under_way():
    assistant = DiveStartAssistant()
    for at_s in (0.0, 100.0, 200.0):
        leg(assistant, 0.0, 0.5, at_s)
    assert "for 5 s" in steps(assistant, nav_state())["surface_run"]["text"]


def test_the_origin_says_where_it_comes_from():
    assistant = DiveStartAssistant()
    assert "first fix" in steps(assistant, nav_state())["set_origin"]["text"]
    assistant.done("set_origin")
    assert "first fix" not in steps(assistant, nav_state())["set_origin"]["text"]
    assert steps(assistant, nav_state(origin_deg=None))["set_origin"]["state"] == "todo"
