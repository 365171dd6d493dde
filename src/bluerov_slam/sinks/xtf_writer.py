"""A dive as XTF (Triton eXtended Format): side-scan pings with time, position and attitude as far as known.

Written so that pyxtf and KoggerApp both read it: a file header of 1024 bytes that begins with 123, 8-bit samples,
records exactly as long as they say and not padded, port reversed (far to near), no attitude packets. Each record holds
one ping of either side: A to starboard and the B next to it in time to port.

XTF knows no "unknown" but "unused values remain zero", so that is what unknown looks like here: position 0/0, heading,
pitch, roll, depth and water 0, and a side without a ping is all zero. A time that is not known counts from 1970-01-01,
so that intervals stay right. SoundVelocity is half the sound speed, as XTF's own tools have it (750 where unknown);
SlantRange is resolution x samples as KoggerApp has it, and TimeDelay holds what lies before the first sample.
"""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from bluerov_slam import __version__
from bluerov_slam.records import Channel, Ping
from bluerov_slam.sinks.dive_track import DiveState, DiveTrack

DEFAULT_SOUND_SPEED_MPS = 1500.0
# Pings of the two sides belong into one record when they are closer than this.
PAIR_S = 0.25

_PORT_TYPE, _STARBOARD_TYPE = 1, 2
_LATITUDE_LONGITUDE = 3
_MAGIC = 0xFACE
_UNSIGNED = 1
_U8_SAMPLES = 8
_PA_PER_PSI = 6894.757
_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)

Fields = dict[str, tuple[str, int]]

# Name, type and offset of the fields written; the rest stays zero. Source: XTF file format, revision 40.
_FILE_FIELDS: Fields = {
    "file_format": ("u1", 0), "system_type": ("u1", 1), "program": ("S8", 2), "program_version": ("S8", 10),
    "sonar_name": ("S16", 18), "note": ("S64", 36), "file_name": ("S64", 100), "nav_units": ("<u2", 164),
    "sonar_channels": ("<u2", 166),
}  # fmt: skip
_CHANNEL_INFO_FIELDS: Fields = {
    "type": ("u1", 0), "sub_channel": ("u1", 1), "correction": ("<u2", 2), "polarity": ("<u2", 4),
    "bytes_per_sample": ("<u2", 6), "samples": ("<u4", 8), "name": ("S16", 12), "sample_format": ("u1", 74),
}  # fmt: skip
_PING_FIELDS: Fields = {
    "magic": ("<u2", 0), "packet_type": ("u1", 2), "channels": ("<u2", 4), "size": ("<u4", 10), "year": ("<u2", 14),
    "month": ("u1", 16), "day": ("u1", 17), "hour": ("u1", 18), "minute": ("u1", 19), "second": ("u1", 20),
    "hundredths": ("u1", 21), "day_of_year": ("<u2", 22), "number": ("<u4", 28), "sound_velocity": ("<f4", 32),
    "conductivity": ("<f4", 60), "water_temperature": ("<f4", 64), "pressure_psi": ("<f4", 68),
    "computed_sound_velocity": ("<f4", 72), "ship_speed_knots": ("<f4", 120), "ship_heading": ("<f4", 124),
    "ship_y": ("<f8", 128), "ship_x": ("<f8", 136), "fix_hour": ("u1", 148), "fix_minute": ("u1", 149),
    "fix_second": ("u1", 150), "fix_hundredths": ("u1", 151), "sensor_speed_knots": ("<f4", 152),
    "sensor_y": ("<f8", 160), "sensor_x": ("<f8", 168), "sensor_depth": ("<f4", 192), "sensor_pitch": ("<f4", 204),
    "sensor_roll": ("<f4", 208), "sensor_heading": ("<f4", 212), "yaw": ("<f4", 220),
}  # fmt: skip
_CHANNEL_FIELDS: Fields = {
    "channel": ("<u2", 0), "slant_range": ("<f4", 4), "time_delay": ("<f4", 12), "time_duration": ("<f4", 16),
    "seconds_per_ping": ("<f4", 20), "samples": ("<u4", 42),
}  # fmt: skip
_KNOTS_PER_MPS = 3600.0 / 1852.0


