"""A dive as KoggerApp's .klf: its sonars' own frames, A under address 1 and B under address 2, with the vehicle's pose.

KoggerApp opens an empty column for each position beyond one per column, and one column holds a ping of both sonars: so
NAV v2 and ATTITUDE stand before each ping of one sonar only, the leading one. It draws the channel that comes first as
port, so the file begins with B where B starts within the first seconds. Unknown position: no NAV; unknown attitude: no
ATTITUDE, and zero angles in NAV (its fields have no way to say unknown). A chart frame that would crash KoggerApp is
left out, as it is on the live way to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import BinaryIO

from bluerov_slam.protocol.kogger import Attitude, NavigationTime
from bluerov_slam.protocol.kogger_frame import KOGGER_SYNC, KoggerId, reroute
from bluerov_slam.protocol.ping_assembly import is_safe_for_kogger_app
from bluerov_slam.records import Channel, Record, SonarFrames
from bluerov_slam.sinks.dive_track import DiveState, DiveTrack

ROUTES = {Channel.A: 1, Channel.B: 2}
# How long A's frames wait for B's first, so that KoggerApp draws B as port.
PORT_FIRST_S = 3.0

_ID_AT = 4
_SEQUENCE_AT = slice(6, 8)


@dataclass(slots=True)
class KlfCounts:
    """What was written."""

    frames_a: int = 0
    frames_b: int = 0
    positions: int = 0
    attitudes: int = 0
    refused: int = 0
    """Chart frames on which KoggerApp crashes."""


class KlfWriter:
    """Writes the frames of `SonarFrames` records; every other record is passed over."""

    def __init__(self, stream: BinaryIO, track: DiveTrack) -> None:
        self.counts = KlfCounts()
        self._stream = stream
        self._track = track
        self._leading: Channel | None = None
        self._waiting: list[SonarFrames] | None = []

    def write(self, record: Record) -> None:
        """Write a record's frames."""
        if not isinstance(record, SonarFrames):
            return
        if self._waiting is None:
            self._write(record)
            return
        self._waiting.append(record)
        if record.channel is Channel.B or record.measured_s - self._waiting[0].measured_s > PORT_FIRST_S:
            self._release()

    def finish(self) -> None:
        """Write what still waits."""
        if self._waiting is not None:
            self._release()

    def _release(self) -> None:
        waiting, self._waiting = self._waiting or [], None
        for record in sorted(waiting, key=lambda record: record.channel is Channel.A):
            self._write(record)

    def _write(self, record: SonarFrames) -> None:
        frames = [frame for frame in record.frames if is_safe_for_kogger_app(frame)]
        self.counts.refused += len(record.frames) - len(frames)
        for frame in frames:
            if _begins_ping(frame):
                self._leading = self._leading or record.channel
                if record.channel is self._leading:
                    self._write_pose(self._track.at(record.measured_s), ROUTES[record.channel])
            whole = reroute(frame, ROUTES[record.channel]) if frame.startswith(KOGGER_SYNC) else frame
            self._stream.write(whole)
        if record.channel is Channel.A:
            self.counts.frames_a += len(frames)
        else:
            self.counts.frames_b += len(frames)

    def _write_pose(self, state: DiveState, route: int) -> None:
        roll, pitch, yaw = state.roll_rad, state.pitch_rad, state.yaw_rad
        if roll is not None and pitch is not None and yaw is not None:
            self._stream.write(Attitude(yaw, pitch, roll).to_bytes(route))
            self.counts.attitudes += 1
        if state.latitude_deg is None or state.longitude_deg is None:
            return
        position = NavigationTime(
            fix=state.fix,
            satellites=min(state.satellites, 255),
            unix_ms=max(0, round((state.utc_unix_s or 0.0) * 1000)),
            latitude_deg=state.latitude_deg,
            longitude_deg=state.longitude_deg,
            course_rad=state.course_rad or 0.0,
            speed_mps=state.speed_mps or 0.0,
            yaw_rad=yaw or 0.0,
            pitch_rad=pitch or 0.0,
            roll_rad=roll or 0.0,
        )
        self._stream.write(position.to_bytes(route))
        self.counts.positions += 1


def _begins_ping(frame: bytes) -> bool:
    return frame[_ID_AT] == KoggerId.CHART and frame[_SEQUENCE_AT] == b"\0\0"
