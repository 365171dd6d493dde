import csv
import io
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from bluerov_slam.cli.main import cli
from bluerov_slam.errors import ExpectedError
from bluerov_slam.protocol.kogger import Attitude, NavigationTime, parse_content
from bluerov_slam.protocol.kogger_frame import KoggerFrameDecoder, KoggerId, build_frame, reroute
from bluerov_slam.protocol.ping_assembly import PingAssembler
from bluerov_slam.records import Channel, LinkBytes, Ping, Record, SonarFrames
from bluerov_slam.sinks.dive_track import DiveTrack
from bluerov_slam.sinks.klf_writer import KlfWriter
from bluerov_slam.sinks.xtf_writer import XtfWriter
from recording_samples import gps_fix, ping, sensor_sample
from simulated_dive import record_dive

pyxtf = pytest.importorskip("pyxtf")

Dive = tuple[Path, list[LinkBytes], list[Record]]


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Dive:
    """Thirty seconds: at the surface with GPS until 20 s, then under water without."""
    return record_dive(tmp_path_factory.mktemp("dive"), 30.0)


def converted(source: Path, target: str, output: Path, *options: str) -> str:
    arguments = ["convert", str(source), "--to", target, "-o", str(output), *options]
    result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def refused(*arguments: str) -> str:
    with pytest.raises(ExpectedError) as caught:
        CliRunner().invoke(cli, ["convert", *arguments], catch_exceptions=False)
    return str(caught.value)


def pings_of(records: list[Record], channel: Channel) -> list[Ping]:
    return [r for r in records if isinstance(r, Ping) and r.channel is channel]


def read_xtf(path: Path) -> tuple[object, list[object]]:
    header, packets = pyxtf.xtf_read(str(path))
    assert list(packets) == [pyxtf.XTFHeaderType.sonar], "nothing but sonar packets"
    return header, packets[pyxtf.XTFHeaderType.sonar]


def test_jsonl_is_the_log_that_was_written_live(dive, tmp_path):
    session, _, _ = dive
    output = converted(session, "jsonl", tmp_path / "out.jsonl")
    assert (tmp_path / "out.jsonl").read_bytes() == next(session.glob("*.jsonl")).read_bytes()
    assert "60 sensor lines" in output


def test_csv_has_a_row_for_every_sample_fix_and_ping(dive, tmp_path):
    session, _, live = dive
    converted(session, "csv", tmp_path / "out")
    tables = {
        name: list(csv.DictReader((tmp_path / "out" / name).open())) for name in ("sensors.csv", "gps.csv", "pings.csv")
    }
    assert len(tables["sensors.csv"]) == 60
    assert len(tables["pings.csv"]) == sum(isinstance(r, Ping) for r in live)
    first, last = tables["pings.csv"][150], tables["pings.csv"][-1]
    assert first["utc"].startswith("2026-06-01T08:00:0"), "dated by the dive's GPS, not by the wall clock"
    assert float(first["latitude_deg"]) != 0.0
    assert last["latitude_deg"] == "", "no position under water"
    assert float(first["range_m"]) == pytest.approx(20.0)
    assert all(row["roll_deg"] for row in tables["sensors.csv"])


def test_klf_holds_every_sonar_frame_under_its_own_address(dive, tmp_path):
    session, _, live = dive
    converted(session, "klf", tmp_path / "out.klf")
    decoder = KoggerFrameDecoder("mod256")
    frames = decoder.feed((tmp_path / "out.klf").read_bytes())
    assert decoder.counters.bytes_skipped == 0
    for channel, route in ((Channel.A, 1), (Channel.B, 2)):
        sent = [f for r in live if isinstance(r, SonarFrames) and r.channel is channel for f in r.frames]
        written = [f.to_bytes(route=0) for f in frames if f.route == route and parse_content(f) is None]
        assert written == sent
        assembler = PingAssembler(channel)
        assembled = [p for f in frames if f.route == route for p in assembler.feed(f, 0.0, 0.0)]
        expected = pings_of(live, channel)
        assert len(assembled) >= len(expected) - 1
        same = [np.array_equal(p.samples, q.samples) for p, q in zip(assembled, expected, strict=False)]
        assert sum(same) >= len(same) - 2, "all but a first ping that was joined midway"


def test_klf_begins_with_port_and_gives_one_position_per_ping_while_known(dive, tmp_path):
    session, _, live = dive
    converted(session, "klf", tmp_path / "out.klf")
    frames = KoggerFrameDecoder("mod256").feed((tmp_path / "out.klf").read_bytes())
    sonar = [f for f in frames if parse_content(f) is None]
    assert sonar[0].route == 2, "KoggerApp draws the channel that comes first as port"
    content = [parse_content(f) for f in frames]
    attitudes = [c for c in content if isinstance(c, Attitude)]
    positions = [c for c in content if isinstance(c, NavigationTime)]
    assert abs(len(attitudes) - len(pings_of(live, Channel.B))) <= 1
    assert 100 < len(positions) < len(attitudes)
    assert all(p.latitude_deg and p.longitude_deg and p.fix >= 2 for p in positions)
    assert positions[0].unix_ms // 1000 in range(1780300800, 1780300830)