def _layout(fields: Fields, size: int) -> np.dtype[Any]:
    formats = [kind for kind, _ in fields.values()]
    offsets = [offset for _, offset in fields.values()]
    return np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": size})


_FILE_HEADER = _layout(_FILE_FIELDS, 256)
_CHANNEL_INFO = _layout(_CHANNEL_INFO_FIELDS, 128)
_PING_HEADER = _layout(_PING_FIELDS, 256)
_CHANNEL_HEADER = _layout(_CHANNEL_FIELDS, 64)
_CHANNEL_INFO_SLOTS = 6


@dataclass(slots=True)
class XtfCounts:
    """What was written. `single` counts records of which one side is all zero."""

    records: int = 0
    starboard: int = 0
    port: int = 0
    single: int = 0
    with_position: int = 0


class XtfWriter:
    """Writes pings to `stream` as they come. `dual`: sonars that carry both sides, sub-channel 0 port, 1 starboard."""

    def __init__(
        self, stream: BinaryIO, track: DiveTrack, file_name: str = "", dual: frozenset[Channel] = frozenset()
    ) -> None:
        self.counts = XtfCounts()
        self._stream = stream
        self._track = track
        self._dual = dual
        self._waiting: Ping | None = None
        self._last_s: float | None = None
        stream.write(_file_header(file_name))

    def write(self, ping: Ping) -> None:
        """Take one ping; a ping without samples is passed over."""
        if len(ping.samples) == 0:
            return
        waiting, self._waiting = self._waiting, None
        if waiting is None:
            self._waiting = ping
        elif self._is_port(waiting) != self._is_port(ping) and abs(waiting.measured_s - ping.measured_s) <= PAIR_S:
            self._write_record(waiting, ping)
        else:
            self._write_record(waiting, None)
            self._waiting = ping

    def finish(self) -> None:
        """Write the ping that still waits for its other side."""
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            self._write_record(waiting, None)

    def _is_port(self, ping: Ping) -> bool:
        if ping.channel in self._dual:
            return ping.sub_channel == 0
        return ping.channel is Channel.B

    def _write_record(self, first: Ping, second: Ping | None) -> None:
        port, starboard = (first, second) if self._is_port(first) else (second, first)
        shown = first if second is None else min(first, second, key=lambda ping: ping.measured_s)
        state = self._track.at(shown.measured_s)
        interval_s = 0.0 if self._last_s is None else shown.measured_s - self._last_s
        self._last_s = shown.measured_s
        sound_speed_mps = state.sound_speed_mps or DEFAULT_SOUND_SPEED_MPS
        sides = b"".join(
            _channel(number, ping, shown, sound_speed_mps, interval_s) for number, ping in enumerate((port, starboard))
        )
        self.counts.records += 1
        self.counts.port += port is not None
        self.counts.starboard += starboard is not None
        self.counts.single += second is None
        self.counts.with_position += state.latitude_deg is not None
        size = _PING_HEADER.itemsize + len(sides)
        header = _ping_header(state, shown.measured_s, self.counts.records, size, sound_speed_mps)
        self._stream.write(header + sides)


