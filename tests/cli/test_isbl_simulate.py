import json

import numpy as np
import pytest
from click.testing import CliRunner

from bluerov_slam.acoustics.message.demodulation import demodulate
from bluerov_slam.acoustics.message.report import BeaconReport
from bluerov_slam.cli.main import cli
from bluerov_slam.errors import ConfigError, RecordingError
from bluerov_slam.sources.acoustic_records import read_acoustic_records


def run(*arguments):
    result = CliRunner().invoke(cli, ["isbl", "simulate", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_every_format_holds_the_same_records(tmp_path):
    options = ("--records", 2, "--seed", 7, "--scatter", 0.2, "--floor", 0.66, "--mismatch", 0.01)
    run(tmp_path / "a.npz", *options)
    run(tmp_path / "a.mcap", *options)
    written = run(tmp_path / "a.wav", *options)
    assert written.split() == [str(tmp_path / name) for name in ("a-000.wav", "a-001.wav", "a.wav.truth.json")]
    npz = read_acoustic_records(tmp_path / "a.npz")
    mcap = read_acoustic_records(tmp_path / "a.mcap")
    wav = [read_acoustic_records(tmp_path / f"a-00{number}.wav")[0] for number in range(2)]
    for number in range(2):
        assert npz[number].samples.shape == (4, 2048)
        assert np.array_equal(npz[number].samples, mcap[number].samples)
        assert np.array_equal(npz[number].samples, wav[number].samples)
    truth = json.loads((tmp_path / "a.wav.truth.json").read_text())
    with np.load(tmp_path / "a.npz") as file:
        assert file["true_delays_s"].tolist() == truth["delays_s"]
        assert file["true_source_m"].shape == (2, 3)


def test_a_message_frame_can_be_read_back(tmp_path):
    run(tmp_path / "message.wav", "--message", "47.6123,-2.7456,2.5", "--medium", "sea", "--source", "20,3,2")
    (record,) = read_acoustic_records(tmp_path / "message.wav")
    heard = demodulate(record.samples.astype(float), record.sample_rate_hz)
    report = BeaconReport.unpack(heard.payload)
    assert (report.latitude_deg, report.longitude_deg, report.depth_m) == (47.6123, -2.7456, 2.5)


def test_an_existing_file_is_kept_unless_forced(tmp_path):
    run(tmp_path / "a.npz")
    with pytest.raises(RecordingError, match="exists already"):
        run(tmp_path / "a.npz")
    run(tmp_path / "a.npz", "--force")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.txt"], "must end in one of"),
        (["a.npz", "--source", "1,2"], "not three numbers"),
        (["a.npz", "--source", "1,2,x"], "--source"),
        (["a.npz", "--message", "147,0,1"], "latitude 147"),
    ],
)
def test_a_wrong_option_is_named(tmp_path, arguments, message):
    with pytest.raises(ConfigError, match=message):
        run(tmp_path / arguments[0], *arguments[1:])


def test_a_set_up_comes_from_a_file(tmp_path):
    setup = tmp_path / "water.toml"
    setup.write_text(
        "snr_db = 25\ncarrier_hz = [39800, 39800]\n[array]\narm_m = 0.4\ncentre = true\n"
        "[medium]\nsound_speed_mps = 1490\nabsorption_db_per_m = 0.01\n"
        "[[reflectors]]\nnormal = [0, 0, -1]\ndistance_m = 3\ncoefficient = -0.5\n"
        '[window]\nmode = "ring"\nsamples = 1500\npre_trigger = 300\n'
    )
    run(tmp_path / "a.npz", "--setup", setup, "--source", "20,0,0")
    (record,) = read_acoustic_records(tmp_path / "a.npz")
    assert record.samples.shape == (5, 1500)
    assert record.trigger_index == 300
    with np.load(tmp_path / "a.npz") as file:
        assert file["true_carrier_hz"].tolist() == [39800.0]
        distance_m = np.hypot(20.0, 0.4)
        assert file["true_delays_s"][0, 3] == pytest.approx((distance_m - 20.0) / 1490.0)
    with pytest.raises(ConfigError, match="cannot be read as TOML"):
        run(tmp_path / "b.npz", "--setup", tmp_path / "none.toml")
