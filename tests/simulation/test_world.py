import math

import numpy as np
import pytest

from bluerov_slam.simulation.scene import geodetic, metres_from
from bluerov_slam.simulation.sonar import PORT, STARBOARD, SideScan
from bluerov_slam.simulation.vehicle import VehicleState
from bluerov_slam.simulation.water import (
    WaterProfile,
    conductivity_s_per_m,
    practical_salinity_psu,
    sound_speed_mps,
)
from bluerov_slam.simulation.world import TILE_M, World, build_world


def flat_world(depth_m: float = 15.0) -> World:
    return World(depth_m, np.zeros((1024, 1024), np.float32), np.ones((1024, 1024), np.float32))


def still(depth_m: float = 9.0, roll_rad: float = 0.0) -> VehicleState:
    return VehicleState(50.0, 50.0, depth_m, roll_rad, 0.0, 0.0, 0.0, False)


def mean_ping(world: World, side: int = STARBOARD, state: VehicleState | None = None, count: int = 60) -> np.ndarray:
    sonar = SideScan(world, side, 1)
    return np.mean([sonar.ping(state or still(), 1000, 0.02, 0) for _ in range(count)], axis=0)


def test_world_follows_from_its_seed() -> None:
    assert np.array_equal(build_world(3, 15.0).height_m, build_world.__wrapped__(3, 15.0).height_m)
    assert not np.array_equal(build_world(3, 15.0).height_m, build_world(4, 15.0).height_m)


def test_the_tile_has_no_seam() -> None:
    world = build_world(1, 15.0)
    across_seam = np.abs(world.height_m[0] - world.height_m[-1]).mean()
    inside = np.abs(np.diff(world.height_m[:200], axis=0)).mean()
    assert across_seam < 2.0 * inside


def test_profile_repeats_with_the_tile() -> None:
    world = build_world(1, 15.0)
    north, east = np.linspace(0.0, 20.0, 50), np.full(50, 7.3)
    assert world.profile(north, east)[0] == pytest.approx(world.profile(north - TILE_M, east + 2 * TILE_M)[0])


def test_the_water_column_ends_at_the_altitude() -> None:
    ping = mean_ping(flat_world())
    first_bottom = int(np.argmax(ping[50:] > 40) + 50) * 0.02
    assert first_bottom == pytest.approx(6.0, abs=0.1)
    assert ping[50:290].mean() < 8.0


def test_flat_ground_gets_fainter_with_range_and_has_the_speckle_of_real_recordings() -> None:
    ping = mean_ping(flat_world())
    assert ping[400:500].mean() > 1.2 * ping[900:1000].mean()
    sonar = SideScan(flat_world(), STARBOARD, 1)
    patch = np.array([sonar.ping(still(), 1000, 0.02, 0) for _ in range(80)])[:, 700:760]
    assert 0.32 < patch.std() / patch.mean() < 0.46


def test_a_box_is_bright_and_throws_a_shadow_of_the_right_length() -> None:
    world = flat_world()
    world.height_m[:, 600:605] = 1.0  # 10 m to starboard of the vehicle, half a metre wide, 1 m high
    ping = mean_ping(world)
    front = int(math.hypot(10.0, 5.5) / 0.02)
    # The ray over the far edge (10.5 m, 5 m below) meets the bottom 6 m below at 12.6 m: slant 14.0 m.
    assert ping[front - 15 : front + 15].max() > 1.5 * ping[450:500].mean()
    assert ping[610:680].mean() < 0.3 * ping[450:500].mean()
    assert ping[720:760].mean() > 0.6 * ping[450:500].mean()


def test_port_and_starboard_see_their_own_side() -> None:
    world = flat_world()
    world.height_m[:, 600:605] = 1.0
    starboard, port = mean_ping(world, STARBOARD), mean_ping(world, PORT)
    assert starboard[610:680].mean() < 0.4 * port[610:680].mean()


def test_the_surface_shows_as_a_faint_line_at_the_vehicles_depth() -> None:
    ping = mean_ping(flat_world(30.0), state=still(depth_m=8.0))
    assert ping[400:410].mean() > 3.0 * ping[370:395].mean()


def test_a_ping_out_of_reach_of_the_bottom_is_dark() -> None:
    sonar = SideScan(flat_world(500.0), STARBOARD, 1)
    assert sonar.ping(still(5.0), 200, 0.01, 100).mean() < 10.0


def test_salinity_check_value_and_its_inversion() -> None:
    # Unesco 1983 check value: ratio 1.2, 20 degC, 2000 dbar.
    assert practical_salinity_psu(1.2 * 4.2914, 20.0, 2000.0) == pytest.approx(37.245628, abs=1e-6)
    assert practical_salinity_psu(conductivity_s_per_m(35.0, 12.0, 50.0), 12.0, 50.0) == pytest.approx(35.0, abs=1e-5)


def test_sound_speed_check_value() -> None:
    assert sound_speed_mps(10.0, 35.0, 1000.0) == pytest.approx(1506.26, abs=0.01)


def test_the_water_has_a_thermocline() -> None:
    water = WaterProfile()
    assert water.temperature_degc(0.0) - water.temperature_degc(15.0) > 4.0
    assert water.pressure_pa(0.0) == pytest.approx(101_325.0)
    assert 3.5 < water.conductivity_s_per_m(9.0) < 5.0


def test_metres_and_degrees_are_inverse() -> None:
    class Here:
        origin_latitude_deg, origin_longitude_deg = 47.6, -2.7

    latitude, longitude = geodetic(Here(), VehicleState(120.0, -35.0, 0, 0, 0, 0, 0, True))  # type: ignore[arg-type]
    north, east = metres_from((47.6, -2.7), np.array([latitude]), np.array([longitude]))
    assert (north[0], east[0]) == pytest.approx((120.0, -35.0), abs=1e-5)
