from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from bluerov_slam.protocol.kogger import ChartSetup, FrameType, KoggerFrame, KoggerFrameDecoder, KoggerId, build_frame
from bluerov_slam.protocol.ping_assembly import ChartChunk, PingAssembler, chart_chunk
from bluerov_slam.records import Channel, Ping

CHUNK = 20
PERIOD_S = 0.1


def chunks_of_ping(count: int, seed: int = 0, resolution_mm: int = 20, first_sample: int = 0) -> list[ChartChunk]:
    data = np.random.default_rng(seed).integers(1, 256, count, np.uint8).tobytes()
    return [
        ChartChunk(start, resolution_mm, first_sample, data[start : start + CHUNK]) for start in range(0, count, CHUNK)
    ]


def whole(chunks: Sequence[ChartChunk]) -> bytes:
    return b"".join(chunk.samples for chunk in chunks)


def feed_all(assembler: PingAssembler, chunks: Sequence[ChartChunk], at_s: float = 0.0, **options: Any) -> list[Ping]:
    """Each chunk by itself, all at one instant."""
    return [ping for chunk in chunks for ping in assembler.feed_chunks((chunk,), at_s, at_s, **options)]


def with_learned_period(assembler: PingAssembler) -> float:
    """Feed regular whole pings; returns when the next one is due. The last one is still open."""
    for index in range(6):
        feed_all(assembler, chunks_of_ping(60, seed=100 + index), index * PERIOD_S)
    return 6 * PERIOD_S


def chart(chunk: ChartChunk, version: int = 0, route: int = 0) -> KoggerFrame:
    header = b"".join(value.to_bytes(2, "little") for value in chunk[:3])
    data = build_frame(KoggerId.CHART, header + chunk.samples, version=version, route=route)
    return KoggerFrameDecoder("mod256").feed(data)[0]


def test_a_ping_comes_out_when_the_next_one_begins() -> None:
    assembler = PingAssembler(Channel.B)
    first, second = chunks_of_ping(100, 1, first_sample=7), chunks_of_ping(100, 2, first_sample=7)

    assert feed_all(assembler, first, 5.0) == []
    (ping,) = feed_all(assembler, second[:1], 5.1)

    assert (ping.channel, ping.sub_channel, ping.route, ping.number) == (Channel.B, 0, 0, 1)
    assert (ping.resolution_m, ping.first_sample, ping.gaps, ping.decimation) == (0.02, 7, (), 1)
    assert (ping.measured_s, ping.arrived_s) == (5.0, 5.0)
    assert ping.samples.dtype == np.uint8
    assert ping.samples.tobytes() == whole(first)


def test_samples_of_a_ping_cannot_be_changed_and_survive_the_next_one() -> None:
    assembler = PingAssembler(Channel.A)
    first = chunks_of_ping(100, 1)
    feed_all(assembler, first)
    (ping,) = feed_all(assembler, chunks_of_ping(100, 2)[:1])

    feed_all(assembler, chunks_of_ping(100, 3))

    assert ping.samples.tobytes() == whole(first)
    with pytest.raises(ValueError, match="read-only"):
        ping.samples[0] = 1


def test_measured_at_the_first_chunk_arrived_with_the_last() -> None:
    assembler = PingAssembler(Channel.A, expected_samples=60)
    a, b, c = chunks_of_ping(60)

    assembler.feed_chunks((a,), 1.00, 1.05)
    assembler.feed_chunks((b,), 1.01, 1.06)
    (ping,) = assembler.feed_chunks((c,), 1.02, 1.07)

    assert (ping.measured_s, ping.arrived_s) == (1.00, 1.07)


def test_known_count_emits_at_once_and_the_last_chunk_may_then_be_repeated() -> None:
    assembler = PingAssembler(Channel.A, expected_samples=100)
    chunks = chunks_of_ping(100)

    pings = feed_all(assembler, [*chunks, chunks[-1], *chunks_of_ping(100, 2)])

    assert [ping.samples.size for ping in pings] == [100, 100]
    assert assembler.counters.duplicates == 1
    assert assembler.counters.incomplete == 0
    assert assembler.pending == ()


def test_count_is_learned_from_the_sonars_chart_setup_answer() -> None:
    assembler = PingAssembler(Channel.A)
    answer = KoggerFrameDecoder("mod256").feed(ChartSetup(100, 20).content_frame())[0]

    assert assembler.feed(answer, 0.0, 0.0) == []

    assert assembler.expected_samples == 100
    assert len(feed_all(assembler, chunks_of_ping(100))) == 1