def _file_header(file_name: str) -> bytes:
    header = np.zeros((), _FILE_HEADER)
    header["file_format"] = 123
    header["system_type"] = 1
    header["program"] = b"BLUEROV"
    header["program_version"] = __version__.encode()[:7]
    header["sonar_name"] = b"Kogger side-scan"[:15]
    header["note"] = b"A starboard, B port; zero where unknown"
    header["file_name"] = file_name.encode("ascii", "replace")[:63]
    header["nav_units"] = _LATITUDE_LONGITUDE
    header["sonar_channels"] = 2
    channels = np.zeros(_CHANNEL_INFO_SLOTS, _CHANNEL_INFO)
    sides = ((_PORT_TYPE, b"port"), (_STARBOARD_TYPE, b"starboard"))
    for number, (kind, name) in enumerate(sides):
        channels[number]["type"] = kind
        channels[number]["sub_channel"] = number
        channels[number]["correction"] = 1  # slant range, not corrected
        channels[number]["polarity"] = _UNSIGNED
        channels[number]["bytes_per_sample"] = 1
        channels[number]["samples"] = 1024  # what old viewers expect; each ping says its own count
        channels[number]["name"] = name
        channels[number]["sample_format"] = _U8_SAMPLES
    return header.tobytes() + channels.tobytes()


def _ping_header(state: DiveState, measured_s: float, number: int, size: int, sound_speed_mps: float) -> bytes:
    header = np.zeros((), _PING_HEADER)
    header["magic"] = _MAGIC
    header["channels"] = 2
    header["size"] = size
    header["number"] = number
    header["sound_velocity"] = sound_speed_mps / 2.0
    _set_time(header, measured_s if state.utc_unix_s is None else state.utc_unix_s)
    if state.latitude_deg is not None and state.longitude_deg is not None:
        header["ship_y"] = header["sensor_y"] = state.latitude_deg
        header["ship_x"] = header["sensor_x"] = state.longitude_deg
    if state.speed_mps is not None:
        header["ship_speed_knots"] = header["sensor_speed_knots"] = state.speed_mps * _KNOTS_PER_MPS
    heading = _degrees(state.yaw_rad)
    header["ship_heading"] = header["sensor_heading"] = header["yaw"] = heading
    header["sensor_pitch"] = _degrees(state.pitch_rad)
    header["sensor_roll"] = _degrees(state.roll_rad)
    header["sensor_depth"] = state.depth_m or 0.0
    header["water_temperature"] = state.temperature_degc or 0.0
    header["conductivity"] = state.conductivity_s_per_m or 0.0
    header["pressure_psi"] = (state.pressure_pa or 0.0) / _PA_PER_PSI
    header["computed_sound_velocity"] = state.sound_speed_mps or 0.0
    return header.tobytes()


def _set_time(header: NDArray[Any], unix_s: float) -> None:
    moment = _EPOCH + datetime.timedelta(milliseconds=max(0, math.floor(unix_s * 1000.0)))
    hundredths = moment.microsecond // 10_000
    header["year"], header["month"], header["day"] = moment.year, moment.month, moment.day
    header["hour"], header["minute"], header["second"] = moment.hour, moment.minute, moment.second
    header["hundredths"] = hundredths
    header["day_of_year"] = moment.timetuple().tm_yday
    header["fix_hour"], header["fix_minute"], header["fix_second"] = moment.hour, moment.minute, moment.second
    header["fix_hundredths"] = hundredths


def _channel(number: int, ping: Ping | None, shown: Ping, sound_speed_mps: float, interval_s: float) -> bytes:
    """Header and samples of one side; without a ping, as many zeros as the other side has samples."""
    source = ping or shown
    count = len(source.samples)
    header = np.zeros((), _CHANNEL_HEADER)
    header["channel"] = number
    header["slant_range"] = source.resolution_m * count
    header["time_delay"] = 2.0 * source.resolution_m * source.first_sample / sound_speed_mps
    header["time_duration"] = 2.0 * source.resolution_m * count / sound_speed_mps
    header["seconds_per_ping"] = interval_s
    header["samples"] = count
    if ping is None:
        return header.tobytes() + bytes(count)
    samples = ping.samples[::-1] if number == 0 else ping.samples
    return header.tobytes() + samples.tobytes()


def _degrees(angle_rad: float | None) -> float:
    return 0.0 if angle_rad is None else math.degrees(angle_rad)
