"""The native firmware and the Python reference give the same bytes at the same times, whatever comes in.

Both are driven at once by the surroundings of the virtual ESP32. Ten minutes bring every fault, every kind of
command and more load than the line carries; shorter runs bring the wraps of the timer and other settings.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np
import pytest
from numpy.typing import NDArray

from bluerov_slam.protocol.esp32_messages import (
    ConfigKey,
    MessageType,
    encode_config,
    encode_frame,
    encode_kogger_command,
    encode_time_sync,
)
from bluerov_slam.protocol.kogger_frame import FrameType, KoggerId, build_frame, build_v2_frame
from bluerov_slam.records import Channel
from bluerov_slam.simulation.board import Port, Sink
from bluerov_slam.simulation.faults import parse_fault
from bluerov_slam.simulation.reference_board import ReferenceBoard
from bluerov_slam.simulation.scenario import SCENARIOS, Scenario
from bluerov_slam.simulation.scene import DifferencedMotion
from bluerov_slam.simulation.vehicle import VehicleState
from bluerov_slam.simulation.virtual_esp32 import VirtualEsp32
from bluerov_slam.sources.native_board import NativeBoard
from firmware_build import built
from paired_boards import Damage, DamagedInputs, PairedBoards

pytestmark = pytest.mark.timeout(300)

STEP_S = 0.1
FAULTS = (
    "at=20 kind=silent sensor=imu duration=6", "at=31 kind=silent sensor=gps duration=5",
    "at=40 kind=silent sensor=ec duration=24", "at=45 kind=silent sensor=depth duration=3",
    "at=47 kind=silent sensor=celsius duration=4", "at=55 kind=i2c_errors duration=6",
    "at=65 kind=silent sensor=a duration=3", "at=66 kind=silent sensor=b duration=0.013",
    "at=70 kind=mid_ping sensor=a", "at=75 kind=probe duration=3 rate=7", "at=80 kind=reset reason=9",
    "at=95 kind=unplug duration=1.3", "at=100 kind=silent sensor=imu duration=0.02",
    "at=103 kind=i2c_errors duration=0.3", "at=320 kind=reset reason=4", "at=333 kind=silent sensor=gps duration=1.7",
    "at=500 kind=i2c_errors duration=3", "at=505 kind=silent sensor=celsius duration=9",
)  # fmt: skip
MUST_HAVE_COUNTED = (
    "a_pings_dropped", "b_pings_dropped", "a_frame_errors", "b_frame_errors", "a_overflow_bytes", "b_overflow_bytes",
    "i2c_errors", "imu_errors", "gps_errors", "ec_errors", "bad_commands", "echoed_host_us", "satellites",
    "imu_alive", "gps_alive", "ec_alive", "depth_ok", "temperature_ok", "longitude_e7",
)  # fmt: skip
# Seconds: line, damage. Chances per byte.
DAMAGE = (
    (110, 130, Port.HOST, Damage(flip=0.01, lose=0.003, noise=0.002)),
    (120, 140, Port.SONAR_A, Damage(flip=0.002, lose=0.0005, noise=0.0005)),
    (125, 145, Port.SONAR_B, Damage(flip=0.0005, lose=0.002, noise=0.001)),
    (130, 150, Port.IMU, Damage(flip=0.01, lose=0.005, noise=0.005)),
    (135, 155, Port.GPS, Damage(flip=0.004, lose=0.002, noise=0.002)),
    (140, 180, Port.EC, Damage(flip=0.02, lose=0.01, noise=0.01)),
    (400, 420, Port.HOST, Damage(flip=0.02)),
    (410, 430, Port.SONAR_B, Damage(noise=0.002)),
    (420, 430, Port.IMU, Damage(noise=0.02)),
)


class DivingScene(DifferencedMotion):
    """Any depth down to 90 m within minutes, and echoes out of a bank: the bytes matter here, not the seabed."""

    origin_latitude_deg, origin_longitude_deg = -33.9, 151.2

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._bank = np.cumsum(rng.integers(-9, 10, (64, 5000)), axis=1).astype(np.uint8)

    def state(self, mission_s: float) -> VehicleState:
        depth_m = max(0.0, 90.0 * math.sin(mission_s / 40.0) - 0.5)
        return VehicleState(
            north_m=0.6 * mission_s,
            east_m=-0.3 * mission_s,
            depth_m=depth_m,
            roll_rad=0.9 * math.sin(mission_s / 3.0),
            pitch_rad=0.5 * math.sin(mission_s / 7.0),
            yaw_rad=math.remainder(mission_s / 11.0, 2.0 * math.pi),
            speed_mps=0.67,
            fix_possible=depth_m == 0.0,
        )

    def ping(
        self, side: int, mission_s: float, samples: int, resolution_m: float, first_sample: int
    ) -> NDArray[np.uint8]:
        return self._bank[(int(mission_s * 10.0) + 7 * side) % 64, :samples]


class Rig:
    """Both boards in one surroundings, and a host that says all sorts of things."""

    def __init__(self, scenario: Scenario, baud: int = 115_200) -> None:
        self.pair = PairedBoards(ReferenceBoard(), NativeBoard(built("brov-firmware")))
        self.inputs = DamagedInputs(self.pair, scenario.seed)
        self.esp32 = VirtualEsp32(scenario, baud, DivingScene(scenario.seed), self.inputs)
        self._rng = np.random.default_rng([scenario.seed, 0x4057])
        self._sequence = 0

    def run(
        self,
        until_s: float,
        script: Mapping[float, Callable[[], None]] = MappingProxyType({}),
        command_every_s: float = 0.35,
    ) -> None:
        """Go on to this time; the script's actions come at theirs."""
        waiting = sorted(script.items())
        next_command_s = self.esp32.now_s + command_every_s
        while self.esp32.now_s < until_s:
            while waiting and waiting[0][0] <= self.esp32.now_s:
                waiting.pop(0)[1]()
            for start_s, end_s, port, damage in DAMAGE:
                if start_s <= self.esp32.now_s < end_s:
                    self.inputs.damage[port] = damage
                elif self.inputs.damage.get(port) is damage:
                    del self.inputs.damage[port]
            if self.esp32.now_s >= next_command_s:
                next_command_s += command_every_s
                self.say(self._anything())
            self.esp32.advance(self.esp32.now_s + STEP_S * (0.5 + self._rng.random()))

    def say(self, *frames: bytes) -> None:
        """The host sends this now."""
        self.esp32.receive(b"".join(frames), self.esp32.now_s)

    def config(self, **values: int) -> None:
        """Have the board obey this."""
        self.say(encode_config(self._next(), {ConfigKey[key.upper()]: value for key, value in values.items()}))

    def chart(self, channel: Channel, samples: int, resolution_mm: int = 20, period_ms: int = 100) -> None:
        """Have a sonar ping like this."""
        chart = samples.to_bytes(2, "little") + resolution_mm.to_bytes(2, "little") + b"\0\0"
        dataset = b"\1" + period_ms.to_bytes(4, "little") + (2).to_bytes(4, "little")
        for frame_id, payload in ((KoggerId.CHART_SETUP, chart), (KoggerId.DATASET, dataset)):
            command = build_frame(frame_id, payload, frame_type=FrameType.SETTING, response=True)
            self.say(encode_kogger_command(channel, self._next(), command))

    def hurry(self, channel: Channel, duration_s: float) -> None:
        """Commands so close that some are answered with busy, if the sonar does not answer."""
        command = build_frame(KoggerId.VERSION, frame_type=FrameType.GETTING, response=True)
        end_s = self.esp32.now_s + duration_s
        while self.esp32.now_s < end_s:
            frame = encode_kogger_command(channel, self._next(), command)
            self.esp32.receive(frame, self.esp32.now_s + 0.02 + 0.04 * self._rng.random())

    def flood(self, port: Port, count: int) -> None:
        """So many bytes at one instant: noise with whole frames in it."""
        noise = self._rng.integers(0, 256, count, np.uint8).tobytes()
        frames = b"".join(
            build_frame(KoggerId.CHART, bytes((0, i, 20, 0, 0, 0)) + bytes(200)) for i in range(count // 400)
        )
        host = b"".join(self._anything() for _ in range(count // 40))
        self.inputs.flood(port, (host if port is Port.HOST else frames) + noise)

    def _next(self) -> int:
        self._sequence = self._sequence + 1 & 0xFF
        return self._sequence

    def _anything(self) -> bytes:
        """One of the things that a host may say, bad ones among them."""
        rng, sequence = self._rng, self._next()
        channel = Channel.A if rng.random() < 0.5 else Channel.B
        getting = build_frame(int(rng.integers(0x10, 0x24)), b"\1", frame_type=FrameType.GETTING, response=True)
        setting = build_frame(KoggerId.SOUND_SPEED, (1_480_000).to_bytes(4, "little"), frame_type=2, response=True)
        key = ConfigKey(int(rng.integers(1, 4)))
        value = int(rng.choice([0, 1, 3, 8, 499, 1_000, 3_333, 5_000, 20_000, 1 << 31]))
        choices = (
            lambda: encode_time_sync(sequence, int(rng.integers(0, 1 << 63))),
            lambda: encode_config(sequence, {key: value}),
            lambda: encode_config(sequence, {ConfigKey.DECIMATION: value % 8 + 1, ConfigKey.SENSORS_RATE_MHZ: 2_000}),
            lambda: encode_frame(MessageType.CONFIG, bytes((sequence, 9, 1, 0, 0, 0))),
            lambda: encode_kogger_command(channel, sequence, getting),
            lambda: encode_kogger_command(channel, sequence, setting),
            lambda: encode_kogger_command(channel, sequence, setting[:-1] + b"\0"),
            lambda: encode_kogger_command(channel, sequence, setting + setting),
            lambda: encode_kogger_command(channel, sequence, build_v2_frame(KoggerId.MARK, b"")),
            lambda: encode_kogger_command(channel, sequence, build_frame(KoggerId.UART, bytes(9), frame_type=2)),
            lambda: encode_kogger_command(channel, sequence, getting) * int(rng.integers(1, 12)),
            lambda: encode_frame(int(rng.integers(0x24, 0x100)), rng.bytes(int(rng.integers(0, 300)))),
            lambda: encode_frame(MessageType.SENSORS, bytes(76)),
            lambda: encode_time_sync(sequence, 1)[:-1] + b"\x77",
            lambda: rng.bytes(int(rng.integers(1, 60))),
        )  # fmt: skip
        return choices[int(rng.integers(len(choices)))]()


@pytest.fixture
def rigs() -> Iterator[Callable[..., Rig]]:
    made: list[Rig] = []

    def make(scenario: Scenario, baud: int = 115_200) -> Rig:
        made.append(Rig(scenario, baud))
        return made[-1]

    yield make
    for rig in made:
        rig.esp32.close()


def test_ten_minutes_of_faults_give_the_same_bytes_at_the_same_times(rigs: Callable[..., Rig]) -> None:
    scenario = Scenario(
        name="identity",
        seed=11,
        samples=600,
        dual_channel_a=True,
        checksum_b="mod255",
        new_sensors=True,
        uptime_s=4_294.0,  # t_us wraps within a second
        faults=tuple(map(parse_fault, FAULTS)),
    )
    rig = rigs(scenario)
    a, b = Channel.A, Channel.B
    # Both ways through the loads between which the hysteresis of raw and compressed lies, half a per cent a step.
    rising = {344.0 + 0.9 * step: partial(rig.chart, a, 1_500 + 20 * step) for step in range(36)}
    falling = {378.0 + 0.9 * step: partial(rig.chart, a, 2_200 - 20 * step) for step in range(36)}
    rig.run(
        600.0,
        {
            65.2: lambda: rig.hurry(a, 2.7),
            160.0: lambda: rig.chart(a, 1_500),
            161.0: lambda: rig.chart(b, 3_000, 10),
            185.0: lambda: rig.flood(Port.SONAR_A, 20_000),
            186.0: lambda: rig.flood(Port.HOST, 3_000),
            187.0: lambda: rig.flood(Port.IMU, 700),
            188.0: lambda: rig.flood(Port.SONAR_B, 40_000),
            # Commands come all the time, so the trial of a new rate ends well.
            200.0: lambda: rig.config(baud=921_600),
            230.0: lambda: rig.config(sensors_rate_mhz=20_000, imu_rate_mhz=20_000, decimation=1),
            240.0: lambda: rig.chart(b, 500, 30, 50),
            260.0: lambda: rig.chart(a, 200),
            300.0: lambda: rig.config(imu_rate_mhz=3_000, baud=115_200),
            310.0: lambda: rig.config(baud=921_600, sensors_rate_mhz=500),
            335.0: lambda: rig.config(baud=921_600),
            343.0: lambda: rig.chart(b, 3_000, 10),
            **rising,
            **falling,
            450.0: lambda: rig.chart(b, 100, 100, 1_000),
            451.0: lambda: rig.chart(a, 100, 100, 1_000),  # so little that all of it goes raw at 115200 too
            480.0: lambda: rig.chart(a, 2_400, 10, 40),
            490.0: lambda: rig.config(baud=115_200),
            493.0: lambda: rig.config(baud=921_600),
            493.5: lambda: rig.config(baud=115_200),
        },
    )
    assert set(rig.pair.frames) == {
        MessageType.SENSORS, MessageType.KOGGER_RAW_A, MessageType.KOGGER_RAW_B, MessageType.KOGGER_COMPRESSED,
        MessageType.IMU_BURST, MessageType.STATUS, MessageType.COMMAND_ACK, MessageType.GPS,
    }  # fmt: skip
    assert set(rig.pair.outputs) == set(Sink)
    assert [name for name in MUST_HAVE_COUNTED if not rig.pair.highest[name]] == []
    assert rig.pair.boots == 4
    assert sum(rig.pair.frames.values()) > 20_000


def test_a_rate_that_nobody_confirms_is_taken_back_at_the_same_tick(rigs: Callable[..., Rig]) -> None:
    rig = rigs(replace(SCENARIOS["saturated"], mission_start_s=20.0))
    rig.config(baud=921_600)
    rig.run(3.0, command_every_s=math.inf)
    assert rig.esp32.baud == 921_600
    rig.run(8.0, command_every_s=math.inf)
    assert rig.esp32.baud == 115_200
    assert rig.pair.outputs[Sink.LINK_BAUD] == 2


@pytest.mark.parametrize(
    ("changes", "baud"),
    [
        ({"uptime_s": 4_294_960.0, "coding": "peak"}, 115_200),  # ts wraps on the way
        ({"samples": 3_000, "resolution_mm": 10, "decimation": 3}, 921_600),
        ({"samples": 77, "decimation": 8, "ping_period_ms": 10, "clock_drift_ppm": -80.0}, 115_200),
        ({"coding": "coded", "dual_channel_a": True}, 115_200),
        ({"samples": 5_000, "resolution_mm": 1, "sensors_rate_mhz": 20_000, "imu_rate_mhz": 1_000}, 115_200),
    ],
    ids=["late timer", "fast line", "short pings", "coded pings", "long pings"],
)
def test_other_settings_give_the_same_bytes_too(
    changes: dict[str, float | str], baud: int, rigs: Callable[..., Rig]
) -> None:
    rig = rigs(replace(SCENARIOS["survey"], seed=3, **changes), baud)
    rig.run(20.0)
    assert sum(rig.pair.frames.values()) > 500


def test_a_difference_is_named_with_its_time_and_both_frames() -> None:
    class Deaf(ReferenceBoard):
        """Never hears its GPS receiver."""

        def feed(self, port: int, data: bytes, at_us: int) -> None:
            if port != Port.GPS:
                super().feed(port, data, at_us)

    esp32 = VirtualEsp32(SCENARIOS["survey"], scene=DivingScene(1), board=PairedBoards(ReferenceBoard(), Deaf()))
    with pytest.raises(
        AssertionError, match=r"boot 1, output \d+ differs\n  reference: LINK at 1\d{6} us: GPS GpsFields"
    ):
        esp32.advance(3.0)