def test_lost_tail_is_listed_as_a_gap_where_the_count_is_known() -> None:
    assembler = PingAssembler(Channel.A, expected_samples=100)
    chunks = chunks_of_ping(100)
    feed_all(assembler, chunks[:4])

    (ping,) = feed_all(assembler, chunks_of_ping(100, 2)[:1])

    assert ping.gaps == ((80, 100),)
    assert ping.samples.tobytes() == whole(chunks[:4]) + bytes(20)
    assert (assembler.counters.incomplete, assembler.counters.gap_samples) == (1, 20)


def test_a_count_too_small_is_given_up_after_one_cut_ping() -> None:
    assembler = PingAssembler(Channel.A, expected_samples=40)

    pings = [ping for seed in range(3) for ping in feed_all(assembler, chunks_of_ping(100, seed))]
    pings += assembler.finish()

    assert [ping.samples.size for ping in pings] == [40, 100, 100, 100]
    assert [ping.gaps for ping in pings] == [(), ((0, 40),), (), ()]
    assert assembler.expected_samples is None
    assert assembler.counters.expected_disproved == 1


def test_a_count_between_chunk_edges_is_given_up_when_passed() -> None:
    assembler = PingAssembler(Channel.A, expected_samples=50)

    pings = feed_all(assembler, chunks_of_ping(100, 1)) + assembler.finish()

    assert [(ping.samples.size, ping.gaps) for ping in pings] == [(100, ())]
    assert assembler.expected_samples is None


def test_a_count_too_large_is_given_up_after_five_equal_pings() -> None:
    assembler = PingAssembler(Channel.A, expected_samples=200)

    pings = [ping for seed in range(8) for ping in feed_all(assembler, chunks_of_ping(100, seed))]

    assert [ping.samples.size for ping in pings] == [200] * 4 + [100] * 3
    assert assembler.expected_samples is None


def test_firmwares_last_flag_emits_at_once() -> None:
    assembler = PingAssembler(Channel.A)
    chunks = chunks_of_ping(100)

    assert assembler.feed_chunks(chunks[:3], 0.0, 0.0, decimation=4) == []
    (ping,) = assembler.feed_chunks(chunks[3:], 0.0, 0.0, decimation=4, last_of_ping=True)

    assert ping.samples.tobytes() == whole(chunks)
    assert ping.decimation == 4


def test_a_new_ping_number_ends_the_ping_and_counts_those_between() -> None:
    assembler = PingAssembler(Channel.A)
    first, second = chunks_of_ping(100, 1), chunks_of_ping(100, 2)

    assembler.feed_chunks(first[:2], 0.0, 0.0, ping_number=254)
    (ping,) = assembler.feed_chunks(second[2:], 0.0, 0.0, ping_number=1)

    assert ping.samples.size == 40
    assert assembler.counters.pings_missed == 2
    assert assembler.pending[0].gaps == ((0, 40),)


def test_a_ping_number_that_jumps_far_is_a_restart_not_a_loss() -> None:
    assembler = PingAssembler(Channel.A)
    assembler.feed_chunks(chunks_of_ping(40), 0.0, 0.0, ping_number=90)

    assembler.feed_chunks(chunks_of_ping(40), 0.1, 0.1, ping_number=0)

    assert assembler.counters.pings_missed == 0


def test_same_ping_number_is_never_split_by_a_pause() -> None:
    assembler = PingAssembler(Channel.A)
    for index in range(6):
        assembler.feed_chunks(chunks_of_ping(60), index * PERIOD_S, index * PERIOD_S, ping_number=index)
    chunks = chunks_of_ping(60)

    assembler.feed_chunks(chunks[:1], 0.6, 0.6, ping_number=6)
    assembler.feed_chunks(chunks[1:], 0.68, 0.68, ping_number=6)

    assert assembler.pending[0].filled == 60
    assert assembler.counters.split_by_pause == 0


def test_two_half_pings_are_kept_apart_by_the_pause_between_them() -> None:
    assembler = PingAssembler(Channel.A)
    due_s = with_learned_period(assembler)
    early, late = chunks_of_ping(100, 1), chunks_of_ping(100, 2)

    pings = feed_all(assembler, early[:2], due_s) + feed_all(assembler, late[2:], due_s + PERIOD_S)
    pings += assembler.finish()

    assert [ping.samples.size for ping in pings[1:]] == [40, 100]
    assert pings[2].gaps == ((0, 40),)
    assert assembler.counters.split_by_pause == 1


