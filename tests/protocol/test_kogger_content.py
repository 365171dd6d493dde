import json
from math import pi, radians
from pathlib import Path

import pytest

from bluerov_slam.protocol.kogger import (
    Attitude,
    KoggerContent,
    KoggerFrame,
    KoggerFrameDecoder,
    KoggerId,
    NavigationDepth,
    NavigationTime,
    Temperature,
    Timestamp,
    build_frame,
    parse_content,
)

VECTORS = {
    vector["name"]: vector["datagrams"]
    for vector in json.loads((Path(__file__).parents[1] / "vectors" / "kogger_vectors.json").read_text())["vectors"]
}


def decoded(data: bytes) -> KoggerFrame:
    (frame,) = KoggerFrameDecoder("mod256").feed(data)
    return frame


def test_reference_navigation_attitude_and_temperature_are_rebuilt_byte_for_byte() -> None:
    data = bytes.fromhex(VECTORS["nav_v1_attitude_temp"][0])

    contents = [parse_content(frame) for frame in KoggerFrameDecoder("mod256").feed(data)]

    navigation, attitude, temperature = contents
    assert isinstance(navigation, NavigationDepth)
    assert (navigation.yaw_rad, navigation.depth_m) == (pytest.approx(pi / 2), 12.25)
    assert attitude == Attitude(radians(90), radians(1.5), radians(-2.5))
    assert isinstance(temperature, Temperature)
    assert b"".join(content.to_bytes() for content in contents if content) == data


def test_reference_navigation_with_time_is_rebuilt_byte_for_byte() -> None:
    data = bytes.fromhex(VECTORS["nav_v2"][0])

    navigation = parse_content(decoded(data))

    assert isinstance(navigation, NavigationTime)
    assert (navigation.fix, navigation.satellites, navigation.speed_mps) == (3, 12, 1.5)
    assert navigation.to_bytes() == data


@pytest.mark.parametrize(
    "content",
    [
        Attitude(radians(-179.99), radians(12.34), radians(-45.5)),
        Temperature(-1.73),
        Timestamp(4_294_967_295),
        Timestamp(12_345, 1_800_000_000),
        NavigationDepth(-47.5, 179.999, 31.5, 0.0, 0.0, 0.0),
        NavigationTime(3, 9, 1_800_000_000_250, -47.1234567, 178.7654321, radians(-10), 0.75, 0.0, 0.0, 0.0),
    ],
    ids=lambda content: type(content).__name__,
)
def test_content_round_trip(content: KoggerContent) -> None:
    frame = decoded(content.to_bytes(route=2))

    assert frame.route == 2
    again = parse_content(frame)
    assert again is not None
    assert again == content


def test_course_of_350_degrees_fits_its_signed_field() -> None:
    navigation = NavigationTime(3, 9, 0, 0.0, 0.0, radians(350), 99.0, radians(180), 0.0, 0.0)

    again = parse_content(decoded(navigation.to_bytes()))

    assert isinstance(again, NavigationTime)
    assert again.course_rad == pytest.approx(radians(-10))
    assert again.yaw_rad == pytest.approx(-pi)
    assert again.speed_mps == 32.767


def test_other_versions_short_payloads_and_results_say_nothing() -> None:
    frames = [
        build_frame(KoggerId.ATTITUDE, bytes(16), version=1),
        build_frame(KoggerId.ATTITUDE, bytes(5)),
        build_frame(KoggerId.NAVIGATION, bytes(20)),
        build_frame(KoggerId.TEMPERATURE, bytes(2), response=True),
        build_frame(KoggerId.CHART, bytes(20)),
    ]

    assert [parse_content(decoded(frame)) for frame in frames] == [None] * len(frames)
