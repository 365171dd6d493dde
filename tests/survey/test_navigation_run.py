"""A recorded dive with an array is smoothed twice: each pulse as it is seen from the first smoothed track."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bluerov_slam.acoustics.array import ArrayMounting, ReceiverArray
from bluerov_slam.navigation.local_frame import LocalFrame
from bluerov_slam.navigation.rotation import rotation_from_euler
from bluerov_slam.pipeline.acoustic_options import AcousticOptions
from bluerov_slam.pipeline.navigator import Navigator
from bluerov_slam.pipeline.navigator_options import NavigatorOptions
from bluerov_slam.simulation.dive_plan import DIVE_PLANS
from bluerov_slam.sources.recording_reader import open_recording
from bluerov_slam.survey import navigation_run
from navigated_dive import SHORT_DIVE, record_short_dive

BEACON = DIVE_PLANS["beacon"].acoustics
ARRAY = ReceiverArray(np.vstack((ReceiverArray.cross().positions_m, (0.25, 0.0, 0.0))), name="cross with stalk")


@pytest.fixture(scope="module")
def heard(tmp_path_factory):
    """A dive with a pulse every five seconds, its transmitter in the middle of the field."""
    assert BEACON is not None
    acoustics = replace(BEACON, beacon_north_m=15.0, beacon_east_m=5.0, beacon_depth_m=10.0)
    plan = replace(SHORT_DIVE, acoustics=acoustics)
    session, dive = record_short_dive(tmp_path_factory.mktemp("heard"), plan=plan)
    mounting = ArrayMounting(rotation_from_euler(0.0, -math.pi / 2.0, 0.0), np.array(acoustics.lever_arm_frd_m))
    latitude_deg, longitude_deg, _ = LocalFrame(*dive.truth.origin_deg).to_geodetic(15.0, 5.0)
    options = AcousticOptions(
        array=ARRAY, mounting=mounting, beacon_deg=(latitude_deg, longitude_deg), beacon_depth_m=10.0
    )
    return session, NavigatorOptions(acoustics=options)


def test_a_second_pass_is_made_where_pulses_were_heard(heard, monkeypatch) -> None:
    session, options = heard
    passes: list[int] = []
    keep = Navigator.keep_for_smoothing

    def counted(navigator, first_pass=()):
        passes.append(len(first_pass))
        keep(navigator, first_pass)

    monkeypatch.setattr(Navigator, "keep_for_smoothing", counted)
    twice = navigation_run.run_navigation(open_recording(session), options=options)
    assert "acoustics" in twice.updates
    assert passes[0] == 0
    assert len(passes) == 2
    assert passes[1] > 100
    passes.clear()
    navigation_run.run_navigation(open_recording(session), options=replace(options, acoustics=None))
    assert passes == [0]