def test_a_pause_below_half_a_period_splits_nothing() -> None:
    assembler = PingAssembler(Channel.A)
    due_s = with_learned_period(assembler)
    chunks = chunks_of_ping(100)

    feed_all(assembler, chunks[:2], due_s)
    feed_all(assembler, chunks[2:], due_s + 0.49 * PERIOD_S)

    assert assembler.pending[0].filled == 100
    assert assembler.counters.split_by_pause == 0


def test_without_a_learned_period_a_pause_splits_nothing() -> None:
    assembler = PingAssembler(Channel.A)
    chunks = chunks_of_ping(100)

    feed_all(assembler, chunks[:2], 0.0)
    feed_all(assembler, chunks[2:], 0.9)

    assert assembler.pending[0].filled == 100


def test_flush_waits_half_a_second_and_one_and_a_half_periods_after_the_last_chunk() -> None:
    assembler = PingAssembler(Channel.A)
    last_s = with_learned_period(assembler) - PERIOD_S

    assert assembler.flush(last_s + 0.5 + 1.49 * PERIOD_S) == []
    (ping,) = assembler.flush(last_s + 0.5 + 1.51 * PERIOD_S)

    assert ping.samples.size == 60
    assert assembler.counters.flushed == 1
    assert assembler.flush(last_s + 100) == []


def test_flush_waits_a_second_while_the_period_is_unknown() -> None:
    assembler = PingAssembler(Channel.A)
    feed_all(assembler, chunks_of_ping(60), 10.0)

    assert assembler.flush(10.99) == []
    assert len(assembler.flush(11.01)) == 1


@pytest.mark.parametrize("numbered", [False, True])
def test_when_flush_is_called_changes_nothing_in_the_pings(numbered: bool) -> None:
    """A stall of ten periods in the middle of a ping, with and without flush called during it."""

    def run(flush_during_stall: bool) -> list[tuple[int, bytes, tuple[tuple[int, int], ...], float]]:
        assembler = PingAssembler(Channel.A)
        pings: list[Ping] = []
        for index in range(12):
            at_s = index * PERIOD_S + (1.0 if index > 6 else 0.0)
            chunks = chunks_of_ping(60, index)
            number = index if numbered else None
            pings += assembler.feed_chunks(chunks[:2], at_s, at_s, ping_number=number)
            if index == 6:
                at_s += 1.0
                if flush_during_stall:
                    pings += assembler.flush(at_s - 0.01)
            pings += assembler.feed_chunks(chunks[2:], at_s, at_s, ping_number=number)
        pings += assembler.finish()
        return [(ping.number, ping.samples.tobytes(), ping.gaps, ping.measured_s) for ping in pings]

    assert run(flush_during_stall=True) == run(flush_during_stall=False)


def test_a_host_that_reads_half_a_ping_late_does_not_cut_it() -> None:
    """The device's clock says that there was no pause."""
    assembler = PingAssembler(Channel.A)
    due_s = with_learned_period(assembler)
    chunks = chunks_of_ping(100)

    assembler.feed_chunks(chunks[:2], due_s, due_s)
    assembler.feed_chunks(chunks[2:], due_s + 0.01, due_s + 0.4)

    assert assembler.pending[0].filled == 100


def test_change_of_resolution_or_first_sample_ends_a_ping_without_guessing_its_tail() -> None:
    assembler = PingAssembler(Channel.A, expected_samples=100)
    feed_all(assembler, chunks_of_ping(100)[:3])

    (old,) = feed_all(assembler, chunks_of_ping(100, resolution_mm=10)[:2])
    (older,) = feed_all(assembler, chunks_of_ping(100, resolution_mm=10, first_sample=50)[2:3])

    assert (old.samples.size, old.gaps, old.resolution_m) == (60, (), 0.02)
    assert (older.samples.size, older.resolution_m, older.first_sample) == (40, 0.01, 0)
    assert assembler.pending[0].gaps == ((0, 40),)


def test_dual_channel_gives_two_pings_of_one_number_with_halved_gaps() -> None:
    assembler = PingAssembler(Channel.A, expected_samples=30)
    chunks = chunks_of_ping(60)

    port, starboard = feed_all(assembler, [chunks[0], chunks[2]], version=1)

    data = chunks[0].samples + bytes(20) + chunks[2].samples
    assert (port.sub_channel, starboard.sub_channel) == (0, 1)
    assert port.number == starboard.number == 1
    assert (port.samples.tobytes(), starboard.samples.tobytes()) == (data[0::2], data[1::2])
    assert port.gaps == starboard.gaps == ((10, 20),)
    assert assembler.counters.pings == 1


