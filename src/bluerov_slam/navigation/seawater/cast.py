"""Collects the vehicle's own CTD samples and makes the nodes of a water column of them.

On the way down the sensors meet water that nobody has stirred; on the way up, and while hovering, they swim in the
vehicle's own wash. So each bin is made of the samples of the descents (there may be several), and of all others only
where no descent came through. Single wrong samples are taken out along time, where a sensor's neighbours tell; within a
bin the median stands for it, paired with the median pressure: a vehicle that hovers for an hour at the edge of a bin
moves neither the bin's middle nor its neighbours.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bluerov_slam.navigation.seawater.profile import ColumnNodes, ColumnOptions, WaterColumn

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bluerov_slam.records import CtdSample

    Array = NDArray[np.float64]

MOST_SAMPLES = 60_000
"""More than three hours at 5 Hz; then every other one is forgotten."""

_STD_PER_MAD = 1.4826
_STD_OF_MEDIAN = 1.2533
"""Of the median of n normal samples, in standard deviations of one over root n: sqrt(pi / 2)."""
_SPIKE_WINDOW = 7
_SPIKE_MADS = 6.0
# A spike smaller than these does no harm in a median.
_SPIKE_DEGC = 0.2
_SPIKE_PSU = 0.5
_SPIKE_PA = 5e3
_RATE_SPAN_S = 2.0
_LONGEST_RATE_SPAN_S = 10.0


class CtdCast:
    """The CTD samples of a dive in the order of their arrival: as many casts up and down as there were."""

    def __init__(self, options: ColumnOptions | None = None) -> None:
        self.options = options or ColumnOptions()
        self._rows: list[tuple[float, float, float, float]] = []
        self._last_s = -math.inf

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, at_s: float, sea_pressure_pa: float, temperature_degc: float, salinity_psu: float) -> bool:
        """Take a sample; False when it brings nothing: not a number, or at the time of the one before."""
        if not all(map(math.isfinite, (at_s, sea_pressure_pa, temperature_degc, salinity_psu))):
            return False
        # A clock that went back is a new beginning, not a reason to stop listening.
        if 0.0 <= at_s - self._last_s < self.options.sample_period_s:
            return False
        self._last_s = at_s
        self._rows.append((at_s, sea_pressure_pa, temperature_degc, salinity_psu))
        if len(self._rows) > MOST_SAMPLES:
            del self._rows[1::2]
        return True

    def add_ctd(self, sample: CtdSample, surface_pressure_pa: float | None = None) -> bool:
        """Take a record; False when it is incomplete. `surface_pressure_pa`: a better one than the record's."""
        if sample.pressure_pa is None or sample.temperature_degc is None or sample.salinity_psu is None:
            return False
        surface_pa = sample.surface_pressure_pa if surface_pressure_pa is None else surface_pressure_pa
        sea_pressure_pa = sample.pressure_pa - surface_pa
        return self.add(sample.measured_s, sea_pressure_pa, sample.temperature_degc, sample.salinity_psu)

    def rezero(self, sea_pressure_change_pa: float) -> None:
        """The surface pressure was found anew: all samples lie deeper by so much."""
        self._rows = [(at_s, pa + sea_pressure_change_pa, *water) for at_s, pa, *water in self._rows]  # type: ignore[misc]

    def column(self, latitude_deg: float) -> WaterColumn | None:
        """The column so far; None while no bin has samples enough.

        Raises OutOfValidityError when none of them lies where the formulas are valid.
        """
        nodes = column_nodes(np.array(self._rows, dtype=np.float64).reshape(-1, 4), self.options)
        return None if nodes is None else WaterColumn(nodes, latitude_deg, self.options)


