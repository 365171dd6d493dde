import numpy as np
import pytest

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.hooke_jeeves import hooke_jeeves_2d, hooke_jeeves_3d, hooke_jeeves_corrected

SOUND = 343.0
CROSS = ReceiverArray.cross()


def sources(range_m: float, count: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    azimuth, elevation = np.radians(rng.uniform(-20, 20, count)), np.radians(rng.uniform(-8, 8, count))
    return range_m * np.column_stack(
        (np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation))
    )


def test_published_search_stops_half_a_millimetre_off_on_perfect_input() -> None:
    """Defect 10: mean 0.46 mm, at most 0.85 mm at 2.6 m, from a residual in s^2 that ends the search too early."""
    errors, iterations, evaluations = [], [], []
    for source in sources(2.6, 150):
        found = hooke_jeeves_2d(CROSS.positions_m, CROSS.delays_s(source, SOUND), SOUND, float(source[0]))
        assert found.residual_s2 <= 1e-13
        errors.append(1e3 * float(np.linalg.norm(found.position_m - source)))
        iterations.append(found.iterations)
        evaluations.append(found.evaluations)
    assert np.mean(errors) == pytest.approx(0.46, abs=0.05)
    assert 0.7 < max(errors) < 0.95
    assert 50 < np.mean(evaluations) < 66
    assert max(iterations) < 110


def test_published_search_spends_its_first_two_evaluations_on_the_start_and_never_steps_2_m() -> None:
    """Defect 9."""
    delays = CROSS.delays_s((2.0, 0.3, 0.1), SOUND)
    cut = [
        hooke_jeeves_2d(CROSS.positions_m, delays, SOUND, 2.0, most_iterations=count, least_residual_s2=0.0)
        for count in (1, 2, 3)
    ]
    assert [search.evaluations for search in cut] == [1, 2, 6]
    assert cut[1].position_m == pytest.approx((2.0, 0.0, 0.0))
    assert cut[2].step_m == 1.0


def test_published_search_without_its_residual_stop_ends_on_the_step() -> None:
    source = np.array((1.4, 0.2, -0.1))
    found = hooke_jeeves_2d(
        CROSS.positions_m, CROSS.delays_s(source, SOUND), SOUND, 1.4, least_residual_s2=0.0, most_iterations=1000
    )
    assert found.step_m <= 1e-6
    assert found.position_m == pytest.approx(source, abs=1e-5)


@pytest.mark.parametrize("range_m", [1.4, 2.6, 3.9])
def test_corrected_search_ends_within_microns(range_m: float) -> None:
    for source in sources(range_m, 20):
        found = hooke_jeeves_corrected(CROSS.positions_m, CROSS.delays_s(source, SOUND), SOUND, float(source[0]))
        assert found.position_m == pytest.approx(source, abs=5e-6)


def test_intended_3d_search_finds_the_direction_and_not_the_range() -> None:
    """Defect 12: four receivers at equal distance say next to nothing about the range."""
    turned = range_off = 0.0
    for source in sources(2.6, 40):
        found = hooke_jeeves_3d(CROSS.positions_m, CROSS.delays_s(source, SOUND), SOUND, 1.3).position_m
        cosine = float(found @ source / np.linalg.norm(found) / np.linalg.norm(source))
        turned = max(turned, np.degrees(np.arccos(min(1.0, cosine))))
        range_off = max(range_off, abs(float(np.linalg.norm(found)) - 2.6))
    assert turned < 1.0
    assert range_off > 0.3


def test_corrected_3d_search_with_a_centre_receiver_finds_the_range() -> None:
    array = ReceiverArray.cross(centre=True)
    source = np.array((2.5, 0.4, -0.2))
    found = hooke_jeeves_corrected(
        array.positions_m,
        array.delays_s(source, SOUND),
        SOUND,
        2.0,
        axes=(0, 1, 2),
        least_step_m=1e-8,
        most_evaluations=200_000,
    )
    assert found.position_m == pytest.approx(source, abs=1e-3)


def test_delays_must_match_the_receivers() -> None:
    with pytest.raises(ValueError, match="2 delays for 4 receivers"):
        hooke_jeeves_2d(CROSS.positions_m, (0.0, 0.0), SOUND, 2.0)
