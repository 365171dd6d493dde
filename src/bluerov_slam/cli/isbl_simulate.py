"""`bluerov-slam isbl simulate`: records that an acoustic receiver would take, with their truth."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.absorption import air_absorption_db_per_m, sea_absorption_db_per_m
from bluerov_slam.acoustics.array import THESIS_RANK_SKEW_S, ReceiverArray
from bluerov_slam.acoustics.message.frame import message_frame_bits
from bluerov_slam.acoustics.message.report import BeaconReport
from bluerov_slam.errors import ConfigError, RecordingError
from bluerov_slam.records import AcousticRecord
from bluerov_slam.simulation.acoustic_paths import Medium, floor_below
from bluerov_slam.simulation.acoustic_record import (
    AcousticSetup,
    SimulatedRecords,
    Tolerances,
    Window,
    simulate_records,
)
from bluerov_slam.simulation.acoustic_setup import acoustic_setup_from_mapping
from bluerov_slam.sinks.acoustic_records import write_mcap, write_npz, write_wav
from bluerov_slam.sinks.whole_output import in_whole

FORMATS = (".npz", ".wav", ".mcap")
MESSAGE_RATE_HZ = 275.0e6 / 323 / 8
MESSAGE_SAMPLES = 19_200
_MEDIA = {
    "air": Medium(343.0, air_absorption_db_per_m(40_000.0)),
    "sea": Medium(1500.0, sea_absorption_db_per_m(40_000.0)),
    "fresh": Medium(1480.0, sea_absorption_db_per_m(40_000.0, 18.0, 0.0)),
}


def three_numbers(text: str) -> tuple[float, float, float]:
    """Three numbers with commas. Raises ValueError."""
    try:
        first, second, third = (float(part) for part in text.split(","))
    except ValueError:
        first = second = third = math.nan
    if not (math.isfinite(first) and math.isfinite(second) and math.isfinite(third)):
        raise ValueError(f"'{text}' is not three numbers with commas")
    return first, second, third


@click.command("simulate")
@click.argument("output", type=click.Path(path_type=Path))
@click.option("--source", default="2.6,0.3,-0.2", show_default=True, help="Forward, right, down of the array, m.")
@click.option("--scatter", default=0.0, show_default=True, type=click.FloatRange(0.0), help="Spread of the source, m.")
@click.option("--records", "count", default=1, show_default=True, type=click.IntRange(1, 100_000))
@click.option("--medium", type=click.Choice(tuple(_MEDIA)), default="air", show_default=True)
@click.option("--snr", "snr_db", default=20.0, show_default=True, help="Signal to noise power in the record, dB.")
@click.option("--fifth", is_flag=True, help="A fifth receiver in the middle of the cross.")
@click.option("--arm", "arm_m", default=0.25, show_default=True, type=click.FloatRange(0.01, 10.0), help="m.")
@click.option("--floor", "floor_m", type=click.FloatRange(0.0, min_open=True), help="A floor so far below, m.")
@click.option("--echo", default=0.5, show_default=True, help="What of the amplitude the floor returns.")
@click.option("--mismatch", default=0.0, show_default=True, help="Spread of the receivers' resonances, 0.01 is 1 %.")
@click.option("--filters", default=0.0, show_default=True, help="Spread of the filters' corners, 0.1 is 10 %.")
@click.option("--receiver-set", type=int, help="Number of one set of receivers for all records [default: new each].")
@click.option("--onset", is_flag=True, help="Keep 448 samples before the trigger; the thesis's board has none.")
@click.option("--clip", is_flag=True, help="A signal too strong for the converter.")
@click.option("--message", help="LATITUDE,LONGITUDE,DEPTH: whole message frames at 106 kHz instead of pulses.")
@click.option(
    "--setup",
    "setup_file",
    type=click.Path(path_type=Path),
    help="A TOML file with every figure of the set-up (docs/acoustics-simulation.md), in place of the options from "
    "--medium to --clip.",
)
@click.option("--seed", default=1, show_default=True)
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
def command(
    output: Path,
    source: str,
    scatter: float,
    count: int,
    medium: str,
    snr_db: float,
    fifth: bool,
    arm_m: float,
    floor_m: float | None,
    echo: float,
    mismatch: float,
    filters: float,
    receiver_set: int | None,
    onset: bool,
    clip: bool,
    message: str | None,
    setup_file: Path | None,
    seed: int,
    force: bool,
) -> None:
    """Simulate records of pulses into OUTPUT: NPZ or MCAP hold all of them, WAV one (more become NAME-001.wav ...).

    The truth is in the NPZ under names that begin with true_, beside WAV and MCAP in OUTPUT.truth.json. All of it is
    simulated: the thesis's transmitter, receivers, trigger and converter (docs/acoustics.md).
    """
    if output.suffix.lower() not in FORMATS:
        raise ConfigError(f"{output} must end in one of {', '.join(FORMATS)}")
    try:
        place_m = three_numbers(source)
    except ValueError as error:
        raise ConfigError(f"--source: {error}") from error
    skew_s = [THESIS_RANK_SKEW_S * (receiver % 2) for receiver in range(5 if fifth else 4)]
    setup = AcousticSetup(
        array=ReceiverArray.cross(arm_m, fifth, skew_s),
        medium=_MEDIA[medium],
        reflectors=() if floor_m is None else (floor_below(floor_m, echo),),
        tolerances=Tolerances(receiver_resonance=mismatch, filter_corner=filters),
        receiver_set=receiver_set,
        snr_db=snr_db,
        peak_counts=4000.0 if clip else 800.0,
        window=Window("ring", 2048, 448) if onset else Window(),
    )
    if setup_file is not None:
        setup = _read_setup(setup_file)
    if message is not None:
        setup = _with_message(setup, message)
    sources_m = np.array(place_m) + scatter * np.random.default_rng([seed, 0x5CA7]).standard_normal((count, 3))
    simulated = simulate_records(setup, sources_m, seed)
    missed = int((~simulated.triggered).sum())
    if missed:
        click.echo(f"{missed} of {count} records: the pulse is too weak to trip the trigger; they hold noise", err=True)
    for path in _write(output, simulated, setup.bits_per_sample, force):
        click.echo(f"{path}")


def _read_setup(path: Path) -> AcousticSetup:
    try:
        return acoustic_setup_from_mapping(tomllib.loads(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{path} cannot be read as TOML: {error}") from error


def _with_message(setup: AcousticSetup, message: str) -> AcousticSetup:
    try:
        latitude_deg, longitude_deg, depth_m = three_numbers(message)
        payload = BeaconReport(latitude_deg, longitude_deg, 1.0, 0, depth_m).pack()
    except ValueError as error:
        raise ConfigError(f"--message: {error}") from error
    return replace(
        setup,
        sample_rate_hz=MESSAGE_RATE_HZ,
        window=Window("onset", MESSAGE_SAMPLES, 64),
        bits=message_frame_bits(1, payload),
    )


def _write(output: Path, simulated: SimulatedRecords, bits: int, force: bool) -> list[Path]:
    """Write everything; the paths that were written."""
    records = [
        AcousticRecord(
            measured_s=float(number),
            arrived_s=number + 0.05,
            record_id=number,
            sample_rate_hz=simulated.sample_rate_hz,
            samples=samples.astype(np.int16),
            bits=bits,
            trigger_index=simulated.trigger_index,
        )
        for number, samples in enumerate(simulated.samples)
    ]
    truth: dict[str, NDArray[np.generic]] = {
        "source_m": simulated.sources_m,
        "toa_s": simulated.toa_s,
        "delays_s": simulated.delays_s,
        "snr_db": simulated.snr_db,
        "carrier_hz": simulated.carrier_hz,
        "receiver_hz": simulated.receiver_hz,
        "triggered": simulated.triggered,
    }
    if output.suffix.lower() == ".npz":
        paths = [output]
    else:
        paths = [output]
        if output.suffix.lower() == ".wav" and len(records) > 1:
            paths = [output.with_name(f"{output.stem}-{number:03d}.wav") for number in range(len(records))]
        paths.append(output.with_name(f"{output.name}.truth.json"))
    for path in paths:
        if path.exists() and not force:
            raise RecordingError(f"{path} exists already: choose another name, or add --force to replace it")
    for number, path in enumerate(paths):
        try:
            with in_whole(path) as unfinished:
                if path.suffix == ".json":
                    unfinished.write_text(json.dumps({name: v.tolist() for name, v in truth.items()}) + "\n")
                elif path.suffix.lower() == ".npz":
                    write_npz(unfinished, records, truth)
                elif path.suffix.lower() == ".wav":
                    write_wav(unfinished, records[number])
                else:
                    write_mcap(unfinished, records, {"source": "bluerov-slam isbl simulate", "simulated": "true"})
        except OSError as error:
            raise RecordingError(f"cannot write {path}: {error.strerror or error}; choose another place") from error
    return paths
