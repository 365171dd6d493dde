import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bluerov_slam.protocol import kogger_coded
from bluerov_slam.protocol.kogger import KoggerFrameDecoder, KoggerId
from bluerov_slam.protocol.kogger_bundle import (
    PAYLOAD_LIMIT_115200,
    PAYLOAD_LIMIT_921600,
    Bundle,
    BundlePacker,
    Coding,
    UnknownLayout,
    compress_ping,
    decimate,
    expand,
)
from bluerov_slam.protocol.ping_assembly import ChartChunk, PingAssembler
from bluerov_slam.records import Channel

VECTORS = json.loads((Path(__file__).parents[1] / "vectors" / "kogger_bundle.json").read_text())


def ping_chunks(count: int, chunk_size: int = 200, seed: int = 1) -> list[ChartChunk]:
    data = np.random.default_rng(seed).integers(0, 256, count, np.uint8).tobytes()
    return [ChartChunk(start, 20, 5, data[start : start + chunk_size]) for start in range(0, count, chunk_size)]


def expanded(payload: bytes) -> Bundle:
    bundle = expand(payload)
    assert isinstance(bundle, Bundle), bundle
    return bundle


def plainly_decimated(values: list[int], decimation: int, coding: int) -> list[int]:
    """The definition, one group at a time: the mean rounds half away from zero."""
    groups = [values[start : start + decimation] for start in range(0, len(values), decimation)]
    return [max(group) if coding == 1 else int(sum(group) / len(group) + 0.5) for group in groups]


