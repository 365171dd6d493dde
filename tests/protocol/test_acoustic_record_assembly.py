import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bluerov_slam.protocol.acoustic_messages import RecordChunk, record_chunks, unpack_record_chunk
from bluerov_slam.protocol.acoustic_record_assembly import SILENCE_S, RecordAssembler
from bluerov_slam.records import AcousticRecord


def whole(record_id: int = 1, samples: int = 2048, receivers: int = 4, seed: int = 3) -> AcousticRecord:
    counts = np.random.default_rng(seed).integers(-2048, 2048, (receivers, samples)).astype(np.int16)
    return AcousticRecord(0.0, 0.0, record_id, 851_393.0, counts, 12, 128)


def feed(assembler: RecordAssembler, chunks: list[RecordChunk], at_s: float = 10.0) -> list[AcousticRecord]:
    return [record for chunk in chunks for record in assembler.feed(chunk, lambda t_us: t_us / 1e6, at_s)]


def chunks_of(record: AcousticRecord, payload_bytes: int = 512) -> list[RecordChunk]:
    return list(record_chunks(record, 1_000_000 * record.record_id, payload_bytes))


def test_a_short_last_chunk_ends_a_record_at_once() -> None:
    assembler, sent = RecordAssembler(), whole()
    chunks = chunks_of(sent)
    assert feed(assembler, chunks[:-1]) == []
    [record] = feed(assembler, chunks[-1:], 10.5)
    np.testing.assert_array_equal(record.samples, sent.samples)
    assert (record.record_id, record.sample_rate_hz, record.bits, record.trigger_index) == (1, 851_393.0, 12, 128)
    assert (record.measured_s, record.arrived_s) == (1.0, 10.5)
    assert (record.missing_samples, record.holes) == (0, ())
    assert assembler.expire(100.0) == []


def test_any_order_gives_the_same_record() -> None:
    sent = whole()
    chunks = chunks_of(sent)
    for seed in range(20):
        random.Random(seed).shuffle(chunks)
        records = feed(assembler := RecordAssembler(), chunks) + assembler.finish()
        np.testing.assert_array_equal(records[-1].samples, sent.samples)


def test_a_silence_ends_a_record_that_shows_no_end() -> None:
    assembler = RecordAssembler()
    assert feed(assembler, chunks_of(whole(samples=2048), 20 + 8 * 64)) == []  # 32 equal chunks
    assert assembler.expire(10.0 + SILENCE_S) == []
    [record] = assembler.expire(10.1 + SILENCE_S)
    assert record.samples.shape == (4, 2048)
    assert record.arrived_s == 10.0


def test_the_length_of_the_records_before_ends_the_next_at_once() -> None:
    assembler = RecordAssembler()
    ended = [len(feed(assembler, chunks_of(whole(k), 20 + 8 * 64))) for k in range(1, 6)]
    # The second ends the first, the third the second: from then on the length is known.
    assert ended == [0, 1, 2, 1, 1]


def test_missing_chunks_are_holes() -> None:
    assembler, sent = RecordAssembler(), whole()
    chunks = chunks_of(sent)
    size = len(chunks[0].samples)
    assert feed(assembler, [*chunks[:3], *chunks[5:]]) == []
    [record] = assembler.finish()
    assert record.holes == ((3 * size, 5 * size),)
    assert record.missing_samples == 2 * size
    assert not record.samples[:, 3 * size : 5 * size].any()
    np.testing.assert_array_equal(record.samples[:, 5 * size :], sent.samples[:, 5 * size :])
    assert assembler.counters.incomplete == 1
    assert assembler.counters.missing_samples == 2 * size


def test_a_lost_tail_is_a_hole_once_the_length_is_known() -> None:
    assembler = RecordAssembler()
    for k in (1, 2):
        feed(assembler, chunks_of(whole(k)))
    chunks = chunks_of(whole(3))
    feed(assembler, chunks[:-2])
    [record] = assembler.finish()
    assert record.samples.shape == (4, 2048)
    assert record.holes == ((len(chunks[0].samples) * (len(chunks) - 2), 2048),)


def test_a_changed_length_is_learned_again() -> None:
    assembler = RecordAssembler()
    for k in (1, 2, 3):
        feed(assembler, chunks_of(whole(k), 20 + 8 * 64))
    longer = [feed(assembler, chunks_of(whole(k, samples=4096), 20 + 8 * 64)) for k in range(4, 9)]
    # The first is cut where the old ones ended, and that is noticed; then they are whole.
    assert [record.samples.shape[1] for record in longer[0]] == [2048]
    assert assembler.counters.late == 32
    assert [record.samples.shape[1] for records in longer[1:] for record in records] == [4096, 4096, 4096, 4096]
    shorter = [feed(assembler, chunks_of(whole(k, samples=1024), 20 + 8 * 64)) for k in range(9, 14)]
    assert shorter[-1][-1].samples.shape[1] == 1024
    assert shorter[-1][-1].missing_samples == 0


def test_repeated_chunks_change_nothing() -> None:
    assembler, sent = RecordAssembler(), whole()
    chunks = chunks_of(sent)
    [record] = feed(assembler, [chunk for chunk in chunks[:-1] for _ in range(2)] + chunks[-1:])
    np.testing.assert_array_equal(record.samples, sent.samples)
    assert assembler.counters.repeated == len(chunks) - 1


def test_another_record_ends_the_open_one() -> None:
    assembler = RecordAssembler()
    first, second = chunks_of(whole(1)), chunks_of(whole(2, seed=4))
    records = feed(assembler, [*first[:4], *second])
    assert [record.record_id for record in records] == [1, 2]
    assert records[0].samples.shape == (4, 4 * len(first[0].samples))
    np.testing.assert_array_equal(records[1].samples, whole(2, seed=4).samples)


@pytest.mark.parametrize("change", [{"t_us": 5}, {"bits": 10}, {"sample_rate_hz": 9}, {"trigger_index": 1}])
def test_the_same_number_with_other_figures_is_another_record(change: dict[str, int]) -> None:
    assembler = RecordAssembler()
    first, *_ = chunks_of(whole(1))
    assert len(feed(assembler, [first, replace(first, **change)])) == 1


@given(st.lists(st.binary(min_size=20, max_size=90), max_size=30))
def test_anything_is_put_together_without_inventing_samples(payloads: list[bytes]) -> None:
    assembler = RecordAssembler()
    chunks = [chunk for payload in payloads if (chunk := unpack_record_chunk(payload)) is not None]
    records = feed(assembler, chunks) + assembler.finish()
    assert assembler.counters.records == len(records)
    for record in records:
        assert record.missing_samples == sum(end - start for start, end in record.holes)
        assert all(not record.samples[:, start:end].any() for start, end in record.holes)


def test_memory_is_bounded_whatever_the_chunks_say() -> None:
    assembler = RecordAssembler()
    samples = np.ones((30, 8), np.int16)
    for first in range(0, 8_100, 7):
        feed(assembler, [RecordChunk(1, 0, 1000, 12, first, 0, samples)])
    [record] = assembler.finish()
    assert record.samples.shape == (8, 8_099 // 7 * 7 + 30)
    assert record.missing_samples == 0
