"""Scripted faults: what can go wrong on the bench and at sea, as data, and what it does to bytes on a wire."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from enum import StrEnum

import numpy as np

from bluerov_slam.errors import ConfigError


class FaultKind(StrEnum):
    """Every fault that a scenario can script."""

    BIT_ERRORS = "bit_errors"
    GARBAGE = "garbage"
    DROP = "drop"
    RESET = "reset"
    PROBE = "probe"
    UNPLUG = "unplug"
    SILENT = "silent"
    MID_PING = "mid_ping"
    I2C_ERRORS = "i2c_errors"


SENSORS = ("imu", "gps", "ec", "depth", "celsius", "a", "b")

# What `rate` means where it is not given: bit errors per bit, garbage bursts per second, lost bytes per byte,
# probes per second.
_DEFAULT_RATE = {
    FaultKind.BIT_ERRORS: 1.0e-4,
    FaultKind.GARBAGE: 5.0,
    FaultKind.DROP: 1.0e-3,
    FaultKind.PROBE: 2.0,
}
_MOMENTARY = (FaultKind.RESET, FaultKind.MID_PING)
_DEFAULT_DURATION_S = {FaultKind.UNPLUG: 3.0, FaultKind.PROBE: 1.0}


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: starts at `at_s` (virtual time) and lasts `duration_s`. `reason` is the ESP32's reset reason."""

    kind: FaultKind
    at_s: float
    duration_s: float = 0.0
    rate: float = 0.0
    size: int = 64
    sensor: str = ""
    reason: int = 1
    rename: bool = False

    @property
    def text(self) -> str:
        """What happens when, in words."""
        what = f"{self.kind} {self.sensor}".rstrip()
        lasting = "" if self.kind in _MOMENTARY else f" for {self.duration_s:g} s"
        return f"{what} at {self.at_s:g} s{lasting}"

    def active(self, at_s: float) -> bool:
        """Whether the fault is at work at this instant."""
        return self.at_s <= at_s < self.at_s + self.duration_s


def parse_fault(text: str) -> Fault:
    """A fault from `key=value` words, e.g. `at=10 kind=garbage duration=2 rate=5`."""
    values: dict[str, str] = {}
    for word in text.split():
        key, equals, value = word.partition("=")
        if not equals:
            raise ConfigError(f"fault '{text}': '{word}' is not key=value")
        values[key] = value
    return fault_from_mapping(values)


def fault_from_mapping(values: Mapping[str, object]) -> Fault:
    """A fault from a mapping with the keys kind, at, duration, rate, size, sensor, reason, rename."""
    known = {field.name.removesuffix("_s") for field in fields(Fault)}
    unknown = set(values) - known
    if unknown:
        raise ConfigError(f"fault: unknown key {', '.join(sorted(unknown))}; allowed: {', '.join(sorted(known))}")
    try:
        kind = FaultKind(str(values["kind"]))
        at_s = float(str(values["at"]))
        duration_s = float(str(values.get("duration", _DEFAULT_DURATION_S.get(kind, 5.0))))
        rate = float(str(values.get("rate", _DEFAULT_RATE.get(kind, 0.0))))
        size, reason = int(str(values.get("size", 64))), int(str(values.get("reason", 1)))
    except KeyError as error:
        raise ConfigError(f"fault: {error.args[0]} is missing; a fault needs kind=... and at=<seconds>") from error
    except ValueError as error:
        kinds = ", ".join(FaultKind)
        raise ConfigError(f"fault: {error}; kinds are {kinds}, the other values are numbers") from error
    sensor = str(values.get("sensor", "")).lower()
    _check_fault(kind, at_s, duration_s, rate, size, sensor)
    rename = str(values.get("rename", "0")).lower() in ("1", "true", "yes")
    return Fault(kind, at_s, duration_s, rate, size, sensor, reason, rename)


def _check_fault(kind: FaultKind, at_s: float, duration_s: float, rate: float, size: int, sensor: str) -> None:
    if not (0.0 <= at_s < 1.0e9 and 0.0 <= duration_s < 1.0e9):
        raise ConfigError(f"fault {kind}: at and duration are seconds from 0 on, not {at_s} and {duration_s}")
    if not 0.0 <= rate <= 1.0e6 or not 1 <= size <= 65536:
        raise ConfigError(f"fault {kind}: rate {rate} (0..1e6) or size {size} (1..65536) is out of range")
    if kind in (FaultKind.BIT_ERRORS, FaultKind.DROP) and rate > 1.0:
        raise ConfigError(f"fault {kind}: rate is a probability, 0..1, not {rate}")
    if kind is FaultKind.SILENT and sensor not in SENSORS:
        raise ConfigError(f"fault silent: sensor must be one of {', '.join(SENSORS)}, not '{sensor}'")
    if kind is FaultKind.MID_PING and sensor not in ("", "a", "b"):
        raise ConfigError(f"fault mid_ping: sensor must be a or b, not '{sensor}'")


class WireFaults:
    """Damages bytes on their way to the host, as scripted; the same seed and bytes always give the same damage."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 0xBADB17])
        self._next_burst_s: dict[Fault, float] = {}
        self._noise_left: dict[Fault, int] = {}

    def damage(self, data: bytes, at_s: float, faults: Iterable[Fault]) -> bytes:
        """What is left of bytes that start on the wire at this instant."""
        for fault in faults:
            if not fault.active(at_s):
                continue
            if fault.kind is FaultKind.BIT_ERRORS:
                data = self._flip(data, fault.rate)
            elif fault.kind is FaultKind.DROP:
                data = self._lose(data, fault.rate)
            elif fault.kind is FaultKind.GARBAGE:
                data = self._drown(data, at_s, fault)
        return data

    def garble(self, data: bytes) -> bytes:
        """What a receiver set to another baud rate makes of these bytes."""
        return self._rng.integers(0, 256, len(data), dtype="uint8").tobytes()

    def _flip(self, data: bytes, rate: float) -> bytes:
        bits = self._rng.random((len(data), 8)) < rate
        if not bits.any():
            return data
        flipped = np.frombuffer(data, "uint8") ^ np.packbits(bits, axis=1)[:, 0]
        return flipped.astype("uint8").tobytes()

    def _lose(self, data: bytes, rate: float) -> bytes:
        kept = self._rng.random(len(data)) >= rate
        return np.frombuffer(data, "uint8")[kept].tobytes()

    def _drown(self, data: bytes, at_s: float, fault: Fault) -> bytes:
        """A burst of noise from a random place on, once per burst interval, in place of what the board sends."""
        start = 0
        if at_s >= self._next_burst_s.get(fault, fault.at_s):
            self._next_burst_s[fault] = at_s + 1.0 / max(fault.rate, 1.0e-3)
            self._noise_left[fault] = fault.size
            start = int(self._rng.integers(0, max(1, len(data) - fault.size + 1)))
        count = min(self._noise_left.get(fault, 0), len(data) - start)
        if count == 0:
            return data
        self._noise_left[fault] -= count
        noise = self._rng.integers(0, 256, count, dtype="uint8").tobytes()
        return data[:start] + noise + data[start + count :]