def test_odd_offsets_of_a_dual_channel_gap_are_told_apart() -> None:
    assembler = PingAssembler(Channel.A)
    chunks = (ChartChunk(0, 20, 0, b"\x01" * 5), ChartChunk(9, 20, 0, b"\x02" * 5))

    assembler.feed_chunks(chunks, 0.0, 0.0, version=1)
    first, second = assembler.finish()

    assert first.samples.tolist() == [1, 1, 1, 0, 0, 2, 2]
    assert second.samples.tolist() == [1, 1, 0, 0, 2, 2, 2]
    assert (first.gaps, second.gaps) == (((3, 5),), ((2, 4),))


def test_a_gap_of_one_byte_hurts_only_the_sub_channel_it_belongs_to() -> None:
    assembler = PingAssembler(Channel.A)

    assembler.feed_chunks((ChartChunk(0, 20, 0, b"\x01" * 3), ChartChunk(4, 20, 0, b"\x02" * 4)), 0.0, 0.0, version=1)

    assert [ping.gaps for ping in assembler.finish()] == [(), ((1, 2),)]


def test_half_a_sample_pair_is_no_ping() -> None:
    assembler = PingAssembler(Channel.A)

    assembler.feed_chunks((ChartChunk(0, 20, 0, b"\x01"),), 0.0, 0.0, version=1)

    assert assembler.finish() == []
    assert (assembler.counters.pings, assembler.counters.unsupported) == (0, 1)


@pytest.mark.parametrize(("offset", "kept"), [(19_799, True), (19_800, False), (65_535, False)])
def test_chunks_that_reach_the_end_of_koggerapps_buffer_are_refused(offset: int, kept: bool) -> None:
    assembler = PingAssembler(Channel.A)

    assembler.feed_chunks((ChartChunk(offset, 20, 0, bytes(200)),), 0.0, 0.0)

    assert assembler.counters.oversize_chunks == (0 if kept else 1)
    assert len(assembler.pending) == (1 if kept else 0)


def test_addresses_are_kept_apart_and_the_oldest_is_let_go() -> None:
    assembler = PingAssembler(Channel.A)
    chunks = chunks_of_ping(60)

    pings = [ping for route in range(12) for ping in feed_all(assembler, chunks, float(route) / 100, route=route)]

    assert [ping.route for ping in pings] == [0, 1, 2, 3]
    assert [ping.route for ping in assembler.pending] == list(range(4, 12))


def test_frames_that_are_no_chart_content_are_no_business_of_the_assembler() -> None:
    assembler = PingAssembler(Channel.A)
    chunk = chunks_of_ping(20)[0]
    payload = bytes(6) + chunk.samples
    frames = [
        build_frame(KoggerId.CHART, payload, frame_type=FrameType.SETTING),
        build_frame(KoggerId.CHART, b"\x01\x02\x03", response=True),
        build_frame(KoggerId.TEMPERATURE, bytes(2)),
        build_frame(KoggerId.CHART_SETUP, bytes(3)),
    ]

    for data in frames:
        assert assembler.feed(KoggerFrameDecoder("mod256").feed(data)[0], 0.0, 0.0) == []

    assert assembler.pending == ()
    assert assembler.counters.unsupported == 0


def test_chart_without_a_resolution_has_no_range_and_is_counted() -> None:
    assembler = PingAssembler(Channel.A)

    assembler.feed(chart(ChartChunk(0, 0, 0, bytes(20))), 0.0, 0.0)

    assert assembler.counters.unsupported == 1
    assert assembler.pending == ()


def test_chart_chunk_reads_what_a_chart_frame_says() -> None:
    chunk = chunks_of_ping(40, first_sample=9)[1]

    assert chart_chunk(chart(chunk)) == chunk
    assert chart_chunk(chart(chunk, version=1)) == chunk
    assert chart_chunk(chart(chunk, version=7)) is None


def test_frames_and_blocks_of_chunks_give_the_same_pings() -> None:
    pings = [chunks_of_ping(100, seed) for seed in range(4)]
    by_frame, by_block = PingAssembler(Channel.A), PingAssembler(Channel.A)

    one = [ping for chunks in pings for c in chunks for ping in by_frame.feed(chart(c), 0.0, 0.0)]
    other = [ping for chunks in pings for ping in by_block.feed_chunks(chunks, 0.0, 0.0)]

    assert [ping.samples.tobytes() for ping in one] == [ping.samples.tobytes() for ping in other]
    assert by_frame.counters == by_block.counters
    assert by_frame.counters.pings == 3


def test_no_chunks_change_nothing() -> None:
    assembler = PingAssembler(Channel.A)

    assert assembler.feed_chunks((), 0.0, 0.0, last_of_ping=True) == []
