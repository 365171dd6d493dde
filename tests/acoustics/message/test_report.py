"""What the transmitter says about itself comes back as it was said, and nonsense is named."""

from __future__ import annotations

import pytest

from bluerov_slam.acoustics.message.report import HOUR_US, PAYLOAD_BYTES, BeaconReport, MessageContentError


def test_report_comes_back_within_its_resolution() -> None:
    report = BeaconReport(-33.8567844, 151.2152967, 2.53, HOUR_US - 1, 1.24)

    again = BeaconReport.unpack(report.pack())

    assert again.latitude_deg == pytest.approx(-33.8567844, abs=5e-8)
    assert again.longitude_deg == pytest.approx(151.2152967, abs=5e-8)
    assert again.horizontal_std_m == pytest.approx(2.53, abs=0.005)
    assert again.time_mark_us == HOUR_US - 1
    assert again.depth_m == pytest.approx(1.2)


def test_unknown_stays_unknown() -> None:
    nothing = BeaconReport(None, None)

    assert BeaconReport.unpack(nothing.pack()) == nothing


def test_large_values_saturate_and_do_not_wrap() -> None:
    again = BeaconReport.unpack(BeaconReport(0.0, 0.0, float("inf"), 0, 400.0).pack())

    assert again.horizontal_std_m == pytest.approx(655.34)
    assert again.depth_m == pytest.approx(25.4)


@pytest.mark.parametrize(
    "report",
    [
        BeaconReport(90.1, 0.0),
        BeaconReport(0.0, float("nan")),
        BeaconReport(0.0, None),
        BeaconReport(0.0, 0.0, time_mark_us=HOUR_US),
        BeaconReport(0.0, 0.0, time_mark_us=-1),
    ],
)
def test_impossible_report_is_refused(report: BeaconReport) -> None:
    with pytest.raises(ValueError):
        report.pack()


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"", "16 bytes"),
        (b"\x02" + bytes(PAYLOAD_BYTES - 1), "kind 2"),
        (b"\x01\x7f" + bytes(PAYLOAD_BYTES - 2), "not on earth"),
        (b"\x01" + bytes(10) + b"\xff\xff\xff\x00\x00", "beyond the hour"),
    ],
)
def test_nonsense_is_named(payload: bytes, words: str) -> None:
    with pytest.raises(MessageContentError, match=words):
        BeaconReport.unpack(payload)