@pytest.mark.parametrize("seq_offset", [19_800, 65_000, 65_535])
def test_klf_leaves_out_a_chart_that_would_crash_koggerapp(seq_offset):
    good, deadly = (
        build_frame(KoggerId.CHART, offset.to_bytes(2, "little") + b"\x14\0\0\0" + bytes(200))
        for offset in (0, seq_offset)
    )
    stream = io.BytesIO()
    writer = KlfWriter(stream, DiveTrack(None))
    writer.write(SonarFrames(Channel.B, 1.0, 1.0, (good, deadly), None))
    writer.finish()
    assert stream.getvalue() == reroute(good, 2)
    assert (writer.counts.frames_b, writer.counts.refused) == (1, 1)


def test_xtf_reopens_with_the_same_samples(dive, tmp_path):
    session, _, live = dive
    output = converted(session, "xtf", tmp_path / "out.xtf")
    header, packets = read_xtf(tmp_path / "out.xtf")
    assert [int(c.TypeOfChannel) for c in header.ChanInfo[:2]] == [1, 2]
    starboard = [p.data[1] for p in packets if p.data[1].any()]
    port = [p.data[0][::-1] for p in packets if p.data[0].any()]
    expected_a = [p.samples for p in pings_of(live, Channel.A) if p.samples.any()]
    expected_b = [p.samples for p in pings_of(live, Channel.B) if p.samples.any()]
    assert len(starboard) == len(expected_a) > 200
    assert len(port) == len(expected_b) > 200
    assert all(np.array_equal(a, b) for a, b in zip(starboard, expected_a, strict=True))
    assert all(np.array_equal(a, b) for a, b in zip(port, expected_b, strict=True))
    assert f"{len(packets)} records" in output


