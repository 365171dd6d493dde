import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bluerov_slam.protocol.even_bundle import expand_even
from bluerov_slam.protocol.kogger_bundle import Bundle, Coding, compress_ping, expand
from bluerov_slam.protocol.ping_assembly import ChartChunk
from bluerov_slam.records import Channel


def payload(
    samples: bytes, chunk: int = 200, *, decimation: int = 4, mark: bool = False, first: int = 0, limit: int = 224
) -> bytes:
    """The first payload of a ping that starts with `samples`."""
    chunks = [ChartChunk(at, 20, first, samples[at : at + chunk]) for at in range(0, len(samples), chunk)]
    return compress_ping(
        Channel.B,
        chunks,
        ping_number=7,
        t_us=123_456,
        mark=mark,
        decimation=decimation,
        coding=Coding.PEAK,
        payload_limit=limit,
    )[0]


def assert_equal_to_the_definition(data: bytes) -> None:
    quick, slow = expand_even(data), expand(data)
    assert quick is not None
    assert isinstance(slow, Bundle)
    for name in ("channel", "coding", "version", "last_of_ping", "decimation", "ping_number", "t_us", "frames"):
        assert getattr(quick, name) == getattr(slow, name), name
    [joined] = quick.chunks
    assert joined[:3] == slow.chunks[0][:3]
    assert joined.samples == b"".join(chunk.samples for chunk in slow.chunks)


@given(
    st.binary(min_size=1, max_size=600),
    st.integers(1, 249),
    st.integers(1, 8),
    st.booleans(),
    st.integers(0, 65535),
    st.sampled_from([224, 512]),
)
@example(bytes(range(200)) * 3, 200, 4, True, 0, 224)
def test_gives_what_the_definition_gives(
    samples: bytes, chunk: int, decimation: int, mark: bool, first: int, limit: int
) -> None:
    whole = samples[: max(1, len(samples) // chunk) * chunk]
    data = payload(whole, min(chunk, len(whole)), decimation=decimation, mark=mark, first=first, limit=limit)
    if expand_even(data) is not None:
        assert_equal_to_the_definition(data)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("chunk", [200, 199, 64])
def test_takes_the_common_case(count: int, chunk: int) -> None:
    assert_equal_to_the_definition(payload(bytes(k * 7 & 0xFF for k in range(count * chunk)), chunk))


common = payload(bytes(k & 0xFF for k in range(600)))


@pytest.mark.parametrize("at", [*range(len(common[:24])), 66, 67, 68, 69, 70, 72])
def test_any_changed_header_byte_is_judged_as_by_the_definition(at: int) -> None:
    for value in range(256):
        data = common[:at] + bytes((value,)) + common[at + 1 :]
        if expand_even(data) is not None:
            assert_equal_to_the_definition(data)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(15),
        common[:-1],
        common + b"\0",
        payload(bytes(300), 200),
        bytes(5000),
        common[:11] + b"\0\0" + common[13:],
        common[:9] + b"\xff\xff" + common[11:],
    ],
)
def test_leaves_everything_else_to_the_definition(data: bytes) -> None:
    assert expand_even(data) is None


@given(st.binary(max_size=700))
def test_never_raises(data: bytes) -> None:
    expand_even(data)
