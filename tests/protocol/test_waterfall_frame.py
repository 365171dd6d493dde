import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bluerov_slam.errors import RecordingError
from bluerov_slam.protocol.waterfall_frame import pack_ping, seed_json, unpack_ping
from bluerov_slam.records import Channel, Ping

VECTORS = json.loads((Path(__file__).parents[1] / "vectors" / "waterfall.json").read_text())


def ping_of(samples: bytes, **changes: Any) -> Ping:
    fields: dict[str, Any] = {
        "channel": Channel.A,
        "sub_channel": 0,
        "route": 0,
        "number": 17,
        "measured_s": 3.5,
        "arrived_s": 3.5,
        "resolution_m": 0.02,
        "first_sample": 0,
    }
    return Ping(samples=np.frombuffer(samples, np.uint8), **(fields | changes))


def ping_of_vector(fields: dict[str, Any]) -> Ping:
    return ping_of(
        bytes.fromhex(fields["samples"]),
        channel=Channel(fields["channel"]),
        sub_channel=fields["sub_channel"],
        route=fields["route"],
        number=fields["number"],
        measured_s=fields["monotonic_s"],
        resolution_m=fields["resolution_mm"] / 1000,
        first_sample=fields["first_sample"],
        gaps=tuple(map(tuple, fields["gaps"])),
        decimation=fields["decimation"],
    )


@pytest.mark.parametrize("vector", VECTORS["pings"], ids=lambda vector: vector["name"])
def test_golden_ping_both_ways(vector: dict[str, Any]) -> None:
    fields = vector["fields"]
    data = bytes.fromhex(vector["hex"])

    assert pack_ping(ping_of_vector(fields), fields["time_unix_s"], simulated=fields["simulated"]) == data
    found = unpack_ping(data)

    assert (found.time_unix_s, found.simulated) == (fields["time_unix_s"], fields["simulated"])
    ping = found.ping
    assert (ping.channel, ping.sub_channel, ping.route) == (fields["channel"], fields["sub_channel"], fields["route"])
    assert (ping.number, ping.measured_s, ping.decimation) == (
        fields["number"],
        fields["monotonic_s"],
        fields["decimation"],
    )
    assert (round(ping.resolution_m * 1000), ping.first_sample) == (fields["resolution_mm"], fields["first_sample"])
    assert [list(gap) for gap in ping.gaps] == fields["gaps"]
    assert ping.samples.tobytes().hex() == fields["samples"]


@pytest.mark.parametrize("vector", VECTORS["pings"], ids=lambda vector: vector["name"])
def test_golden_seed_json(vector: dict[str, Any]) -> None:
    assert seed_json(ping_of_vector(vector["fields"])) == vector["seed_json"]


@pytest.mark.parametrize("vector", VECTORS["invalid"], ids=lambda vector: vector["name"])
def test_bytes_that_are_no_ping_are_refused_with_a_reason(vector: dict[str, str]) -> None:
    with pytest.raises(RecordingError, match="binary ping"):
        unpack_ping(bytes.fromhex(vector["hex"]))


def test_fields_lie_where_the_interface_says() -> None:
    ping = ping_of(b"\x0a\x0b", channel=Channel.B, route=2, first_sample=300, gaps=((1, 2),), decimation=4)

    data = pack_ping(ping, 1000.5, simulated=True)

    assert data[:4] == b"P\x01\x01\x05"
    assert struct.unpack_from("<Idd", data, 4) == (17, 1000.5, 3.5)
    assert struct.unpack_from("<HHHBB", data, 24) == (2, 300, 20, 4, 2)
    assert struct.unpack_from("<HHI", data, 32) == (1, 0, 0)
    assert data[40:] == b"\x01\x00\x02\x00\x0a\x0b"


def test_ping_number_wraps_at_32_bits() -> None:
    assert unpack_ping(pack_ping(ping_of(b"\x01", number=2**32 + 3), None)).ping.number == 3


@pytest.mark.parametrize("count", [200, 201, 399, 1000, 1499, 19_999])
def test_seed_amplitudes_are_the_maxima_of_200_equal_bins(count: int) -> None:
    samples = np.random.default_rng(count).integers(0, 256, count, np.uint8)
    expected = [max(samples[bin_ * count // 200 : (bin_ + 1) * count // 200]) for bin_ in range(200)]

    message = seed_json(ping_of(samples.tobytes(), channel=Channel.B))

    assert (message["ch"], message["n"]) == ("B", 17)
    assert list(base64.b64decode(str(message["amp"]))) == expected


@pytest.mark.parametrize("count", [1, 2, 50, 150, 199])
def test_seed_amplitudes_of_a_short_ping_repeat_the_nearest_sample(count: int) -> None:
    samples = bytes(range(count))

    amplitudes = base64.b64decode(str(seed_json(ping_of(samples))["amp"]))

    centres = [(bin_ + 0.5) * count / 200 - 0.5 for bin_ in range(200)]
    assert len(amplitudes) == 200
    assert all(abs(value - centre) <= 0.5 for value, centre in zip(amplitudes, centres, strict=True))


def test_empty_ping_is_200_zeros() -> None:
    assert base64.b64decode(str(seed_json(ping_of(b""))["amp"])) == bytes(200)
