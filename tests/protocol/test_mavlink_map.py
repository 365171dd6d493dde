import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bluerov_slam.protocol import mavlink_map
from bluerov_slam.records import FixType
from samples import ctd_sample, gps_fix, sensor_sample


def through_the_wire(name, fields):
    """What a receiver decodes from these fields: proves that pymavlink accepts every one of them."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=197)
    frame = getattr(mavlink, f"MAVLink_{name.lower()}_message")(**fields).pack(sender)
    return mavlink.MAVLink(None).decode(bytearray(frame))


def test_attitude_carries_angles_and_rates():
    fields = mavlink_map.attitude_fields(sensor_sample(yaw_rad=3.5), (0.01, 0.02, 0.03))
    message = through_the_wire("ATTITUDE", fields)
    assert message.roll == pytest.approx(0.1)
    assert message.yaw == pytest.approx(3.5 - math.tau)
    assert message.yawspeed == pytest.approx(0.03)


def test_attitude_rates_are_nan_when_unknown():
    message = through_the_wire("ATTITUDE", mavlink_map.attitude_fields(sensor_sample(), None))
    assert math.isnan(message.rollspeed)


@pytest.mark.parametrize("missing", [{"imu_alive": False}, {"roll_rad": None}, {"yaw_rad": None}])
def test_no_attitude_without_a_living_imu(missing):
    assert mavlink_map.attitude_fields(sensor_sample(**missing), None) is None


def test_pressure_is_in_hpa_and_temperature_in_centidegrees():
    message = through_the_wire("SCALED_PRESSURE", mavlink_map.scaled_pressure_fields(sensor_sample()))
    assert message.press_abs == pytest.approx(1500.0)
    assert message.temperature == 1518


def test_pressure_falls_back_to_the_depth_sensors_thermometer():
    fields = mavlink_map.scaled_pressure_fields(sensor_sample(temperature_degc=None))
    assert fields["temperature"] == 1520


@pytest.mark.parametrize(
    "missing", [{"pressure_pa": None}, {"temperature_degc": None, "depth_sensor_temperature_degc": None}]
)
def test_no_pressure_message_with_a_part_missing(missing):
    assert mavlink_map.scaled_pressure_fields(sensor_sample(**missing)) is None


def test_gps_carries_position_speed_and_course():
    message = through_the_wire("GPS_RAW_INT", mavlink_map.gps_raw_int_fields(gps_fix()))
    assert (message.lat, message.lon, message.alt) == (476123000, -27456000, 5000)
    assert (message.fix_type, message.satellites_visible) == (3, 9)
    assert (message.eph, message.vel, message.cog) == (90, 50, round(math.degrees(1.0) * 100))


def test_gps_unknowns_have_the_messages_own_value():
    fields = mavlink_map.gps_raw_int_fields(gps_fix(hdop=None, speed_mps=None, course_rad=None))
    assert {fields[key] for key in ("eph", "epv", "vel", "cog")} == {0xFFFF}


@pytest.mark.parametrize(
    "changes",
    [
        {"fix": FixType.NONE},
        {"latitude_deg": None},
        {"latitude_deg": 0.0, "longitude_deg": 0.0},
        {"latitude_deg": 91.0},
    ],
)
def test_no_gps_message_without_a_usable_position(changes):
    assert mavlink_map.gps_raw_int_fields(gps_fix(**changes)) is None


def test_gps_of_an_old_firmware_claims_no_more_than_2d():
    assert mavlink_map.gps_raw_int_fields_of_sample(sensor_sample())["fix_type"] == 2
    assert mavlink_map.gps_raw_int_fields_of_sample(sensor_sample(gps_alive=False)) is None


def test_named_values_leave_the_unknown_out():
    values = dict(mavlink_map.named_values(ctd_sample(salinity_psu=None, sound_speed_mps=math.nan)))
    assert values == {"WaterTemp": 15.18, "CtdDepth": 4.8}
    assert all(len(name) <= mavlink_map.MAX_NAME_CHARACTERS for name in values)


def test_status_text_is_cut_into_ascii_pieces():
    chunks = mavlink_map.status_text_chunks("é" * 120)
    assert [len(chunk) for chunk in chunks] == [50, 50, 20]
    assert set("".join(chunks)) == {"?"}


def test_battery_cells_add_up_and_unknowns_stay_unknown():
    fields = {"voltages": [15000, 0xFFFF], "voltages_ext": [0, 0], "current_battery": -1, "battery_remaining": -1}
    battery = mavlink_map.vehicle_record("BATTERY_STATUS", fields, 1.0)
    assert (battery.voltage_v, battery.current_a, battery.remaining_percent) == (15.0, None, None)


def test_servo_outputs_of_another_port_are_not_thrusters():
    assert mavlink_map.vehicle_record("SERVO_OUTPUT_RAW", {"port": 1, "time_usec": 1}, 1.0) is None


@pytest.mark.parametrize(
    "name", ["ATTITUDE", "SERVO_OUTPUT_RAW", "BATTERY_STATUS", "VISION_POSITION_DELTA", "PARAM_VALUE"]
)
@pytest.mark.parametrize("fields", [{}, {"roll": "x"}, {"voltages": None}, {"time_usec": None}])
def test_messages_that_make_no_sense_give_no_record(name, fields):
    assert mavlink_map.vehicle_record(name, fields, 1.0) is None


def test_non_finite_values_from_the_vehicle_give_no_record():
    fields = {"time_usec": 1, "time_delta_usec": 50000, "angle_delta": [0, 0, 0], "position_delta": [math.nan, 0, 0]}
    assert mavlink_map.vehicle_record("VISION_POSITION_DELTA", fields | {"confidence": 50.0}, 1.0) is None


RANGE = {
    "time_boot_ms": 60_900, "min_distance": 20, "max_distance": 5_000, "current_distance": 325, "orientation": 25,
    "signal_quality": 77,
}  # fmt: skip


@pytest.mark.parametrize(("sent", "percent"), [(77, 77), (0, None), (1, 0), (100, 100)])
def test_a_height_above_the_bottom_and_its_quality(sent, percent):
    height = mavlink_map.vehicle_record("DISTANCE_SENSOR", RANGE | {"signal_quality": sent}, 2.0)
    assert (height.distance_m, height.quality_percent, height.boot_ms, height.arrived_s) == (3.25, percent, 60_900, 2.0)


@pytest.mark.parametrize(
    "changes",
    [
        {"orientation": 0},
        {"current_distance": 10},
        {"current_distance": 5_001},
        {"current_distance": 0, "min_distance": 0},
    ],
)
def test_a_distance_that_looks_elsewhere_or_is_out_of_range_is_no_height(changes):
    assert mavlink_map.vehicle_record("DISTANCE_SENSOR", RANGE | changes, 2.0) is None
