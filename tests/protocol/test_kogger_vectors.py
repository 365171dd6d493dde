import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from bluerov_slam.protocol.checksums import kogger_mod255, kogger_mod256
from bluerov_slam.protocol.kogger import KoggerFrame, KoggerFrameDecoder
from bluerov_slam.protocol.ping_assembly import PingAssembler
from bluerov_slam.records import Channel, Ping

REFERENCE = json.loads((Path(__file__).parents[1] / "vectors" / "kogger_vectors.json").read_text())
VECTORS = {vector["name"]: vector for vector in REFERENCE["vectors"]}


class Run:
    """One decoder and one assembler fed with blocks of bytes; what came out, in the vectors' own terms."""

    def __init__(self, blocks: list[bytes]) -> None:
        self.decoder = KoggerFrameDecoder("mod256")
        self.assembler = PingAssembler(Channel.A)
        self.frames: list[KoggerFrame] = []
        self.pings: list[Ping] = []
        for block in blocks:
            for frame in self.decoder.feed(block):
                self.frames.append(frame)
                self.pings += self.assembler.feed(frame, 0.0, 0.0)


def cut(datagrams: list[str], how: str) -> list[bytes]:
    blocks = [bytes.fromhex(datagram) for datagram in datagrams]
    if how == "as given":
        return blocks
    joined = b"".join(blocks)
    return [joined] if how == "joined" else [joined[i : i + 1] for i in range(len(joined))]


def frame_matches(frame: KoggerFrame, expected: dict[str, Any]) -> bool:
    actual = {
        "v": 2 if frame.is_v2 else 1,
        "route": frame.route,
        "type": frame.frame_type,
        "ver": frame.version,
        "mark": int(frame.mark),
        "resp": int(frame.response),
        "id": frame.frame_id,
        "len": len(frame.payload),
        "check": frame.check.hex(),
        "payload": frame.payload.hex(),
    }
    return all(actual[key] == value for key, value in expected.items())


def assert_ping_data(ping: Ping, hex_data: str | None, sha256: str) -> None:
    data = ping.samples.tobytes()
    assert hashlib.sha256(data).hexdigest() == sha256
    if hex_data is not None:
        assert data.hex() == hex_data


def assert_pings(pings: list[Ping], expected: list[dict[str, Any]]) -> None:
    rest = list(pings)
    for want in expected:
        ping = rest.pop(0)
        assert (ping.route, ping.sub_channel) == (want["route"], 0)
        assert (round(ping.resolution_m * 1000), ping.first_sample) == (want["resol_mm"], want["abs_offset"])
        assert ping.samples.size == want["size"]
        assert [list(gap) for gap in ping.gaps] == want["gaps"]
        assert_ping_data(ping, want.get("data"), want["data_sha256"])
        if want["ver"] == 1:
            second = rest.pop(0)
            assert (second.sub_channel, second.number, second.gaps) == (1, ping.number, ping.gaps)
            assert_ping_data(second, want.get("data2"), want["data2_sha256"])
    assert rest == []


@pytest.mark.parametrize("how", ["as given", "joined", "byte by byte"])
@pytest.mark.parametrize("name", VECTORS)
def test_vector(name: str, how: str) -> None:
    expected = VECTORS[name]["expect"]
    known = {"frames", "bad_checksum", "pings", "pending", "duplicates_dropped", "oversize_chunks"}
    assert set(expected) <= known | {"unsupported_chart_frames"}

    run = Run(cut(VECTORS[name]["datagrams"], how))

    assert len(run.frames) == len(expected["frames"])
    assert all(map(frame_matches, run.frames, expected["frames"]))
    assert run.decoder.counters.checksum_errors == expected["bad_checksum"]
    assert_pings(run.pings, expected["pings"])
    pending = [
        {
            "route": ping.route,
            "ver": ping.version,
            "filled": ping.filled,
            "resol_mm": ping.resolution_mm,
            "abs_offset": ping.first_sample,
            "gaps": [list(gap) for gap in ping.gaps],
        }
        for ping in run.assembler.pending
    ]
    assert pending == expected["pending"]
    counters = run.assembler.counters
    assert counters.duplicates == expected.get("duplicates_dropped", 0)
    assert counters.oversize_chunks == expected.get("oversize_chunks", 0)
    assert counters.unsupported == expected.get("unsupported_chart_frames", 0)


def test_all_47_vectors_are_there() -> None:
    assert len(VECTORS) == 47


@pytest.mark.parametrize("pair", REFERENCE["checksum"]["pairs"], ids=lambda pair: pair["bytes"])
def test_checksum_pair(pair: dict[str, str]) -> None:
    data = bytes.fromhex(pair["bytes"])

    assert kogger_mod256(data).hex() == pair["mod256"]
    assert kogger_mod255(data).hex() == pair["mod255"]
