from bluerov_slam.protocol.esp32_messages import MessageType, encode_frame
from bluerov_slam.records import AckResult, Channel
from bluerov_slam.simulation.board import Output, Sink
from bluerov_slam.simulation.reference_queue import SendQueue, Urgency
from bluerov_slam.simulation.reference_transmitter import Transmitter

SLOW = 11_520


def sent(queue: SendQueue) -> list[bytes]:
    """Everything in the order in which it goes."""
    frames = []
    while queue.next_length(acks_only=False):
        frames.append(queue.take(acks_only=False))
    return frames


def ping(mark: int, payloads: int = 1, size: int = 200) -> list[tuple[int, bytes]]:
    return [(MessageType.KOGGER_COMPRESSED, bytes((mark, index)) + bytes(size - 2)) for index in range(payloads)]


def marks(frames: list[bytes]) -> list[tuple[int, int]]:
    return [(frame[5], frame[6]) for frame in frames]


def test_the_most_urgent_frame_goes_first_even_between_those_of_a_ping() -> None:
    queue = SendQueue()
    queue.put_ping(Channel.A, ping(1, payloads=2), SLOW)
    queue.put_ping(Channel.B, ping(2), SLOW)
    assert marks([queue.take(False)]) == [(1, 0)]
    queue.put(Urgency.SONAR_OTHER, MessageType.KOGGER_RAW_A, bytes(20))
    queue.put(Urgency.REPORTS, MessageType.GPS, bytes(32))
    queue.acknowledge(MessageType.CONFIG, 5, AckResult.OK)
    queue.put(Urgency.SENSORS, MessageType.SENSORS, bytes(76))
    frames = sent(queue)
    assert [frame[2] for frame in frames] == [0x01, 0x07, 0x0B, 0x02, 0x04, 0x04]
    assert marks(frames[-2:]) == [(1, 1), (2, 0)]


def test_a_full_queue_loses_its_oldest_and_counts_sonar_bytes() -> None:
    queue = SendQueue()
    for number in range(34):
        queue.acknowledge(MessageType.CONFIG, number, AckResult.OK)
        queue.put(Urgency.SONAR_OTHER, MessageType.KOGGER_RAW_B, bytes((number,)) + bytes(49))
    assert [frame[6] for frame in sent(queue) if frame[2] == MessageType.COMMAND_ACK] == list(range(2, 34))
    assert queue.lost_sonar_bytes == {Channel.A: 0, Channel.B: 100}


def test_other_sonar_frames_have_room_for_8192_bytes() -> None:
    queue = SendQueue()
    for number in range(18):
        queue.put(Urgency.SONAR_OTHER, MessageType.KOGGER_RAW_A, bytes((number,)) + bytes(511))
    kept = 8_192 // (512 + 6 + 2)
    assert [frame[5] for frame in sent(queue)] == list(range(18 - kept, 18))
    assert queue.lost_sonar_bytes[Channel.A] == (18 - kept) * 512


def test_too_many_waiting_bytes_cost_whole_pings_of_each_sonar_in_turn() -> None:
    queue = SendQueue()
    for number in range(7):
        queue.put_ping(Channel.A if number % 2 == 0 else Channel.B, ping(number, payloads=4), SLOW)
    # The first is the next to go; behind it 15 % of 11 520 bytes are two pings of 824 bytes.
    assert queue.pings_dropped == {Channel.A: 2, Channel.B: 2}
    assert marks(sent(queue)) == [(number, index) for number in (0, 5, 6) for index in range(4)]


def test_a_ping_being_sent_is_never_dropped_and_fills_its_store() -> None:
    queue = SendQueue()
    queue.put_ping(Channel.A, ping(0, payloads=39, size=300), SLOW)
    assert marks([queue.take(False)]) == [(0, 0)]
    queue.put_ping(Channel.A, ping(1, payloads=3, size=200), SLOW)
    assert queue.pings_dropped[Channel.A] == 1  # 38 frames of 308 stored bytes leave 584 free
    queue.put_ping(Channel.A, ping(2, size=200), SLOW)
    assert marks(sent(queue)) == [*((0, index) for index in range(1, 39)), (2, 0)]


def test_sonar_data_packed_for_a_faster_line_are_lost_and_counted() -> None:
    queue = SendQueue()
    line = Transmitter(queue, 921_600)
    queue.put_ping(Channel.A, ping(1, payloads=3), SLOW)
    assert marks([queue.take(False)]) == [(1, 0)]
    queue.put_ping(Channel.B, ping(2), SLOW)
    queue.put(Urgency.SONAR_OTHER, MessageType.KOGGER_RAW_B, bytes(50))
    queue.put(Urgency.SENSORS, MessageType.SENSORS, bytes(76))
    line.change_baud(115_200)
    outputs: list[Output] = []
    line.tick(1000, outputs)
    assert [output.sink for output in outputs] == [Sink.LINK_BAUD, Sink.LINK]
    assert queue.pings_dropped == {Channel.A: 1, Channel.B: 1}
    assert queue.lost_sonar_bytes == {Channel.A: 0, Channel.B: 50}
    assert not queue.next_length(acks_only=False)


def test_hands_over_what_fits_the_window_and_keeps_the_line_busy() -> None:
    queue = SendQueue()
    line = Transmitter(queue, 115_200)
    for number in range(5):
        queue.put(Urgency.REPORTS, MessageType.GPS, bytes((number,)) + bytes(93))  # 100 bytes with framing
    outputs: list[Output] = []
    line.tick(1_000_000, outputs)
    assert len(outputs) == 2
    # 70 more bytes have room when 70 of the 200 are out: 6076.4 us.
    assert line.next_us() == 1_006_077
    line.tick(1_006_000, outputs)
    assert len(outputs) == 2
    line.tick(1_007_000, outputs)
    assert len(outputs) == 3


def test_changes_the_rate_behind_the_acknowledgement_and_back_without_an_answer() -> None:
    queue = SendQueue()
    line = Transmitter(queue, 115_200)
    outputs: list[Output] = []
    queue.acknowledge(MessageType.CONFIG, 1, AckResult.OK)
    queue.put(Urgency.REPORTS, MessageType.GPS, bytes(32))
    line.change_baud(921_600)
    line.tick(1_000, outputs)
    line.tick(1_500, outputs)
    assert [output.sink for output in outputs] == [Sink.LINK]
    line.tick(2_000, outputs)  # 9 bytes are out after 781 us
    assert [(output.sink, output.at_us) for output in outputs[1:]] == [(Sink.LINK_BAUD, 2_000), (Sink.LINK, 2_000)]
    line.tick(5_001_000, outputs)
    assert line.baud == 921_600
    assert line.next_us() == 5_002_000
    line.tick(5_002_000, outputs)
    assert outputs[-1] == Output(Sink.LINK_BAUD, 5_002_000, (115_200).to_bytes(4, "little"))
    line.change_baud(921_600)
    line.tick(6_000_000, outputs)
    line.heard_host()
    line.tick(20_000_000, outputs)
    assert line.baud == 921_600
    assert encode_frame(MessageType.GPS, bytes(32)) in [output.data for output in outputs]
