"""How true compressed pings are at equal wire bytes: a real side-scan recording through the packer and the decoder.

The recording (1024 bins of 29.3 mm a side) is resampled to 1000 bins of 30 mm by area and scaled to 8 bits: linear, and
square root, full scale being the largest amplitude of its first half. Everything that coding 2 has of tuning was chosen
on that half; what is scored here is the second half. Means and peaks of four are held over their samples.

A peak is a bin that is higher than both neighbours, the highest of five, at least 6 dB above the median of the 41 bins
(1.2 m) around it and at least 1/16 of full scale. Its error is that of the decoded amplitude in the same bin, in dB of
amplitude in both scales.

`python -m bench.coding` adds the curve over the decimations.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.protocol.kogger_bundle import Bundle, Coding, compress_ping, expand
from bluerov_slam.protocol.ping_assembly import ChartChunk
from bluerov_slam.records import Channel
from bluerov_slam.sources.xtf import read_sides

DATA = Path(os.environ.get("BLUEROV_SLAM_DATA", Path(__file__).parents[2] / "shared" / "data"))
RECORDING = DATA / "sss_iver2_wreck" / "scotsman-iver2.xtf"
SAMPLES, RESOLUTION_MM, CHUNK_SAMPLES = 1000, 30, 200
DECIMATION = 4
PEAK_ABOVE_MEDIAN, PEAK_ABOVE_ZERO = 2.0, 1.0 / 16.0
PEAK_NEIGHBOURS, BACKGROUND_BINS = 5, 41
SCALES = {"linear": 1.0, "sqrt": 0.5}
SIDES = ("port", "starboard")
RMSE_GAIN_MUST_PERCENT, PEAK_MUST_DB = 15.0, 1.0

FloatArray = NDArray[np.float64]


class Image(NamedTuple):
    """One side of the second half of the recording in 8 bits."""

    levels: NDArray[np.uint8]
    exponent: float
    peaks: NDArray[np.bool_]


class Outcome(NamedTuple):
    """What came out of a coding."""

    rmse: float
    peak_errors_db: FloatArray
    wire_bytes: float


def images() -> dict[tuple[str, str], Image]:
    """The second half of both sides in both scales."""
    range_m, *sides = read_sides(RECORDING)
    found = {}
    for side, raw in zip(SIDES, sides, strict=True):
        bins = resampled(raw, range_m)
        first, second = bins[: len(bins) // 2], bins[len(bins) // 2 :]
        relative = np.minimum(second / first.max(), 1.0)
        for scale, exponent in SCALES.items():
            levels = np.rint(255.0 * relative**exponent).astype(np.uint8)
            found[side, scale] = Image(levels, exponent, peaks(relative))
    return found


def resampled(rows: FloatArray, range_m: float) -> FloatArray:
    """Every output bin is the mean of what it covers; the last reaches a little beyond the recording."""
    count = rows.shape[1]
    edges_m = np.arange(count + 1) * range_m / count
    wanted_m = np.minimum(np.arange(SAMPLES + 1) * RESOLUTION_MM / 1000.0, range_m)
    integral = np.pad(np.cumsum(rows, axis=1), ((0, 0), (1, 0))) * range_m / count
    at_edges = np.stack([np.interp(wanted_m, edges_m, row) for row in integral])
    return np.diff(at_edges, axis=1) / np.diff(wanted_m)


def peaks(amplitude: FloatArray) -> NDArray[np.bool_]:
    """Where the local peaks are."""

    def around(bins: int) -> FloatArray:
        padded = np.pad(amplitude, ((0, 0), (bins // 2, bins // 2)), mode="edge")
        return sliding_window_view(padded, bins, axis=1)

    beside = np.maximum(around(3)[..., 0], around(3)[..., 2])
    highest = around(PEAK_NEIGHBOURS).max(axis=-1)
    background = np.median(around(BACKGROUND_BINS), axis=-1)
    above = (amplitude >= PEAK_ABOVE_MEDIAN * background) & (amplitude >= PEAK_ABOVE_ZERO)
    return (amplitude > beside) & (amplitude == highest) & above


def outcome(image: Image, coding: Coding, decimation: int = DECIMATION) -> Outcome:
    """Every ping through packer and decoder."""
    decoded = np.empty_like(image.levels)
    wire_bytes = 0
    for ping, into in zip(image.levels, decoded, strict=True):
        data = ping.tobytes()
        chunks = [
            ChartChunk(at, RESOLUTION_MM, 0, data[at : at + CHUNK_SAMPLES]) for at in range(0, SAMPLES, CHUNK_SAMPLES)
        ]
        payloads = compress_ping(Channel.A, chunks, ping_number=0, t_us=0, decimation=decimation, coding=coding)
        wire_bytes += sum(len(encode_frame(MessageType.KOGGER_COMPRESSED, payload)) for payload in payloads)
        for payload in payloads:
            bundle = expand(payload)
            assert isinstance(bundle, Bundle)
            for chunk in bundle.chunks:
                into[chunk.seq_offset : chunk.seq_offset + len(chunk.samples)] = np.frombuffer(chunk.samples, np.uint8)
    sent, came = image.levels.astype(np.float64), decoded.astype(np.float64)
    ratio = np.maximum(came[image.peaks], 0.5) / sent[image.peaks]
    return Outcome(
        float(np.sqrt(np.mean((came - sent) ** 2))),
        np.abs(20.0 / image.exponent * np.log10(ratio)),
        wire_bytes / len(decoded),
    )


def rows() -> list[dict[str, object]]:
    """coding_rmse_linear, coding_rmse_sqrt, coding_peaks_db_linear, coding_peaks_db_sqrt, coding_wire_bytes."""
    if not RECORDING.exists():
        print(f"SKIP: coding needs {RECORDING} (set BLUEROV_SLAM_DATA)", file=sys.stderr)
        return []
    outcomes = {(*key, coding): outcome(image, coding) for key, image in images().items() for coding in list(Coding)}
    table = [_rmse_row(scale, outcomes) for scale in SCALES] + [_peak_row(scale, outcomes) for scale in SCALES]
    held, coded = ({o.wire_bytes for key, o in outcomes.items() if (key[2] is Coding.CODED) is is_coded}
                   for is_coded in (False, True))  # fmt: skip
    return [
        *table,
        {
            "id": "coding_wire_bytes",
            "name": f"Coded ping of {SAMPLES} samples on the wire",
            "value": max(coded),
            "unit": "bytes",
            "must": f"== {max(held):g}",
            "met": coded == held,
            "reference": "as means and peaks",
        },
    ]


_Outcomes = dict[tuple[str, str, Coding], Outcome]


def _rmse_row(scale: str, outcomes: _Outcomes) -> dict[str, object]:
    gains, beside = [], []
    for side in SIDES:
        mean, peak, coded = (outcomes[side, scale, coding].rmse for coding in Coding)
        gains.append(100.0 * (1.0 - coded / min(mean, peak)))
        beside.append(f"{side} {gains[-1]:.1f} %: RMSE {coded:.2f}, means {mean:.2f}, peaks {peak:.2f}")
    return {
        "id": f"coding_rmse_{scale}",
        "name": f"Coded pings, {scale}: lower RMSE than the better of means and peaks, worse side",
        "value": round(min(gains), 1),
        "unit": "%",
        "must": f">= {RMSE_GAIN_MUST_PERCENT:g}",
        "met": min(gains) >= RMSE_GAIN_MUST_PERCENT,
        "reference": "; ".join(beside),
    }


def _peak_row(scale: str, outcomes: _Outcomes) -> dict[str, object]:
    of = {c: np.concatenate([outcomes[side, scale, c].peak_errors_db for side in SIDES]) for c in Coding}
    of_side = {side: float(np.percentile(outcomes[side, scale, Coding.CODED].peak_errors_db, 95)) for side in SIDES}
    value = max(of_side.values())
    sides = ", ".join(f"{side} {error_db:.2f}" for side, error_db in of_side.items())
    medians = ", ".join(f"{coding.name.lower()} {np.median(errors):.2f}" for coding, errors in of.items())
    within = ", ".join(f"{coding.name.lower()} {100 * np.mean(e <= PEAK_MUST_DB):.1f}" for coding, e in of.items())
    return {
        "id": f"coding_peaks_db_{scale}",
        "name": f"Coded pings, {scale}: error of {of[Coding.CODED].size} local peaks, 95 % of them, worse side",
        "value": round(value, 2),
        "unit": "dB",
        "must": f"<= {PEAK_MUST_DB:g}",
        "met": value <= PEAK_MUST_DB,
        "reference": f"{sides}; medians: {medians}; % within {PEAK_MUST_DB:g} dB: {within}",
    }


def curve() -> list[str]:
    """RMSE over the decimations, and where 95 % of the coded peaks are."""
    lines = [
        "| image | decimation | bits per sample | means | coded | lower by % | peaks dB |",
        "|---|---|---|---|---|---|---|",
    ]
    for (side, scale), image in images().items():
        for decimation in range(2, 9):
            mean, coded = (outcome(image, coding, decimation) for coding in (Coding.MEAN, Coding.CODED))
            gain, peaks_db = 100.0 * (1.0 - coded.rmse / mean.rmse), np.percentile(coded.peak_errors_db, 95)
            lines.append(f"| {side} {scale} | {decimation} | {8 / decimation:.2f} | {mean.rmse:.2f} | {coded.rmse:.2f} "
                         f"| {gain:.1f} | {peaks_db:.2f} |")  # fmt: skip
    return lines


if __name__ == "__main__":
    for row in rows():
        print(json.dumps(row))
    if RECORDING.exists():
        print("\n".join(curve()))
