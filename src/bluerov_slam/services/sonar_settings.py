"""A sonar's settings as the page knows them: limits, arithmetic, the frames that set them, what the sonar reads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from bluerov_slam.errors import CommandError, ConfigError
from bluerov_slam.protocol.kogger import (
    ChartSetup,
    Dataset,
    DatasetMask,
    Dsp,
    KoggerId,
    SonarSetting,
    SoundSpeed,
    Transceiver,
    check_period,
)

Value: TypeAlias = "int | float | bool"
Asked: TypeAlias = dict[str, Value]
Read: TypeAlias = "dict[str, Value | None]"

# What a person may ask for; the sonar itself takes a little more. The speeds are those of water.
LIMITS: dict[str, tuple[float, float]] = {
    "range_m": (0.1, 200.0),
    "samples": (10, 15000),
    "resolution_mm": (10, 1000),
    "first_sample": (0, 10000),
    "period_ms": (10, 60000),
    "frequency_khz": (40, 6000),
    "pulses": (1, 255),
    "boost": (0, 1),
    "sound_speed_mps": (1350.0, 1750.0),
    "smoothing": (0, 4),
}
UNITS = {
    "range_m": "m",
    "resolution_mm": "mm",
    "period_ms": "ms",
    "frequency_khz": "kHz",
    "sound_speed_mps": "m/s",
}
_WHOLE = frozenset(LIMITS) - {"range_m", "sound_speed_mps", "boost"}
_CHART = frozenset({"range_m", "samples", "resolution_mm", "first_sample"})
_TIMING = _CHART | {"period_ms", "sound_speed_mps"}
_TRANSMITTER = frozenset({"frequency_khz", "pulses", "boost"})
DEFAULT_SOUND_SPEED_MPS = 1500.0
# The output slot that carries echograms unless the sonar says otherwise.
DEFAULT_SLOT = 1
READ_IDS = (
    KoggerId.CHART_SETUP,
    KoggerId.DATASET,
    KoggerId.TRANSCEIVER,
    KoggerId.SOUND_SPEED,
    KoggerId.DSP,
)


@dataclass(frozen=True, slots=True)
class SonarSettings:
    """What a sonar said about itself; None where it has not said."""

    chart: ChartSetup | None = None
    dataset: Dataset | None = None
    transceiver: Transceiver | None = None
    sound_speed: SoundSpeed | None = None
    dsp: Dsp | None = None

    @property
    def is_timing_known(self) -> bool:
        """Range and period can be checked against each other."""
        return self.chart is not None and self.dataset is not None

    def as_read(self) -> Read:
        """The page's keys and units."""
        read: Read = dict.fromkeys(LIMITS)
        if self.chart is not None:
            read["samples"] = self.chart.sample_count
            read["resolution_mm"] = self.chart.resolution_mm
            read["first_sample"] = self.chart.first_sample
            read["range_m"] = self.chart.range_m
        if self.dataset is not None:
            read["period_ms"] = self.dataset.period_ms
        if self.transceiver is not None:
            read["frequency_khz"] = self.transceiver.frequency_khz
            read["pulses"] = self.transceiver.pulse_count
            read["boost"] = self.transceiver.boost
        if self.sound_speed is not None:
            read["sound_speed_mps"] = self.sound_speed.sound_speed_mps
        if self.dsp is not None:
            read["smoothing"] = self.dsp.smoothing
        return read


def check_asked(body: Mapping[str, object]) -> Asked:
    """The settings of a request with their types and limits checked. Raises ConfigError naming key and range."""
    asked: Asked = {}
    for key, value in body.items():
        if key not in LIMITS:
            raise ConfigError(f"{key}: unknown setting; known are {', '.join(LIMITS)}")
        asked[key] = _checked(key, value)
    if not asked:
        raise ConfigError(f"nothing asked; known settings are {', '.join(LIMITS)}")
    return asked


def merge_asked(older: Asked, newer: Asked) -> Asked:
    """Both requests as one, the newer winning also where range, samples and resolution exclude each other."""
    trio = {"range_m", "samples", "resolution_mm"}
    merged = {**older, **newer}
    if trio <= merged.keys():
        for key in trio - newer.keys():
            if trio <= merged.keys():
                del merged[key]
    return merged


def plan(asked: Asked, current: SonarSettings) -> list[tuple[KoggerId, bytes]]:
    """The SETTING frames that bring `current` to what is asked, in a safe order.

    Raises ConfigError for values that do not fit together, CommandError (with the arithmetic) when a ping would not fit
    into its period.
    """
    chart = _chart(asked, current.chart)
    dataset = _dataset(asked, current.dataset)
    _check_period(chart or current.chart, dataset or current.dataset, asked, current)
    settings: list[SonarSetting] = []
    if "sound_speed_mps" in asked:
        settings.append(SoundSpeed(float(asked["sound_speed_mps"])))
    if chart is not None:
        settings.append(chart)
    if dataset is not None:
        # A longer period goes out before the longer range that needs it, a shorter one after the shorter range.
        longer = current.dataset is None or dataset.period_ms > current.dataset.period_ms
        settings.insert(0 if longer else len(settings), dataset)
    transceiver = _transceiver(asked, current.transceiver)
    if transceiver is not None:
        settings.append(transceiver)
    if "smoothing" in asked:
        settings.append(Dsp(int(asked["smoothing"])))
    return [(setting.frame_id, setting.set_frame()) for setting in settings]


