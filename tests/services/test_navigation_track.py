import itertools

import pytest

from bluerov_slam.protocol.navigation_json import FixOutcome
from bluerov_slam.services import navigation_track
from bluerov_slam.services.navigation_track import NavigationTrack
from nav_samples import nav_state


def track_of(count: int, period_s: float = 0.5) -> NavigationTrack:
    track = NavigationTrack(lambda at_s: at_s + 1e9)
    for i in range(count):
        track.add(nav_state(measured_s=i * period_s, position_ned_m=(float(i), 0.0, 1.0)))
    return track


def test_points_come_at_half_seconds_with_all_the_page_draws():
    track = track_of(11, period_s=0.05)
    (first, second) = track.listing()["points"]
    assert first == (1e9, 0.0, 0.0, 3.0, pytest.approx(2.45), pytest.approx(0.412), "dead_reckoning")
    assert second[0] == 1e9 + 0.5


def test_a_long_dive_is_thinned_from_its_old_end_and_bounded(monkeypatch):
    monkeypatch.setattr(navigation_track, "MAX_POINTS", 100)
    points = track_of(1000).listing(points=1000)["points"]
    assert len(points) <= 100
    assert points[-1][1] == 999.0
    steps = [b[1] - a[1] for a, b in itertools.pairwise(points)]
    assert steps[-1] == 1.0
    assert steps[0] > 1.0
    assert points == sorted(points)


@pytest.mark.parametrize("count", [2, 3, 7, 99])
def test_it_is_thinned_evenly_to_what_is_asked_and_ends_with_the_newest(count):
    points = track_of(200).listing(points=count)["points"]
    assert len(points) == count
    assert (points[0][1], points[-1][1]) == (0.0, 199.0)


def test_only_what_is_newer_is_told():
    assert [p[1] for p in track_of(10).listing(since_unix_s=1e9 + 3.9)["points"]] == [8.0, 9.0]


def test_a_new_origin_begins_a_new_track_and_no_position_is_no_point():
    track = track_of(5)
    track.add_fix(FixOutcome(1.0, "gps", 54.0, 10.0, 1.0, 2.0, 1.5, True))
    assert len(track.listing()["fixes"]) == 1
    track.add(nav_state(measured_s=10.0, position_ned_m=None))
    assert len(track.listing()["points"]) == 5
    track.add(nav_state(measured_s=11.0, origin_deg=(1.0, 2.0)))
    listing = track.listing()
    assert (len(listing["points"]), listing["fixes"]) == (1, [])
    assert listing["origin"] == {"latitude_deg": 1.0, "longitude_deg": 2.0}


def test_a_fix_without_an_origin_is_nowhere():
    track = NavigationTrack(float)
    track.add_fix(FixOutcome(1.0, "gps", 54.0, 10.0, None, None, 1.5, None))
    assert track.listing()["fixes"] == []
