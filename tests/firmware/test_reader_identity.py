"""The C++ readers of the small sensors give, to the last bit, what the Python reference gives for the same bytes."""

import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bluerov_slam.simulation.raw_sensors import (
    EZO_OK,
    EZO_RESTARTED,
    MS5837_PROM,
    TSYS01_PROM,
    ezo_line,
    ms5837_adc,
    nmea_second,
    nmea_sentence,
    tsys01_adc,
    witmotion_packet,
    witmotion_packets,
)
from bluerov_slam.simulation.sensors import GpsReading, ImuReading
from both_readers import BothReaders
from firmware_build import built

BYTE_US = 1042
RATES_MHZ = (1_000, 2_000, 3_300, 5_000, 7_777, 10_000, 20_000)
MAX_BATCH_BYTES = 256

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def program() -> Path:
    return built("reader_filter")


def random_imu(rng: random.Random) -> bytes:
    axes = [tuple(rng.randint(-32_768, 32_767) for _ in range(3)) for _ in range(3)]
    packets = witmotion_packets(ImuReading(axes[0], axes[1], axes[2], tuple(rng.uniform(-3.2, 3.2) for _ in range(3))))
    if rng.random() < 0.1:
        packets += witmotion_packet(rng.choice((0x50, 0x55, 0x5F)), [rng.randint(-32_768, 32_767) for _ in range(4)])
    return packets


def random_gps(rng: random.Random, second: int) -> bytes:
    reading = GpsReading(
        fix=rng.choice((0, 2, 3, 3, 3)),
        satellites=rng.randint(0, 24),
        hdop=rng.uniform(0.5, 120.0),
        latitude_deg=rng.uniform(-90.0, 90.0),
        longitude_deg=rng.uniform(-180.0, 180.0),
        altitude_m=rng.uniform(-500.0, 9_000.0),
        speed_mps=rng.choice((0.0, rng.uniform(0.0, 900.0))),
        course_rad=rng.uniform(0.0, 6.3),
        utc_unix_s=rng.choice((None, 1_735_689_590.0 + second, rng.uniform(946_684_800, 4_102_444_799))),
    )
    sentences = nmea_second(reading, rng.choice(("GN", "GP", "GL"))).splitlines(keepends=True)
    if rng.random() < 0.2:
        rng.shuffle(sentences)
    if rng.random() < 0.2:
        del sentences[rng.randrange(len(sentences))]
    if rng.random() < 0.2:
        sentences.append(nmea_sentence(rng.choice(("GNVTG,,,,,,,,,N", "GPTXT,01,01,02,ANTSTATUS=OK", "PUBX,00"))))
    return b"".join(sentences)


def random_field(rng: random.Random) -> str:
    return rng.choice(
        (
            "",
            "A",
            "V",
            "N",
            "S",
            "E",
            "W",
            "-",
            ".",
            "1.2.3",
            "+5",
            "1e5",
            str(rng.randint(0, 9)),
            f"{rng.uniform(-1e4, 1e4):.{rng.randint(0, 12)}f}",
            f"{rng.randint(0, 10 ** rng.randint(1, 25))}",
            f"{rng.randint(0, 179):03d}{rng.uniform(0, 62):.5f}",
            f"{rng.randint(0, 25):02d}{rng.randint(0, 61):02d}{rng.randint(0, 62):02d}.{rng.randint(0, 999):03d}",
            f"{rng.randint(0, 33):02d}{rng.randint(0, 14):02d}{rng.randint(0, 99):02d}",
        )
    )


def absurd_sentence(rng: random.Random) -> bytes:
    kind = rng.choice(("GGA", "RMC", "GSA", "VTG"))
    fields = [random_field(rng) for _ in range(rng.randint(0, 22))]
    return nmea_sentence(",".join([f"{rng.choice(('GN', 'GP', 'G'))}{kind}", *fields])[:110])


def half_absurd_sentence(rng: random.Random, second: int) -> bytes:
    sentence = rng.choice(random_gps(rng, second).splitlines())
    fields = sentence.decode()[1:].split("*")[0].split(",")
    fields[rng.randrange(1, len(fields))] = random_field(rng)
    return nmea_sentence(",".join(fields))


