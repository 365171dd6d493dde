"""Reads a real side-scan recording (XTF) for the virtual ESP32 to play.

Gain law: 16-bit amplitudes are divided by 128 and clipped at 255, as KoggerApp does when it opens an XTF; 8-bit ones
stay as they are. Port is stored far to near and turned round here. Pings without navigation (all zero) take that of
their neighbours.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bluerov_slam.errors import ConfigError
from bluerov_slam.simulation.scene import RecordedSurvey, metres_from

_XTF_MAGIC = 123
_PING_MAGIC = b"\xce\xfa"
_FILE_HEADER_BYTES = 1024
_PORT, _STARBOARD = 1, 2
_SIXTEEN_TO_EIGHT_BITS = 128
_SHORTEST_PING_INTERVAL_S = 1.0e-3
_DAY_S = 86_400.0

FloatArray = NDArray[np.float64]


def read_xtf(path: Path) -> RecordedSurvey:
    """The recording, ready to be played. Raises ConfigError that says what is wrong and how to cure it."""
    columns, usable = _sides(path)
    time_s = _times_s(usable)
    known = np.array([ping.SensorXcoordinate != 0.0 and ping.SensorYcoordinate != 0.0 for ping in usable])
    if not known.any():
        raise ConfigError(f"{path}: no ping has a position; give an XTF recording with navigation")
    latitude_deg = _filled([ping.SensorYcoordinate for ping in usable], time_s, known)
    longitude_deg = _filled([ping.SensorXcoordinate for ping in usable], time_s, known)
    origin = (float(latitude_deg[0]), float(longitude_deg[0]))
    north_m, east_m = metres_from(origin, latitude_deg, longitude_deg)
    heading_rad = np.radians([ping.SensorHeading for ping in usable])
    return RecordedSurvey(
        name=path.name,
        origin_latitude_deg=origin[0],
        origin_longitude_deg=origin[1],
        time_s=time_s,
        north_m=north_m,
        east_m=east_m,
        depth_m=_filled([ping.SensorDepth for ping in usable], time_s, known),
        roll_rad=_filled([math.radians(ping.SensorRoll) for ping in usable], time_s, known),
        pitch_rad=_filled([math.radians(ping.SensorPitch) for ping in usable], time_s, known),
        yaw_rad=_filled(_unwrapped(heading_rad, known), time_s, known),
        slant_range_m=_slant_range_m(path, usable, columns[1]),
        port=_amplitudes([ping.data[columns[0]] for ping in usable])[:, ::-1],
        starboard=_amplitudes([ping.data[columns[1]] for ping in usable]),
    )


def read_sides(path: Path) -> tuple[float, FloatArray, FloatArray]:
    """Slant range in m, port and starboard: the recorder's own amplitudes, near to far, one row for each ping."""
    columns, pings = _sides(path)
    rows = [[np.asarray(ping.data[column], np.float64) for ping in pings] for column in columns]
    if len({row.size for side in rows for row in side}) != 1:
        raise ConfigError(f"{path}: the pings have different lengths")
    return _slant_range_m(path, pings, columns[1]), np.stack(rows[0])[:, ::-1], np.stack(rows[1])


def _sides(path: Path) -> tuple[tuple[int, int], list[Any]]:
    """Which data column is port, which starboard, and the pings that have both."""
    header, pings = _read(path)
    columns = _side_columns(path, header)
    usable = [ping for ping in pings if len(ping.data) > max(columns)]
    if len(usable) < 2:
        raise ConfigError(f"{path}: only {len(usable)} pings with port and starboard; give a longer XTF recording")
    return columns, usable


def _read(path: Path) -> tuple[Any, list[Any]]:
    try:
        import pyxtf
    except ImportError as error:
        raise ConfigError(
            "reading XTF needs the package pyxtf: install it with pip install 'bluerov-slam[xtf]'"
        ) from error
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; give the path of an XTF recording") from error
    if len(content) < _FILE_HEADER_BYTES or content[0] != _XTF_MAGIC:
        raise ConfigError(f"{path}: not an XTF recording (its first byte must be {_XTF_MAGIC})")
    _check_whole(path, content)
    try:
        # pyxtf prints about packets it skips.
        with contextlib.redirect_stdout(io.StringIO()):
            header, packets = pyxtf.xtf_read(str(path))
    except Exception as error:
        raise ConfigError(f"{path}: damaged XTF recording ({error}); copy it again from its source") from error
    return header, packets.get(pyxtf.XTFHeaderType.sonar, [])


def _check_whole(path: Path, content: bytes) -> None:
    """Walk from record to record: each states its own length."""
    at = _FILE_HEADER_BYTES
    while at < len(content):
        size = int.from_bytes(content[at + 10 : at + 14], "little")
        if content[at : at + 2] != _PING_MAGIC or size < 14 or at + size > len(content):
            raise ConfigError(
                f"{path}: cut off or damaged at byte {at} of {len(content)}; copy the recording again from its source"
            )
        at += size


def _side_columns(path: Path, header: Any) -> tuple[int, int]:
    """Which data column is port, which starboard."""
    types = [int(channel.TypeOfChannel) for channel in header.ChanInfo[: header.channel_count()]]
    if _PORT not in types or _STARBOARD not in types:
        raise ConfigError(f"{path}: has no port and starboard side-scan channels (types {types})")
    return types.index(_PORT), types.index(_STARBOARD)


def _times_s(pings: Sequence[Any]) -> FloatArray:
    """Seconds since the first ping, over midnight and over repeated stamps."""
    clock_s = np.array([p.Hour * 3600.0 + p.Minute * 60.0 + p.Second + p.HSeconds / 100.0 for p in pings])
    steps_s = np.mod(np.diff(clock_s) + _DAY_S / 2.0, _DAY_S) - _DAY_S / 2.0
    return np.concatenate([[0.0], np.cumsum(np.maximum(steps_s, _SHORTEST_PING_INTERVAL_S))])


def _filled(values: Sequence[float] | FloatArray, time_s: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    return np.interp(time_s, time_s[known], np.asarray(values, np.float64)[known])


def _unwrapped(heading_rad: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """Headings without jumps, so that filling a gap does not turn the vehicle round."""
    unwrapped = heading_rad.copy()
    unwrapped[known] = np.unwrap(heading_rad[known])
    return unwrapped


def _slant_range_m(path: Path, pings: Sequence[Any], column: int) -> float:
    ranges_m = [float(ping.ping_chan_headers[column].SlantRange) for ping in pings]
    range_m = float(np.median(ranges_m))
    if not 0.5 <= range_m <= 1000.0:
        raise ConfigError(f"{path}: slant range {range_m} m, expected 0.5..1000 m")
    return range_m


def _amplitudes(rows: Sequence[NDArray[Any]]) -> NDArray[np.uint8]:
    width = max(len(row) for row in rows)
    levels = np.zeros((len(rows), width), np.uint8)
    for index, row in enumerate(rows):
        scaled = row if row.dtype.itemsize == 1 else row // _SIXTEEN_TO_EIGHT_BITS
        levels[index, : len(row)] = np.clip(scaled, 0, 255)
    return levels
