"""What `run --simulate` tells simulator and extension of the acoustic array: the same array on both sides."""

import numpy as np
import pytest

from bluerov_slam.cli.run import _acoustics
from bluerov_slam.cli.service_options import parse_flags
from bluerov_slam.services.acoustic_settings import acoustic_options
from bluerov_slam.services.settings_store import SettingsStore
from bluerov_slam.simulation.acoustic_board import fitted_array, rotation_frd_array
from bluerov_slam.simulation.acoustic_plan import AcousticPlan


def _flags(words):
    return tuple(word for word in words if word != "--set")


@pytest.mark.parametrize("table", ["", '[acoustics]\narray = "cross_with_centre"\nmounting_rpy_deg = [10, -20, 30]\n'])
def test_the_extension_is_told_the_array_that_is_simulated(tmp_path, table):
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(f"{table}" or "[acoustics]\n")
    board, fitted = _acoustics(str(scenario), wanted=False)
    flags = {**parse_flags(_flags(fitted)), "paths.state": str(tmp_path)}
    settings = SettingsStore.open(None, flags, {}).settings
    options = acoustic_options(settings)
    plan = AcousticPlan()
    if table:
        plan = AcousticPlan(array="cross_with_centre", mounting_rpy_deg=(10.0, -20.0, 30.0))
    assert np.allclose(options.array.positions_m, fitted_array(plan).positions_m)
    assert options.array.name == "acoustics.places_m"
    assert np.allclose(options.array.sample_skew_s, fitted_array(plan).sample_skew_s)
    assert np.allclose(options.mounting.rotation_frd_array, rotation_frd_array(plan))
    assert np.allclose(options.mounting.lever_arm_frd_m, plan.lever_arm_frd_m)
    assert board == ["--acoustics", f"127.0.0.1:{settings.acoustics.udp_port}"]


def test_a_scenario_without_a_beacon_gets_one_only_on_demand():
    assert _acoustics("survey", wanted=False) == ([], [])
    board, fitted = _acoustics("survey", wanted=True)
    assert board[0] == "--acoustics"
    assert "acoustics.enabled=true" in fitted


def test_over_the_esp32_s_line_no_datagrams_are_sent(tmp_path):
    scenario = tmp_path / "scenario.toml"
    scenario.write_text('[acoustics]\nlink = "serial"\n')
    board, fitted = _acoustics(str(scenario), wanted=False)
    assert board == []
    assert "acoustics.enabled=true" in fitted
