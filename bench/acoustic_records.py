"""Simulated records and the recorder, each beside the plain way of doing the same."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.acoustics.array import ReceiverArray
from bluerov_slam.acoustics.pulse_train import drive_steps
from bluerov_slam.acoustics.recording import PulseRecorder, RecorderSettings
from bluerov_slam.simulation.acoustic_record import SAMPLE_RATE_HZ, AcousticSetup, Window, simulate_records

FloatArray = NDArray[np.float64]

SIMULATE_MUST_MS = 4.0
RECORD_MUST = 2.0
_DRAWS = 320
_OVERSAMPLING = 16
_PIECE = 4096


def rows() -> list[dict[str, object]]:
    """Both rows."""
    return [_simulation(), _recorder()]


def _simulation() -> dict[str, object]:
    setup = AcousticSetup(ReceiverArray.cross())
    sources_m = np.array([2.6, 0.3, -0.2]) + np.random.default_rng(1).normal(0.0, 0.2, (_DRAWS, 3))
    simulate_records(setup, sources_m[:64], 1)
    ours_ms = 1e3 * _best(lambda: simulate_records(setup, sources_m, 1)) / _DRAWS
    plain_ms = 1e3 * _best(lambda: _marched_record(sources_m[0], setup))
    return {
        "id": "acoustic.simulate",
        "name": "Simulated record, 4 receivers x 2048 samples, 320 in one go",
        "value": round(ours_ms, 2),
        "unit": "ms per record",
        "must": f"<= {SIMULATE_MUST_MS:g}",
        "met": ours_ms <= SIMULATE_MUST_MS,
        "reference": f"one receiver's filters marched in time at {_OVERSAMPLING} x the rate with scipy.signal.lfilter, "
        f"no noise, trigger or converter: {plain_ms:.1f} ms",
    }


def _marched_record(source_m: FloatArray, setup: AcousticSetup) -> FloatArray:
    """The same wave the plain way: steps at a high rate, filters in time, receivers by whole fine samples."""
    from scipy.signal import bilinear, lfilter

    rate_hz = _OVERSAMPLING * SAMPLE_RATE_HZ
    step_s = 0.5 / 39_825.0
    time_s = np.arange(int(3.6e-3 * rate_hz)) / rate_hz
    steps = drive_steps((1, 1, 1, 1, 0, 0, 0, 0)).astype(np.float64)
    wave = steps[np.minimum((time_s / step_s).astype(np.intp), len(steps) - 1)]
    chain = setup.chain
    for centre_hz, q in ((chain.transducer_hz, chain.transducer_q), (chain.receiver_hz, chain.receiver_q)):
        omega = 2.0 * np.pi * centre_hz
        wave = lfilter(*bilinear([omega / q, 0.0], [1.0, omega / q, omega**2], rate_hz), wave)
    low, high = 2.0 * np.pi * chain.band_low_hz, 2.0 * np.pi * chain.band_high_hz
    wave = lfilter(*bilinear([high, 0.0], np.polymul([1.0, low], [1.0, high]), rate_hz), wave)
    range_m = np.linalg.norm(source_m - setup.array.positions_m, axis=1)
    late = np.rint((range_m - range_m.min()) / 343.0 * rate_hz).astype(np.intp)
    first = int(0.3e-3 * rate_hz)
    taken = [wave[first - each : first - each + 2048 * _OVERSAMPLING : _OVERSAMPLING] for each in late + 1]
    return np.stack(taken)


def _recorder() -> dict[str, object]:
    """A stream with a pulse each quarter second, in pieces of a DMA buffer."""
    setup = AcousticSetup(ReceiverArray.cross(), snr_db=None, noise_counts=0.0, window=Window("onset", 9000, 0))
    pulse = simulate_records(setup, np.array([[2.6, 0.3, -0.2]]), 1).samples[0]
    rng = np.random.default_rng(2)
    stream = rng.normal(2048.0, 4.0, (4, int(SAMPLE_RATE_HZ)))
    for at in range(0, stream.shape[1] - 9000, stream.shape[1] // 4):
        stream[:, at : at + 9000] += pulse
    pieces = [stream[:, at : at + _PIECE] for at in range(0, stream.shape[1], _PIECE)]

    def record() -> None:
        recorder = PulseRecorder(RecorderSettings(pre_trigger_samples=448))
        for piece in pieces:
            recorder.feed(piece)
        assert recorder.records_accepted >= 4

    speed = stream.shape[1] / SAMPLE_RATE_HZ / _best(record)
    share = 64_000
    looped_s = _best(lambda: _thesis_loop(stream[:, :share]), 1)
    return {
        "id": "acoustic.record",
        "name": "Recorder on a stream of 4 receivers at 851 kHz",
        "value": round(speed, 1),
        "unit": "x real time",
        "must": f">= {RECORD_MUST:g}",
        "met": speed >= RECORD_MUST,
        "reference": "the trigger's loops as the thesis writes them, in Python: "
        f"{share / SAMPLE_RATE_HZ / looped_s:.2f} x",
    }


def _thesis_loop(stream: FloatArray) -> int:
    """Sample by sample: means of a block, then every window of five."""
    tripped = 0
    for at in range(0, stream.shape[1] - 63, 64):
        exceeding = 0
        for row in stream[:, at : at + 64].tolist():
            mean = 0.0
            for value in row:
                mean += value
            mean /= 64.0
            for window in range(59):
                count = 0
                for offset in range(5):
                    count += abs(row[window + offset] - mean) > 50.0
                if count == 5:
                    exceeding += 1
                    break
        tripped += exceeding > 1
    return tripped


def _best(action: Callable[[], object], times: int = 3) -> float:
    """Processor seconds of the fastest of some runs."""
    fastest = float("inf")
    for _ in range(times):
        begin = time.process_time()
        action()
        fastest = min(fastest, time.process_time() - begin)
    return fastest