def plainly_held(values: list[int], decimation: int, count: int) -> list[int]:
    return [values[index // decimation] for index in range(count)]


@pytest.mark.parametrize("coding", [Coding.MEAN, Coding.PEAK])
@pytest.mark.parametrize("decimation", range(1, 9))
@pytest.mark.parametrize("count", [1, 3, 4, 5, 199, 200, 249])
def test_decimation_and_hold_are_what_their_definition_says(count: int, decimation: int, coding: Coding) -> None:
    values = np.random.default_rng(count).integers(0, 256, count, np.uint8)
    expected = plainly_decimated(values.tolist(), decimation, coding)

    assert list(decimate(values.tobytes(), decimation, coding)) == expected
    payloads = compress_ping(
        Channel.A,
        [ChartChunk(0, 20, 0, values.tobytes())],
        ping_number=0,
        t_us=0,
        decimation=decimation,
        coding=coding,
        payload_limit=512,
    )
    assert list(expanded(payloads[0]).chunks[0].samples) == plainly_held(expected, decimation, count)


@pytest.mark.parametrize("decimation", range(1, 9))
@pytest.mark.parametrize("count", [1, 2, 7, 16, 20, 199, 200])
def test_dual_channel_charts_are_decimated_one_sub_channel_at_a_time(count: int, decimation: int) -> None:
    values = np.random.default_rng(count).integers(0, 256, count, np.uint8).tolist()
    held = [0] * count
    for sub_channel in (0, 1):
        own = values[sub_channel::2]
        held[sub_channel::2] = plainly_held(plainly_decimated(own, decimation, 0), decimation, len(own))

    (payload,) = compress_ping(
        Channel.B,
        [ChartChunk(0, 20, 0, bytes(values))],
        ping_number=0,
        t_us=0,
        version=1,
        decimation=decimation,
        payload_limit=512,
    )

    bundle = expanded(payload)
    assert bundle.version == 1
    assert list(bundle.chunks[0].samples) == held


def test_means_round_half_away_from_zero() -> None:
    assert list(decimate(bytes([0, 1, 0, 1]), 4)) == [1]  # 0.5
    assert list(decimate(bytes([0, 0, 0, 1]), 4)) == [0]  # 0.25
    assert list(decimate(bytes([2, 3, 2, 3, 254, 255]), 2)) == [3, 3, 255]


@pytest.mark.parametrize("vector", VECTORS["bundles"], ids=lambda vector: vector["name"])
def test_golden_ping_packs_to_these_bytes_and_expands_to_these_frames(vector: dict[str, Any]) -> None:
    chunks = [
        ChartChunk(c["seq_offset"], c["resolution_mm"], c["first_sample"], bytes.fromhex(c["samples"]))
        for c in vector["chunks"]
    ]

    payloads = compress_ping(
        Channel(vector["channel"]),
        chunks,
        ping_number=vector["ping_number"],
        t_us=vector["t_us"],
        version=vector["version"],
        mark=vector["mark"],
        decimation=vector["decimation"],
        coding=Coding(vector["coding"]),
        payload_limit=vector["payload_limit"],
    )

    assert [payload.hex() for payload in payloads] == vector["payloads"]
    bundles = [expanded(payload) for payload in payloads]
    assert [frame.hex() for bundle in bundles for frame in bundle.frames] == vector["frames"]
    assert [bundle.last_of_ping for bundle in bundles] == [False] * (len(bundles) - 1) + [True]
    for bundle in bundles:
        assert bundle.channel == vector["channel"]
        assert (bundle.ping_number, bundle.t_us) == (vector["ping_number"], vector["t_us"])
        assert (bundle.version, bundle.mark, bundle.coding) == (vector["version"], vector["mark"], vector["coding"])
        assert bundle.decimation == vector["decimation"]


@pytest.mark.parametrize("vector", VECTORS["unknown_layouts"], ids=lambda vector: vector["name"])
def test_golden_foreign_payload_is_an_unknown_layout(vector: dict[str, str]) -> None:
    outcome = expand(bytes.fromhex(vector["payload"]))

    assert isinstance(outcome, UnknownLayout)
    assert outcome.reason


def test_rebuilt_frames_are_valid_strict_koggers_with_route_0_and_the_mark_bit() -> None:
    chunks = ping_chunks(523)
    payloads = compress_ping(Channel.A, chunks, ping_number=3, t_us=99, mark=True)

    decoder = KoggerFrameDecoder("mod256")
    frames = [frame for payload in payloads for raw in expanded(payload).frames for frame in decoder.feed(raw)]

    assert (decoder.counters.checksum_errors, decoder.counters.bytes_skipped) == (0, 0)
    assert [(f.route, f.mark, f.frame_id, f.version) for f in frames] == [(0, True, KoggerId.CHART, 0)] * 3
    rebuilt = [chunk for payload in payloads for chunk in expanded(payload).chunks]
    assert [chunk[:3] for chunk in rebuilt] == [chunk[:3] for chunk in chunks]
    assert [frame.payload[6:] for frame in frames] == [chunk.samples for chunk in rebuilt]


@pytest.mark.parametrize("coding", list(Coding))
def test_undecimated_bundles_lose_nothing(coding: Coding) -> None:
    chunks = ping_chunks(1000)

    payloads = compress_ping(Channel.A, chunks, ping_number=0, t_us=0, decimation=1, coding=coding, payload_limit=512)

    assert [chunk for payload in payloads for chunk in expanded(payload).chunks] == chunks


@pytest.mark.parametrize("coding", list(Coding))
@pytest.mark.parametrize(("limit", "sizes"), [(PAYLOAD_LIMIT_115200, [180, 123]), (PAYLOAD_LIMIT_921600, [294])])
def test_a_thousand_samples_cost_what_the_link_budget_says(limit: int, sizes: list[int], coding: Coding) -> None:
    payloads = compress_ping(Channel.A, ping_chunks(1000), ping_number=0, t_us=0, coding=coding, payload_limit=limit)

    assert [len(payload) for payload in payloads] == sizes


@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize("decimation", range(1, 9))
@pytest.mark.parametrize("chunk_size", [1, 17, 200, 249])
@pytest.mark.parametrize("limit", [64, PAYLOAD_LIMIT_115200, PAYLOAD_LIMIT_921600])
@pytest.mark.parametrize("coding", [Coding.MEAN, Coding.CODED])
def test_no_payload_is_larger_than_the_limit_and_no_sample_is_lost(
    coding: Coding, limit: int, chunk_size: int, decimation: int, version: int
) -> None:
    chunks = ping_chunks(500, chunk_size)

    payloads, means = (
        compress_ping(
            Channel.A,
            chunks,
            ping_number=0,
            t_us=0,
            version=version,
            decimation=decimation,
            coding=each,
            payload_limit=limit,
        )
        for each in (coding, Coding.MEAN)
    )

    assert max(map(len, payloads)) <= limit
    assert list(map(len, payloads)) == list(map(len, means))
    assembler = PingAssembler(Channel.A)
    pings = [
        ping
        for payload in payloads
        for bundle in [expanded(payload)]
        for ping in assembler.feed_chunks(
            bundle.chunks, 0.0, 0.0, version=version, ping_number=0, last_of_ping=bundle.last_of_ping
        )
    ]
    assert [ping.samples.size for ping in pings] == ([500] if version == 0 else [250, 250])
    assert all(ping.gaps == () for ping in pings)


def test_packer_hands_out_a_payload_as_soon_as_it_is_full() -> None:
    packer = BundlePacker(Channel.B)
    packer.begin(ping_number=300, t_us=2**32 + 7)

    ready = [len(packer.add(chunk)) for chunk in ping_chunks(1000)]
    (last,) = packer.end()

    assert ready == [0, 0, 0, 1, 0]
    bundle = expanded(last)
    assert (bundle.channel, bundle.ping_number, bundle.t_us, bundle.last_of_ping) == (Channel.B, 44, 7, True)
    assert packer.end() == []


def test_chunks_that_would_crash_koggerapp_are_left_out() -> None:
    kept, refused = ChartChunk(19_799, 20, 0, bytes(200)), ChartChunk(19_800, 20, 0, bytes(200))

    (payload,) = compress_ping(Channel.A, [kept, refused], ping_number=0, t_us=0)

    assert expanded(payload).chunks == (kept,)


def coded(samples: bytes, chunk_size: int = 200, *, version: int = 0, decimation: int = 4) -> bytes:
    """The first payload of a coded ping."""
    chunks = [ChartChunk(at, 20, 0, samples[at : at + chunk_size]) for at in range(0, len(samples), chunk_size)]
    return compress_ping(
        Channel.A, chunks, ping_number=0, t_us=0, version=version, decimation=decimation, coding=Coding.CODED
    )[0]


def rebuilt(payload: bytes) -> bytes:
    return b"".join(chunk.samples for chunk in expanded(payload).chunks)


@pytest.mark.parametrize("decimation", [2, 3, 4, 5])
def test_coded_chunks_hold_one_code_of_all_their_samples(decimation: int) -> None:
    samples = np.random.default_rng(1).integers(40, 60, 400, np.uint8).tobytes()
    size = 2 * -(-200 // decimation)

    payload = coded(samples, decimation=decimation)
    first, second = payload[16 : 16 + size // 2], payload[16 + size // 2 + 7 :]

    assert first + second == kogger_coded.encode(samples, size)
    assert rebuilt(payload) == kogger_coded.decode(first + second, 400).tobytes()  # type: ignore[union-attr]


def test_coded_dual_channel_charts_are_coded_one_sub_channel_behind_the_other() -> None:
    rng = np.random.default_rng(1)
    first, second = rng.integers(10, 20, 101, np.uint8), rng.integers(200, 220, 101, np.uint8)
    samples = np.stack((first, second), axis=1).ravel()[:201].tobytes()

    payload = coded(samples, 67, version=1)

    data = payload[16:34] + payload[41:59] + payload[66:]
    # Of the chunks of 67 bytes every one begins with its own first sub-channel.
    parts = [samples[at : at + 67] for at in (0, 67, 134)]
    ordered = b"".join(part[0::2] for part in parts) + b"".join(part[1::2] for part in parts)
    assert data == kogger_coded.encode(ordered, 54)
    decoded = kogger_coded.decode(data, 201)
    assert decoded is not None
    assert sorted(rebuilt(payload)) == sorted(decoded.tolist())
    assert list(rebuilt(payload)[0:67:2]) == decoded[:34].tolist()
    assert list(rebuilt(payload)[1:67:2]) == decoded[102:135].tolist()


@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize("decimation", [6, 7, 8])
def test_high_decimations_code_pairs_and_hold_them(decimation: int, version: int) -> None:
    samples = np.random.default_rng(1).integers(40, 42, 249, np.uint8).tobytes()

    values = np.frombuffer(rebuilt(coded(samples, 249, version=version, decimation=decimation)), np.uint8)

    for channel in range(version + 1):
        own, sent = values[channel :: version + 1], np.frombuffer(samples, np.uint8)[channel :: version + 1]
        means = np.frombuffer(decimate(sent.tobytes(), 2), np.uint8)
        assert np.array_equal(own, own[::2].repeat(2)[: own.size])
        assert np.abs(own[::2].astype(int) - means).max() <= 1


def test_a_few_coded_bytes_are_means() -> None:
    samples = bytes((10, 12)) * 30

    assert rebuilt(coded(samples)) == bytes([11]) * 60
    assert coded(samples + b"\x0a")[16:] == kogger_coded.encode(samples + b"\x0a", 16)


def test_a_damaged_code_is_an_unknown_layout_or_a_bundle_of_as_many_samples() -> None:
    payload = coded(np.random.default_rng(1).integers(0, 256, 400, np.uint8).tobytes())
    outcomes = {Bundle: 0, UnknownLayout: 0}
    for at in range(16, len(payload)):
        damaged = payload[:at] + bytes((payload[at] ^ 0x11,)) + payload[at + 1 :]
        outcome = expand(damaged)
        outcomes[type(outcome)] += 1
        if isinstance(outcome, Bundle):
            assert [len(chunk.samples) for chunk in outcome.chunks] == [200, 200]
            assert all(KoggerFrameDecoder("mod256").feed(frame) for frame in outcome.frames)
    assert min(outcomes.values()) > 10


@pytest.mark.parametrize("coding", list(Coding))
def test_every_truncation_and_extension_is_an_unknown_layout(coding: Coding) -> None:
    payload = compress_ping(Channel.A, ping_chunks(600), ping_number=0, t_us=0, coding=coding)[0]

    for size in range(len(payload)):
        assert isinstance(expand(payload[:size]), UnknownLayout)
    assert isinstance(expand(payload + b"\x00"), UnknownLayout)


@pytest.mark.parametrize("coding", list(Coding))
def test_any_bytes_expand_to_a_bundle_of_valid_frames_or_to_an_unknown_layout(coding: Coding) -> None:
    rng = np.random.default_rng(7)
    valid = bytearray(compress_ping(Channel.A, ping_chunks(600), ping_number=0, t_us=0, coding=coding)[0])
    outcomes = {Bundle: 0, UnknownLayout: 0}
    for _ in range(3000):
        mutated = bytearray(valid)
        for _ in range(int(rng.integers(1, 4))):
            mutated[int(rng.integers(0, 30))] = int(rng.integers(0, 256))
        outcome = expand(bytes(mutated))
        outcomes[type(outcome)] += 1
        if isinstance(outcome, Bundle):
            decoder = KoggerFrameDecoder("mod256")
            assert len(decoder.feed(b"".join(outcome.frames))) == len(outcome.chunks)
        assert isinstance(expand(rng.bytes(int(rng.integers(0, 60)))), UnknownLayout | Bundle)
    assert min(outcomes.values()) > 100
