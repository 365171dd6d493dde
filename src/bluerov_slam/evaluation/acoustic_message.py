"""I9: how many message frames come through, against the signal to noise ratio. Simulated.

Frames go through the simulator's transmitter, way, mismatched receivers and noise at an eighth of the board's sample
rate; the signal to noise ratio is stated as the board's full rate has it in the positioning window (power per sample),
so that it is the axis of the timing cells, too. Beside each measured cell stand the modulation's own bit error rate at
that energy and the packet errors of an ideal receiver that knows amplitude, phase and timing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.message.coding import coded_bits, decode, encode
from bluerov_slam.acoustics.message.demodulation import demodulate
from bluerov_slam.acoustics.message.frame import MESSAGE_FRAME_BITS, message_frame_bits
from bluerov_slam.acoustics.message.report import PAYLOAD_BYTES, BeaconReport
from bluerov_slam.acoustics.message.theory import bit_error_rate, energy_to_noise
from bluerov_slam.acoustics.pulse_train import STEPS_PER_BIT
from bluerov_slam.evaluation.acoustic_cases import AcousticCase, AcousticJob, share_row
from bluerov_slam.evaluation.navigation_table import Row
from bluerov_slam.evaluation.statistics import Interval
from bluerov_slam.simulation.acoustic_paths import Reflector, floor_below
from bluerov_slam.simulation.acoustic_record import SAMPLE_RATE_HZ, AcousticSetup, Tolerances, Window, simulate_records

_DECIMATION = 8
_BIT_S = STEPS_PER_BIT / 2.0 / 39_825.0
_BATCH = 25
_SOURCE_M = (2.0, 0.3, 0.1)

SNRS_DB = ("0", "-5", "-10", "-14", "-16", "-18", "-20", "-22")
ECHO_CELL = "0 echo"
_ECHO = (floor_below(0.66, 0.5),)
_POSITIONING_SNRS_DB = ("0", "-5", ECHO_CELL)
"""Where positioning still slips in at most 1 % of the pulses (I1): there the message must come through, too."""


@dataclass(frozen=True, slots=True)
class MessageCell:
    """Frames at one signal to noise ratio (dB, per sample at the board's full rate)."""

    snr_db: float
    energy_to_noise_db: float
    frames: int
    lost: int
    bits_wrong: int
    bit_error_rate_in_theory: float
    lost_by_ideal_receiver: int


def message_cell(snr_db: float, frames: int, seed: int, reflectors: tuple[Reflector, ...] = ()) -> MessageCell:
    """Send this many frames, each with its own message, and count what comes through."""
    rng = np.random.default_rng([seed, 0x3E55])
    energy = energy_to_noise(snr_db, _BIT_S * SAMPLE_RATE_HZ, 4)
    lost = wrong = 0
    for batch in range(-(-frames // _BATCH)):
        payload = _some_report(rng)
        bits = message_frame_bits(int(rng.integers(256)), payload)
        setup = AcousticSetup(
            ReceiverArray.cross(),
            sample_rate_hz=SAMPLE_RATE_HZ / _DECIMATION,
            reflectors=reflectors,
            bits=bits,
            tolerances=Tolerances(receiver_resonance=0.01, filter_corner=0.1),
            snr_db=_frame_snr_db(snr_db, bits),
            window=Window("onset", 19_500, 600),
        )
        draws = min(_BATCH, frames - batch * _BATCH)
        records = simulate_records(setup, np.tile(_SOURCE_M, (draws, 1)), seed * 1000 + batch)
        for samples in records.samples:
            frame = demodulate(samples, records.sample_rate_hz)
            lost += frame is None or frame.payload != payload
            wrong += MESSAGE_FRAME_BITS // 2 if frame is None else int(np.count_nonzero(frame.hard_bits != bits))
    return MessageCell(
        snr_db,
        10.0 * math.log10(energy),
        frames,
        lost,
        wrong,
        bit_error_rate(energy),
        _ideal_losses(energy, frames, rng),
    )


def _frame_snr_db(snr_db: float, bits: tuple[int, ...]) -> float:
    """The simulator's ratio: over the whole record, half of which is silent zeros, at an eighth of the samples."""
    share = sum(bits) * _BIT_S * SAMPLE_RATE_HZ / _DECIMATION / 19_500
    return snr_db + 10.0 * math.log10(_DECIMATION * share)


def _some_report(rng: np.random.Generator) -> bytes:
    return BeaconReport(
        latitude_deg=float(rng.uniform(-80.0, 80.0)),
        longitude_deg=float(rng.uniform(-180.0, 180.0)),
        horizontal_std_m=float(rng.uniform(0.5, 10.0)),
        time_mark_us=int(rng.integers(3_600_000_000)),
        depth_m=float(rng.uniform(0.5, 5.0)),
    ).pack()


def _ideal_losses(energy: float, frames: int, rng: np.random.Generator) -> int:
    """Payloads lost by a receiver that knows everything but the bits: Gaussian statistic of distance sqrt(E/(2 N0))."""
    lost = 0
    for _ in range(frames):
        payload = rng.bytes(PAYLOAD_BYTES)
        signs = 2.0 * encode(payload) - 1.0
        received = signs * math.sqrt(energy / 2.0) + rng.standard_normal(coded_bits(PAYLOAD_BYTES))
        lost += decode(received)[0] != payload
    return lost


def run(job: AcousticJob, material: Mapping[str, bytes]) -> MessageCell:
    """One block of frames of one cell."""
    return message_cell(float(job.cell.split()[0]), job.draws, job.seed, _ECHO if job.cell == ECHO_CELL else ())


def rows(cells: Mapping[str, Sequence[MessageCell]]) -> list[Row]:
    """Per cell: lost frames, and beside them those of the ideal receiver and both bit error rates."""
    made: list[Row] = []
    for cell, found in cells.items():
        if not found:
            continue
        frames = sum(each.frames for each in found)
        name = f"{cell} dB" if cell != ECHO_CELL else "0 dB, floor echo 0.5"
        place = f"I9.{cell.replace(' ', '.')}"
        must = 1.0 if cell in _POSITIONING_SNRS_DB else None
        made.append(share_row(f"{place}.lost", f"{name}: frames lost", _flags(found, "lost", frames), must))
        if cell == ECHO_CELL:
            continue
        ideal = _flags(found, "lost_by_ideal_receiver", frames)
        made.append(share_row(f"{place}.ideal", f"{name}: frames lost by an ideal receiver", ideal))
        wrong = 100.0 * sum(each.bits_wrong for each in found) / (frames * MESSAGE_FRAME_BITS)
        theory = 100.0 * found[0].bit_error_rate_in_theory
        made.append(Row(f"{place}.bits", f"{name}: bits wrong before correction", _plain(wrong), "%"))
        made.append(
            Row(f"{place}.theory", f"{name}: bits wrong in theory (coherent on-off keying)", _plain(theory), "%")
        )
    return made


def _flags(found: Sequence[MessageCell], name: str, frames: int) -> NDArray[np.bool_]:
    total: int = sum(getattr(each, name) for each in found)
    return np.arange(frames) < total


def _plain(value: float) -> Interval:
    return Interval(value, math.nan, math.nan)


CASES = (AcousticCase("I9", "Message frames (simulated)", (*SNRS_DB, ECHO_CELL), run, rows),)
