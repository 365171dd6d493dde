"""Logs of other programs, made byte by byte for the tests of their import."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

START_UNIX_S = 1_700_000_000.0


class TelemetryLog:
    """A .tlog: `add` packs a message of the autopilot (or of another sender) at its time."""

    def __init__(self) -> None:
        self.content = b""
        self._senders: dict[tuple[int, int], Any] = {}

    def add(self, message: Any, at_s: float, sender: tuple[int, int] = (1, 1)) -> bytes:
        """Append the message; its frame."""
        packer = self._senders.setdefault(sender, mavlink.MAVLink(None, srcSystem=sender[0], srcComponent=sender[1]))
        frame = bytes(message.pack(packer))
        packer.seq = (packer.seq + 1) % 256
        self.content += round((START_UNIX_S + at_s) * 1e6).to_bytes(8, "big") + frame
        return frame

    def heartbeat(self, at_s: float, sender: tuple[int, int] = (1, 1)) -> None:
        """ArduSub's."""
        self.add(mavlink.MAVLink_heartbeat_message(12, 3, 81, 0, 4, 3), at_s, sender)

    def attitude(self, at_s: float, boot_s: float | None = None, sender: tuple[int, int] = (1, 1)) -> None:
        """Level, heading 90 degrees, with the autopilot's own time (the log's, if none is given)."""
        boot_ms = round(1000.0 * (60.0 + at_s if boot_s is None else boot_s))
        self.add(mavlink.MAVLink_attitude_message(boot_ms, 0.01, -0.02, 1.5707964, 0.0, 0.0, 0.1), at_s, sender)

    def pressure(self, at_s: float, hectopascal: float, temperature_cdegc: int = 1250) -> None:
        """The external sensor's."""
        boot_ms = round(1000.0 * (60.0 + at_s))
        self.add(mavlink.MAVLink_scaled_pressure2_message(boot_ms, hectopascal, 0.0, temperature_cdegc), at_s)

    def gps_input(
        self, at_s: float, latitude_deg: float, longitude_deg: float, *, fix: int = 3, hdop: float = 1.5,
        accuracy_m: float | None = None,
    ) -> None:  # fmt: skip
        """What an acoustic topside sends, as component 220."""
        flags = 0b11111101 if accuracy_m is None else 0b10111101
        message = mavlink.MAVLink_gps_input_message(
            0, 0, flags, 0, 0, fix, round(latitude_deg * 1e7), round(longitude_deg * 1e7), 0.0, hdop, 1.0,
            0.0, 0.0, 0.0, 0.0, accuracy_m or 0.0, 0.0, 12,
        )  # fmt: skip
        self.add(message, at_s, (1, 220))

    def gps_raw(self, at_s: float, latitude_deg: float, longitude_deg: float, fix: int = 3) -> None:
        """The autopilot's own receiver, or its echo of GPS_INPUT."""
        message = mavlink.MAVLink_gps_raw_int_message(
            0, fix, round(latitude_deg * 1e7), round(longitude_deg * 1e7), 2500, 120, 65535, 40, 9000, 11
        )
        self.add(message, at_s)

    def parameter(self, at_s: float, name: str, value: float) -> None:
        """PARAM_VALUE."""
        self.add(mavlink.MAVLink_param_value_message(name.encode(), value, 9, 1, 0), at_s)


_FORMATS: Mapping[str, tuple[int, str, str]] = {
    # name: type, format, columns
    "ATT": (65, "Qccccccff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"),
    "BARO": (66, "QBffcfB", "TimeUS,I,Alt,Press,Temp,CRt,Health"),
    "RCOU": (67, "QHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8"),
    "IMU": (68, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "GPS": (69, "QBBIHBcLLffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,U"),
    "BAT": (70, "QBffB", "TimeUS,Instance,Volt,Curr,RemPct"),
    "PARM": (71, "QNf", "TimeUS,Name,Value"),
    "RFND": (72, "QBfBB", "TimeUS,Instance,Dist,Stat,Orient"),
    "CTUN": (73, "Qf", "TimeUS,Alt"),
}
_CODES = {"Q": "Q", "B": "B", "f": "f", "c": "h", "H": "H", "I": "I", "L": "i", "N": "16s"}


class DataflashLog:
    """A .BIN with the formats that its entries need."""

    def __init__(self) -> None:
        self.content = b"\xa3\x95\x80" + _format(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
        for name, (kind, letters, columns) in _FORMATS.items():
            self.content += b"\xa3\x95\x80" + _format(
                kind, 3 + struct.calcsize(_layout(letters)), name, letters, columns
            )

    def add(self, name: str, at_s: float, *values: Any) -> None:
        """Append an entry; hundredths and ten-millionths as the log stores them."""
        kind, letters, _ = _FORMATS[name]
        layout = _layout(letters)
        packed = [round(at_s * 1e6)]
        for letter, value in zip(letters[1:], values, strict=True):
            scaled = value * 100 if letter == "c" else value * 1e7 if letter == "L" else value
            packed.append(scaled.encode() if letter == "N" else scaled if letter == "f" else round(scaled))
        self.content += b"\xa3\x95" + bytes([kind]) + struct.pack(layout, *packed)


def csv_text(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table as other programs write it."""
    return "\n".join(",".join(map(str, row)) for row in (columns, *rows)) + "\n"


def _layout(letters: str) -> str:
    return "<" + "".join(_CODES[letter] for letter in letters)


def _format(kind: int, length: int, name: str, letters: str, columns: str) -> bytes:
    return struct.pack("<BB4s16s64s", kind, length, name.encode(), letters.encode(), columns.encode())
