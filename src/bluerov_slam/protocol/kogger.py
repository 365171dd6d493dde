"""The Kogger sonar protocol in one place: frames, commands and their answers, content that we inject.

The parts live in `kogger_frame`, `kogger_commands` and `kogger_content`; import the names from here.
"""

from __future__ import annotations

from bluerov_slam.protocol.kogger_frame import (
    ChecksumChoice,
    FrameType,
    KoggerFrame,
    KoggerFrameDecoder,
    KoggerId,
    build_frame,
    build_v2_frame,
    reroute,
)

__all__ = [
    "ChecksumChoice",
    "FrameType",
    "KoggerFrame",
    "KoggerFrameDecoder",
    "KoggerId",
    "build_frame",
    "build_v2_frame",
    "reroute",
]
