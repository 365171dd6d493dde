"""Where the ESP32's serial port may be: candidates in order of preference."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

AUTO: Final = "auto"
# USB serial chips of ESP32 boards first, other converters after them, then whatever has a stable name.
_PREFERRED: Final = (
    re.compile(r"cp210|silicon_labs|ch34\d|ch910|1a86|espressif|esp32|usb_jtag", re.IGNORECASE),
    re.compile(r"ftdi|ft23|pl2303|prolific|usb.?serial", re.IGNORECASE),
)
# Never open the autopilot's or a receiver's own port: ArduSub must keep it.
_FOREIGN: Final = re.compile(
    r"ardupilot|pixhawk|px4|cubepilot|hex_profi|3d_robotics|mro|holybro|navigator|u-?blox", re.IGNORECASE
)


@dataclass(frozen=True, slots=True)
class PortCandidate:
    """One way to a port: `path` as it will be opened, `node` the device behind it, `by_id` its stable name if any."""

    path: Path
    node: Path
    by_id: Path | None


def find_candidates(
    port: str, device_folder: Path = Path("/dev"), last_good: Path | None = None
) -> list[PortCandidate]:
    """Ports to try, best first. A named port stands alone, but its stable name finds it again under a new node.

    A path whose link is stale is a candidate too, so that opening it says what is missing.
    """
    by_id = _links(device_folder / "serial" / "by-id")
    if port != AUTO:
        paths = [Path(port), *([last_good] if last_good else [])]
    else:
        by_path = _links(device_folder / "serial" / "by-path")
        nodes = [
            *sorted(device_folder.glob("ttyUSB*")),
            *sorted(device_folder.glob("ttyACM*")),
            *sorted(device_folder.glob("ttyAMA0")),
        ]
        foreign = {link.resolve() for link in by_id if _FOREIGN.search(link.name)}
        named = sorted((link for link in by_id if link.exists()), key=_preference)
        paths = [*([last_good] if last_good else []), *named, *by_path, *nodes]
        paths = [path for path in paths if path.exists() and path.resolve() not in foreign]
    return _without_twins([_candidate(path, by_id) for path in paths])


def has_serial_devices(device_folder: Path) -> bool:
    """False in a container that was given no /dev: then no cable will ever help. A host always has some ttyS*."""
    return (device_folder / "serial").exists() or any(device_folder.glob("tty[A-Z]*"))


def _preference(link: Path) -> tuple[int, str]:
    rank = next((rank for rank, pattern in enumerate(_PREFERRED) if pattern.search(link.name)), len(_PREFERRED))
    return rank, link.name


def _links(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def _candidate(path: Path, by_id: list[Path]) -> PortCandidate:
    node = path.resolve()
    stable = path if path in by_id else next((link for link in by_id if link.resolve() == node), None)
    return PortCandidate(path, node, stable)


def _without_twins(candidates: list[PortCandidate]) -> list[PortCandidate]:
    first: dict[Path, PortCandidate] = {}
    for candidate in candidates:
        first.setdefault(candidate.node, candidate)
    return list(first.values())
