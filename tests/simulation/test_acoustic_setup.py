"""Set-ups from tables: every figure by name, every mistake by name."""

import numpy as np
import pytest

from bluerov_slam.errors import ConfigError
from bluerov_slam.simulation.acoustic_paths import Reflector
from bluerov_slam.simulation.acoustic_record import AcousticSetup, Tolerances
from bluerov_slam.simulation.acoustic_setup import acoustic_setup_from_mapping


def test_nothing_said_is_the_thesis_s_bench():
    setup = acoustic_setup_from_mapping({})
    usual = AcousticSetup(setup.array)
    assert setup == usual
    assert np.allclose(setup.array.sample_skew_s, [0.0, 0.42e-6, 0.0, 0.42e-6])


def test_tables_reach_into_every_part():
    setup = acoustic_setup_from_mapping(
        {
            "array": {"positions_m": [[0, 0, 0], [0, 1, 0], [0, 0, 1]], "sample_skew_s": [0, 0, 0]},
            "medium": {"sound_speed_mps": 1500, "spreading": False},
            "reflectors": [{"normal": [0, 0, 1], "distance_m": 2, "coefficient": 0.3}],
            "tolerances": {"receiver_resonance": 0.01},
            "trigger": {"threshold_counts": 20},
            "bits": [1, 0, 1],
            "snr_db": 7,
            "receiver_set": 4,
        }
    )
    assert len(setup.array) == 3
    assert (setup.medium.sound_speed_mps, setup.medium.spreading) == (1500.0, False)
    assert setup.reflectors == (Reflector((0.0, 0.0, 1.0), 2.0, 0.3),)
    assert setup.tolerances == Tolerances(receiver_resonance=0.01)
    assert (setup.trigger.threshold_counts, setup.bits, setup.snr_db, setup.receiver_set) == (20.0, (1, 0, 1), 7.0, 4)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"snr": 3}, "unknown key 'snr'"),
        ({"medium": {"speed": 3}}, "unknown key 'medium.speed'"),
        ({"medium": 3}, "medium must be a table"),
        ({"snr_db": "loud"}, "snr_db must be a float"),
        ({"quantised": 1}, "quantised must be a bool"),
        ({"receiver_set": True}, "receiver_set must be a int"),
        ({"carrier_hz": [40000]}, "carrier_hz must be a list of 2"),
        ({"carrier_hz": [40000, 39000]}, "carrier_hz must rise"),
        ({"reflectors": [{"normal": [0, 0], "distance_m": 1, "coefficient": 1}]}, r"reflectors\[0\].normal must be"),
        ({"reflectors": [{"normal": [0, 0, 1]}]}, "missing 2 required"),
        ({"window": {"mode": "late"}}, "window.mode must be one of"),
        ({"window": {"pre_trigger": 4000}}, r"window.pre_trigger must be 0\.\.2047"),
        ({"array": {"positions_m": [[0, 0, 0], [0, 0, 0], [0, 0, 1]]}}, "array: .*receivers 0 and 1"),
        ({"array": {"arms": 4}}, "array must be a table with keys"),
    ],
)
def test_a_mistake_is_named(values, message):
    with pytest.raises(ConfigError, match=message):
        acoustic_setup_from_mapping(values)