def random_ec(rng: random.Random) -> bytes:
    salinity = rng.choice((None, rng.uniform(0.0, 42.0), rng.uniform(0.0, 60.0)))
    return rng.choice(
        (
            ezo_line(rng.choice((rng.uniform(40_000, 60_000), rng.uniform(0.0, 500_000.0))), salinity),
            ezo_line(rng.uniform(40_000, 60_000), rng.uniform(30.0, 40.0)),
            EZO_OK,
            EZO_RESTARTED,
            b"?O,EC,S\r",
            b"*ER\r",
            b"*OV\r",
            b"\r\n",
            f"{random_field(rng)},{random_field(rng)}\r".encode(),
            f"{random_field(rng)}\r".encode(),
            b"1413,700,0.70,1.000\r",
        )
    )


def damaged(rng: random.Random, data: bytes) -> bytes:
    what = rng.random()
    at = rng.randrange(len(data) + 1)
    if what < 0.25:
        return data[:at]
    if what < 0.5:
        return data[at:]
    if what < 0.75 and at < len(data):
        return data[:at] + bytes((data[at] ^ 1 << rng.randrange(8),)) + data[at + 1 :]
    return data[:at] + rng.randbytes(rng.randrange(1, 30)) + data[at:]


class Devices:
    """Both I2C sensors and what may go wrong with them, drawn anew for every transaction."""

    def __init__(self, rng: random.Random, trouble: float) -> None:
        self._rng, self._trouble = rng, trouble
        self._register = {0x76: 0, 0x77: 0}
        self._converted = {0x76: 0, 0x77: 0}

    def __call__(self, address: int, count: int | None, written: bytes | None) -> bytes | bool | None:
        rng = self._rng
        if rng.random() < self._trouble:
            wrong = rng.random()
            if wrong < 0.6 or count is None:
                return None
            return rng.randbytes(count) if wrong < 0.8 else bytes(count)
        if count is None:
            assert written is not None
            self._command(address, written[0])
            return True
        return self._read(address, count)

    def _command(self, address: int, code: int) -> None:
        self._register[address] = code
        rng = self._rng
        if code in (0x4A, 0x5A, 0x48):
            wide = rng.random() < 0.2
            pressure_pa = rng.uniform(-1e5, 4e6) if wide else rng.uniform(9e4, 4e5)
            temperature_degc = rng.uniform(-60.0, 140.0) if wide else rng.uniform(-2.0, 31.0)
            d1, d2 = ms5837_adc(pressure_pa, temperature_degc)
            converted = {0x4A: d1, 0x5A: d2, 0x48: tsys01_adc(temperature_degc)}
            self._converted[address] = converted[code]

    def _read(self, address: int, count: int) -> bytes:
        code = self._register[address]
        if code == 0:
            value, self._converted[address] = self._converted[address], 0
            return value.to_bytes(count, "big")
        prom = MS5837_PROM if address == 0x76 else TSYS01_PROM
        return prom[(code - 0xA0) // 2].to_bytes(count, "big")


def batches(rng: random.Random, stream: bytes, start_us: int) -> Iterator[tuple[int, bytes]]:
    """The stream as ticks take it, at the pace of 9600 baud."""
    now_us, at = start_us, 0
    while at < len(stream):
        size = min(rng.choice((1, 1, 2, 5, 44, MAX_BATCH_BYTES)), len(stream) - at)
        now_us += size * BYTE_US
        yield now_us, stream[at : at + size]
        at += size


@pytest.mark.parametrize("seed", range(40))
def test_all_readers_together_on_good_and_damaged_streams(seed: int, program: Path) -> None:
    rng = random.Random(seed)
    boot_us = rng.choice((0, 0, 123_000, (1 << 32) - 20_000_000, 50 * 86_400_000_000))
    damage = (0.0, 0.1, 0.5)[seed % 3]
    both = BothReaders(Devices(rng, damage / 5), boot_us)
    rate_mhz = rng.choice(RATES_MHZ)
    events: list[tuple[int, int, str, bytes]] = []

    def put(sensor: str, data: bytes, at_us: int) -> None:
        if rng.random() < damage:
            data = damaged(rng, data)
        events.extend((when, 0, sensor, batch) for when, batch in batches(rng, data, at_us))

    silences = [(boot_us + rng.uniform(0, 25e6), rng.uniform(0, 8e6), rng.choice(("imu", "gps", "ec"))) for _ in "12"]

    def silent(sensor: str, at_us: float) -> bool:
        return any(start <= at_us < start + span and sensor == what for start, span, what in silences)

    for step in range(600):
        at_us = boot_us + 50_000 * step + rng.randrange(3_000)
        if not silent("imu", at_us):
            put("imu", random_imu(rng) if rng.random() > damage / 5 else rng.randbytes(60), at_us)
        if step % 20 == 7 and not silent("gps", at_us):
            sentences = random_gps(rng, step // 20)
            if rng.random() < damage:
                sentences += half_absurd_sentence(rng, step // 20) + absurd_sentence(rng)
            put("gps", sentences, at_us)
        if step % 20 == 11 and not silent("ec", at_us):
            put("ec", random_ec(rng) if damage else ezo_line(rng.uniform(4e4, 6e4), rng.uniform(30, 40)), at_us)
    ticks = ((boot_us + 1000 * tick, 1, "tick", b"") for tick in range(1, 31_000) if tick % 3 == 0 or tick % 50 < 12)
    for at_us, _, what, data in sorted([*events, *ticks]):
        if what != "tick":
            both.feed(what, data, at_us, rate_mhz)
            continue
        both.i2c(at_us)
        if (at_us - boot_us) % 10_000 == 0:
            both.jobs(at_us, rate_mhz)
        if (at_us - boot_us) % 250_000 == 0:
            both.fill(at_us)
        if rng.random() < 0.0003:
            rate_mhz = rng.choice(RATES_MHZ)
            both.rate_changed()
    both.check_against(program)
    said = {line.split()[0] for line in both.said}
    assert {"burst", "gps", "port", "write", "read", "fields"} <= said


@pytest.mark.parametrize("seed", range(20))
def test_absurd_sentences(seed: int, program: Path) -> None:
    rng = random.Random(1000 + seed)
    both = BothReaders()
    now_us = 0
    for second in range(300):
        sentence = absurd_sentence(rng) if rng.random() < 0.3 else half_absurd_sentence(rng, second // 4)
        for at_us, batch in batches(rng, sentence, now_us):
            both.feed("gps", batch, at_us)
        now_us += len(sentence) * BYTE_US
        now_us += rng.choice((0, 1_000, 300_000, 900_000, 5_000_000))
        both.jobs(now_us)
        both.fill(now_us)
    both.check_against(program)
    assert both.gps.errors < 200


@pytest.mark.parametrize("seed", range(10))
def test_lines_of_the_probe_with_any_gaps(seed: int, program: Path) -> None:
    rng = random.Random(2000 + seed)
    both = BothReaders()
    now_us = 0
    for _ in range(400):
        line = random_ec(rng)
        if rng.random() < 0.3:
            line = damaged(rng, line)
        for batch in (line[:4], line[4:]):
            now_us += len(batch) * BYTE_US + rng.choice((0, 0, 0, 99_000, 101_000, 2_500_000))
            both.feed("ec", batch, now_us)
        now_us += rng.choice((0, 900_000, 2_990_000, 3_010_000))
        both.jobs(now_us)
        both.fill(now_us)
    both.check_against(program)


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(("imu", "gps", "ec")),
    st.lists(
        st.tuples(
            st.integers(0, 2_000_000),
            st.one_of(
                st.binary(max_size=MAX_BATCH_BYTES),
                st.text("$GNRMCGAS,*0123456789.-AVNEW\r\n", max_size=120).map(str.encode),
                st.text("0123456789,.*?OKERS\r\n", max_size=60).map(str.encode),
                st.lists(st.sampled_from(list(bytes((0x55, 0x51, 0x52, 0x53, 0x54, 0, 1, 0xA6)))), max_size=60).map(
                    bytes
                ),
            ),
        ),
        max_size=30,
    ),
)
def test_any_bytes_at_any_times(program: Path, sensor: str, feeds: list[tuple[int, bytes]]) -> None:
    both = BothReaders()
    now_us = 0
    for pause_us, data in feeds:
        now_us += pause_us
        both.feed(sensor, data, now_us)
        both.jobs(now_us)
        both.fill(now_us)
    both.check_against(program)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.randoms(use_true_random=False), st.floats(0.0, 1.0))
def test_i2c_devices_in_any_trouble(program: Path, rng: random.Random, trouble: float) -> None:
    both = BothReaders(Devices(rng, trouble**2))
    now_us = 0
    for _ in range(300):
        now_us += rng.choice((1_000, 1_000, 1_000, 20_000, 100_000, 600_000))
        both.i2c(now_us)
        both.fill(now_us)
    both.check_against(program)


def test_sea_water_over_the_whole_range_of_the_sensors(program: Path) -> None:
    rng = random.Random(7)
    both = BothReaders(Devices(rng, 0.0))
    for tick in range(1, 40_000):
        now_us = 1000 * tick
        both.i2c(now_us)
        if tick % 500 == 0:
            both.feed("ec", b"\r" + ezo_line(rng.uniform(0, 90_000), 35.0), now_us)
        if tick % 100 == 0:
            both.fill(now_us)
    both.check_against(program)