def differences(asked: Asked, read: Read) -> list[str]:
    """What the sonar reads other than asked, in words; range and resolution within one sample are equal."""
    found = []
    for key, wanted in asked.items():
        value = read.get(key)
        unit = UNITS.get(key, "")
        if value is None:
            found.append(f"{key}: asked {wanted:g} {unit}".rstrip() + ", not read back")
        elif abs(float(value) - float(wanted)) > _tolerance(key, read):
            found.append(f"{key}: asked {wanted:g} {unit}".rstrip() + f", the sonar reads {value:g} {unit}".rstrip())
    return found


def _checked(key: str, value: object) -> Value:
    low, high = LIMITS[key]
    if key == "boost":
        if value in (True, False, 0, 1):
            return bool(value)
        raise ConfigError(f"boost {value!r}: expected true or false")
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigError(f"{key} {value!r}: expected a number from {low:g} to {high:g} {UNITS.get(key, '')}".rstrip())
    if not low <= value <= high:
        raise ConfigError(f"{key} {value:g}: expected {low:g} to {high:g} {UNITS.get(key, '')}".rstrip())
    if key in _WHOLE:
        if value != int(value):
            raise ConfigError(f"{key} {value:g}: expected a whole number")
        return int(value)
    return value


def _check_period(chart: ChartSetup | None, dataset: Dataset | None, asked: Asked, current: SonarSettings) -> None:
    if chart is None or dataset is None or not asked.keys() & _TIMING:
        return
    speed_mps = current.sound_speed.sound_speed_mps if current.sound_speed else DEFAULT_SOUND_SPEED_MPS
    check_period(dataset.period_ms, chart, float(asked.get("sound_speed_mps", speed_mps)))


def _chart(asked: Asked, current: ChartSetup | None) -> ChartSetup | None:
    if not asked.keys() & _CHART:
        return None
    first = int(asked.get("first_sample", current.first_sample if current else 0))
    resolution_mm = asked.get("resolution_mm", current.resolution_mm if current else None)
    samples = asked.get("samples", current.sample_count if current else None)
    if "range_m" in asked:
        range_mm = float(asked["range_m"]) * 1000
        if "samples" in asked and "resolution_mm" not in asked:
            # The range counts from the sonar, so what is skipped before the first sample belongs to it.
            resolution_mm = max(1, round(range_mm / (first + int(asked["samples"]))))
        elif resolution_mm is not None:
            counted = round(range_mm / resolution_mm) - first
            samples = asked.get("samples", counted)
            if abs(int(samples) - counted) > 1:
                raise ConfigError(
                    f"{range_mm / 1000:g} m, {samples} samples and {resolution_mm} mm do not fit together: "
                    f"{range_mm:g} mm / {resolution_mm} mm = {counted + first} samples; give two of the three"
                )
    if resolution_mm is None or samples is None:
        raise CommandError(
            "the sonar's samples and resolution are not known yet: give two of range, samples, resolution"
        )
    return _fitting(ChartSetup(int(samples), int(resolution_mm), first))


def _fitting(chart: ChartSetup) -> ChartSetup:
    values = {"samples": chart.sample_count, "resolution_mm": chart.resolution_mm, "range_m": chart.range_m}
    for key, value in values.items():
        low, high = LIMITS[key]
        if not low <= value <= high:
            raise ConfigError(
                f"a range of {chart.range_m:g} m needs {chart.sample_count} samples of {chart.resolution_mm} mm, "
                f"but {key} must be {low:g} to {high:g}: choose another range or resolution"
            )
    return chart


def _dataset(asked: Asked, current: Dataset | None) -> Dataset | None:
    if "period_ms" not in asked:
        return None
    slot = current.channel if current and current.channel else DEFAULT_SLOT
    outputs = current.mask if current else DatasetMask(0)
    return Dataset(slot, int(asked["period_ms"]), outputs | DatasetMask.CHART)


def _transceiver(asked: Asked, current: Transceiver | None) -> Transceiver | None:
    if not asked.keys() & _TRANSMITTER:
        return None
    if current is None:
        if not asked.keys() >= _TRANSMITTER:
            raise CommandError("the sonar's transmitter setting is not known yet: give frequency, pulses and boost")
        current = Transceiver(0, 0, False)
    return Transceiver(
        int(asked.get("frequency_khz", current.frequency_khz)),
        int(asked.get("pulses", current.pulse_count)),
        bool(asked.get("boost", current.boost)),
    )


def _tolerance(key: str, read: Read) -> float:
    if key == "range_m":
        return float(read.get("resolution_mm") or 0) / 1000 * 0.51 + 1e-9
    return 0.0006 if key == "sound_speed_mps" else 1e-9
