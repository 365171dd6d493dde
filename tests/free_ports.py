"""Ports for services that a test starts: nobody else gets one while the test process lives.

A port that the kernel picked and that was closed again is anybody's: until the service binds it, an outgoing connection
or another test may take it. So ports come from below the range that the kernel picks from, and each is claimed by an
abstract Unix socket, which no second process on this machine can bind and which goes with its owner.
"""

from __future__ import annotations

import contextlib
import os
import random
import socket
from pathlib import Path

_RANGE = Path("/proc/sys/net/ipv4/ip_local_port_range")
# Above the ports that the services have by default and those that browsers refuse.
_FIRST = 15_000
_FEWEST = 2_000
_claims: dict[int, socket.socket] = {}


def free_port() -> int:
    """A port that is free for TCP and UDP, on every address of this machine."""
    candidates = _candidates()
    random.Random(os.urandom(8)).shuffle(candidates)
    for port in candidates:
        if port not in _claims and _claim(port):
            if _is_free(port):
                return port
            _claims.pop(port).close()
    raise AssertionError(f"no free port from {min(candidates)} to {max(candidates)}")


def free_ports() -> dict[str, int]:
    """A free port for each that the services open."""
    return {name: free_port() for name in ("http", "sensor_ws", "viewer", "waterfall_ws", "udp_a", "udp_b")}


def _candidates() -> list[int]:
    """Ports that the kernel gives to nobody by itself, as long as there are enough of them."""
    low, high = map(int, _RANGE.read_text().split())
    outside = [*range(_FIRST, low), *range(high + 1, 65_536)]
    return outside if len(outside) >= _FEWEST else list(range(_FIRST, 65_536))


def _claim(port: int) -> bool:
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        claim.bind(f"\0bluerov-slam-test-port-{port}")
    except OSError:
        claim.close()
        return False
    _claims[port] = claim
    return True


def _is_free(port: int) -> bool:
    with contextlib.ExitStack() as held:
        for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
            probe = held.enter_context(socket.socket(socket.AF_INET, kind))
            if kind == socket.SOCK_STREAM:  # as servers do: connections that have ended do not count
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("0.0.0.0", port))
            except OSError:
                return False
    return True