def column_nodes(samples: Array, options: ColumnOptions) -> ColumnNodes | None:
    """Nodes of a column.

    Args:
        samples: (n, 4): s, Pa above the atmosphere's, degC, PSU, in the order of their arrival; all finite.
        options: bins and noises.

    Returns:
        None when no bin has samples enough.
    """
    spikes = np.zeros(len(samples), dtype=np.bool_)
    for column, harmless in ((1, _SPIKE_PA), (2, _SPIKE_DEGC), (3, _SPIKE_PSU)):
        spikes |= _spikes(samples[:, column], harmless)
    samples = samples[~spikes]
    descending = _descending(samples, options)
    bins = np.floor(samples[:, 1] / options.bin_pa)
    rows, kept = [], []
    for number in np.unique(bins[bins >= 0.0]):
        inside = bins == number
        down = inside & descending
        from_descent = int(np.count_nonzero(down)) >= options.samples_per_bin
        chosen = samples[down if from_descent else inside]
        if len(chosen) >= options.samples_per_bin:
            kept.append(chosen[:, 1])
            rows.append((*_node(chosen, options), len(chosen), from_descent))
    if not rows:
        return None
    table = np.array(rows, dtype=np.float64)
    return ColumnNodes(
        sea_pressure_pa=table[:, 0],
        temperature_degc=table[:, 1],
        salinity_psu=table[:, 2],
        temperature_std_degc=table[:, 3],
        salinity_std_psu=table[:, 4],
        samples=table[:, 5].astype(np.int64),
        descending=table[:, 6] > 0.0,
        shallowest_pa=float(np.min(kept[0])),
        deepest_pa=float(np.max(kept[-1])),
    )


def _node(chosen: Array, options: ColumnOptions) -> tuple[float, float, float, float, float]:
    """Median pressure, temperature and salinity, and the random errors of the last two."""
    middle = np.median(chosen[:, 1:], axis=0)
    scatter = _STD_PER_MAD * np.median(np.abs(chosen[:, 1:] - middle), axis=0)
    shrink = _STD_OF_MEDIAN / math.sqrt(len(chosen))
    temperature_std = shrink * max(float(scatter[1]), options.temperature_noise_degc)
    salinity_std = shrink * max(float(scatter[2]), options.salinity_noise_psu)
    return float(middle[0]), float(middle[1]), float(middle[2]), temperature_std, salinity_std


def _descending(samples: Array, options: ColumnOptions) -> NDArray[np.bool_]:
    """Whether the vehicle was on its way down, by the pressure some time before and after each sample."""
    count = len(samples)
    if count < 2:
        return np.zeros(count, dtype=np.bool_)
    steps_s = np.diff(samples[:, 0])
    step_s = float(np.median(steps_s[steps_s > 0.0])) if np.any(steps_s > 0.0) else math.inf
    half = int(np.clip(round(0.5 * _RATE_SPAN_S / step_s), 1, count - 1)) if math.isfinite(step_s) else 1
    before = np.maximum(np.arange(count) - half, 0)
    after = np.minimum(np.arange(count) + half, count - 1)
    span_s = samples[after, 0] - samples[before, 0]
    fallen_pa = samples[after, 1] - samples[before, 1]
    longest_s = max(_LONGEST_RATE_SPAN_S, 4.0 * step_s)
    down: NDArray[np.bool_] = (span_s > 0.0) & (span_s < longest_s) & (fallen_pa > options.descent_pa_per_s * span_s)
    return down


def _spikes(values: Array, harmless: float) -> NDArray[np.bool_]:
    """Samples far from the median of their neighbours in time (Hampel's filter)."""
    half = _SPIKE_WINDOW // 2
    if len(values) < _SPIKE_WINDOW:
        return np.zeros(len(values), dtype=np.bool_)
    padded = np.pad(values, half, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, _SPIKE_WINDOW)
    # The median of seven; `np.median` takes 25 times as long for so small windows.
    middle = np.partition(windows, half, axis=1)[:, half]
    scatter = _STD_PER_MAD * np.partition(np.abs(windows - middle[:, None]), half, axis=1)[:, half]
    far: NDArray[np.bool_] = np.abs(values - middle) > np.maximum(_SPIKE_MADS * scatter, harmless)
    return far
