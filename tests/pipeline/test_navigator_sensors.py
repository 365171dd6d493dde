"""A sensor's account, as the page's consistency panel shows it."""

import pytest

from bluerov_slam.pipeline.navigator_sensors import MOST_TOLD, REJECTED_IN_A_ROW, SensorStatus
from bluerov_slam.records import SensorTrust


def test_one_wild_value_does_not_make_the_good_ones_look_bad() -> None:
    status = SensorStatus("acoustics")
    status.heard_s = 0.0
    for at_s in range(99):
        status.use(float(at_s), 3.0, 3)
    status.reject(5000.0, 3)
    view = status.view(99.0)
    assert view.rejected == 1
    assert view.nis_ratio == pytest.approx((99 + MOST_TOLD) / 100)


def test_a_sensor_of_which_every_value_is_wild_is_far_off_and_rejected() -> None:
    status = SensorStatus("acoustics")
    status.heard_s = 0.0
    for _ in range(REJECTED_IN_A_ROW):
        status.reject(5000.0, 3)
    view = status.view(0.0)
    assert view.nis_ratio == pytest.approx(MOST_TOLD)
    assert view.trust is SensorTrust.REJECTED