def test_xtf_carries_time_position_attitude_and_range_as_far_as_known(dive, tmp_path):
    session, _, _ = dive
    converted(session, "xtf", tmp_path / "out.xtf")
    _, packets = read_xtf(tmp_path / "out.xtf")
    surface, dived = packets[len(packets) // 3], packets[-1]
    assert (surface.Year, surface.Month, surface.Day) == (2026, 6, 1)
    assert surface.JulianDay == 152
    assert surface.SensorYcoordinate == surface.ShipYcoordinate != 0.0
    assert 0.0 < surface.SensorHeading < 360.0
    assert (dived.SensorYcoordinate, dived.SensorXcoordinate) == (0.0, 0.0)
    assert surface.SoundVelocity == pytest.approx(757.0, abs=10.0), "half the sound speed"
    side = surface.ping_chan_headers[1]
    assert side.SlantRange == pytest.approx(20.0)
    assert side.TimeDuration == pytest.approx(20.0 / surface.SoundVelocity, rel=1e-5)
    assert side.SecondsPerPing == pytest.approx(0.1, abs=0.02)


def test_xtf_obeys_the_rules_of_koggerapps_reader(dive, tmp_path):
    session, _, _ = dive
    converted(session, "xtf", tmp_path / "out.xtf")
    data = (tmp_path / "out.xtf").read_bytes()
    assert data[0] == 123
    position, numbers = 1024, []
    while position < len(data):
        assert data[position : position + 2] == b"\xce\xfa"
        assert data[position + 2] == 0, "sonar packets only"
        channels = int.from_bytes(data[position + 4 : position + 6], "little")
        size = int.from_bytes(data[position + 10 : position + 14], "little")
        numbers.append(int.from_bytes(data[position + 28 : position + 32], "little"))
        content = position + 256
        for _ in range(channels):
            content += 64 + int.from_bytes(data[content + 42 : content + 46], "little")
        assert content == position + size, "exactly header and channels, no padding"
        position += size
    assert position == len(data)
    assert numbers == list(range(1, len(numbers) + 1))


def test_an_xtf_without_time_or_position_keeps_intervals_and_zeros(tmp_path):
    track = DiveTrack.of([], None)
    path = tmp_path / "out.xtf"
    with path.open("wb") as stream:
        writer = XtfWriter(stream, track)
        for number in range(3):
            writer.write(ping(Channel.A, 100.0 + number, number))
        writer.finish()
    _, packets = read_xtf(path)
    assert writer.counts.single == 3
    assert [(p.Year, p.Minute, p.Second) for p in packets] == [(1970, 1, 40), (1970, 1, 41), (1970, 1, 42)]
    assert packets[0].SensorHeading == 0.0
    assert not packets[0].data[0].any()


def test_a_sonar_with_both_sides_fills_both_channels(tmp_path):
    path = tmp_path / "out.xtf"
    with path.open("wb") as stream:
        writer = XtfWriter(stream, DiveTrack.of([], None), dual=frozenset({Channel.A}))
        for number in range(1, 4):
            writer.write(ping(Channel.A, 100.0 + number, number))
            writer.write(replace(ping(Channel.A, 100.0 + number, number + 50), sub_channel=1))
        writer.finish()
    _, packets = read_xtf(path)
    assert len(packets) == 3
    assert packets[0].data[0][-1] == 1
    assert packets[0].data[1][0] == 51


def test_a_position_ages_and_gps_time_wins_over_the_wall_clock():
    fixes = [gps_fix(at_s, 1_760_000_000.0 + at_s) for at_s in (10.0, 11.0, 12.0)]
    track = DiveTrack.of([*fixes, sensor_sample(10.0), sensor_sample(14.0)], utc_offset_s=5.0)
    assert track.at(11.5).latitude_deg == pytest.approx(48.1)
    assert track.at(16.0).latitude_deg is None
    assert track.at(16.0).yaw_rad == pytest.approx(1.5)
    assert track.at(18.0).yaw_rad is None
    assert track.at(20.0).utc_unix_s == pytest.approx(1_760_000_020.0)


def test_headings_are_interpolated_across_north():
    samples = [replace(sensor_sample(at_s), yaw_rad=math.radians(yaw)) for at_s, yaw in ((1.0, 350.0), (2.0, 10.0))]
    track = DiveTrack.of(samples, None)
    assert math.degrees(track.at(1.5).yaw_rad) % 360.0 == pytest.approx(0.0, abs=1e-6)
    assert track.at(1.5).utc_unix_s is None


def test_a_plain_capture_converts_too(dive, tmp_path):
    _, blocks, _ = dive
    capture = tmp_path / "capture.bin"
    capture.write_bytes(b"".join(block.data for block in blocks))
    converted(capture, "jsonl", tmp_path / "out.jsonl")
    lines = [json.loads(line) for line in (tmp_path / "out.jsonl").read_text().splitlines()]
    assert len(lines) == 60
    assert lines[0]["t_unix"] is None


def test_crossed_cables_can_be_put_right(dive, tmp_path):
    session, _, live = dive
    converted(session, "xtf", tmp_path / "out.xtf", "--swap")
    _, packets = read_xtf(tmp_path / "out.xtf")
    starboard = [p.data[1] for p in packets if p.data[1].any()]
    expected = [p.samples for p in pings_of(live, Channel.B) if p.samples.any()]
    assert all(np.array_equal(a, b) for a, b in zip(starboard, expected, strict=True))


def test_a_cut_recording_converts_as_far_as_it_reads_and_says_so(dive, tmp_path):
    session, _, _ = dive
    cut = tmp_path / "link_000.mcap"
    cut.write_bytes((session / "link_000.mcap").read_bytes()[:300_000])
    output = converted(cut, "jsonl", tmp_path / "out.jsonl")
    assert output.count("was cut short") == 1
    assert len((tmp_path / "out.jsonl").read_bytes().splitlines()) > 10


def test_an_existing_output_is_only_replaced_when_asked(dive, tmp_path):
    session, _, _ = dive
    output = tmp_path / "out.jsonl"
    output.write_text("mine")
    assert "add --force" in refused(str(session), "--to", "jsonl", "-o", str(output))
    assert output.read_text() == "mine"
    converted(session, "jsonl", output, "--force")
    converted(session, "csv", tmp_path / "tables")
    converted(session, "csv", tmp_path / "tables", "--force")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.jsonl", "tables"]


def test_without_an_output_name_it_lands_beside_the_recording(dive, tmp_path):
    session, _, _ = dive
    result = CliRunner().invoke(cli, ["convert", str(session), "--to", "jsonl"])
    expected = session.parent / f"{session.name}.jsonl"
    assert expected.exists(), result.output
    expected.unlink()


@pytest.mark.parametrize(
    ("content", "target", "cure"),
    [
        (b"", "jsonl", "is empty"),
        (b"hello", "klf", "is no recording"),
        (b"\xaa\x55 but nothing after it" * 50, "csv", "no frame of it inside"),
    ],
)
def test_what_cannot_be_converted_is_refused_in_one_line_with_nothing_left_behind(tmp_path, content, target, cure):
    source = tmp_path / "file.bin"
    source.write_bytes(content)
    message = refused(str(source), "--to", target, "-o", str(tmp_path / "out"))
    assert cure in message
    assert "\n" not in message
    assert [path.name for path in tmp_path.iterdir()] == ["file.bin"]


def test_a_dive_without_sonar_has_no_sonar_file(tmp_path):
    faults = [f"kind=silent sensor={sonar} at=0 duration=99" for sonar in "ab"]
    session, _, _ = record_dive(tmp_path, 4.0, faults=faults)
    assert "holds no sonar data" in refused(str(session), "--to", "xtf", "-o", str(tmp_path / "out.xtf"))


def test_an_output_that_cannot_be_written_is_named(dive, tmp_path):
    session, _, _ = dive
    assert "cannot write" in refused(str(session), "--to", "jsonl", "-o", str(tmp_path / "no" / "such" / "out.jsonl"))
