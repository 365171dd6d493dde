"""The EZO EC's own settings: which quantities a line holds, and what it answers to commands."""

from __future__ import annotations

from collections.abc import Collection

from bluerov_slam.simulation.raw_sensors import EZO_OK, ezo_line

QUANTITIES = ("EC", "TDS", "S", "SG")
_ERROR = b"*ER\r"
_TDS_PER_CONDUCTIVITY = 0.54
_GRAVITY_PER_PSU = 0.00075


class EzoProbe:
    """Obeys `O,<quantity>,<0 or 1>` and answers every command; without power all that is kept, as in the real one."""

    ANSWER_S = 0.3

    def __init__(self, shown: Collection[str] = QUANTITIES) -> None:
        self._shown = {quantity: quantity in shown for quantity in QUANTITIES}
        self._received = b""

    def receive(self, data: bytes) -> list[bytes]:
        """What the board writes; the answers, each due `ANSWER_S` later."""
        *lines, self._received = (self._received + data).split(b"\r")
        return [self._obey(line.decode("ascii", "replace").split(",")) for line in lines]

    def line(self, conductivity_us_per_cm: float, salinity_psu: float) -> bytes:
        """One reading."""
        values = {
            "EC": ezo_line(conductivity_us_per_cm, None).removesuffix(b"\r"),
            "TDS": ezo_line(conductivity_us_per_cm * _TDS_PER_CONDUCTIVITY, None).removesuffix(b"\r"),
            "S": f"{salinity_psu:.2f}".encode(),
            "SG": f"{1.0 + _GRAVITY_PER_PSU * salinity_psu:.3f}".encode(),
        }
        return b",".join(values[quantity] for quantity in QUANTITIES if self._shown[quantity]) + b"\r"

    def _obey(self, words: list[str]) -> bytes:
        if words[0] == "O" and len(words) == 3 and words[1] in self._shown and words[2] in ("0", "1"):
            self._shown[words[1]] = words[2] == "1"
            return EZO_OK
        return EZO_OK if words[0] == "C" else _ERROR
