"""The heaviest stream a link can carry, frame by frame, each frame findable again at the other end.

2 Hz SENSORS, 20 Hz IMU in bursts of two, 1 Hz STATUS, and 1000-sample compressed pings of both sonars in turn in
every byte that is left. A SENSORS frame is recognised by its `device_ms`, a ping by the number in its first samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bluerov_slam.protocol.esp32_messages import (
    ImuBurstFields,
    ImuScale,
    MessageType,
    encode_frame,
    pack_imu_burst,
)
from bluerov_slam.protocol.kogger_bundle import compress_ping
from bluerov_slam.protocol.ping_assembly import ChartChunk
from bluerov_slam.protocol.sensor_frame import pack_sensors, sensor_fields
from bluerov_slam.records import Channel, Sender, SensorSample

BITS_PER_BYTE = 10
PING_SAMPLES = 1000
CHUNK_SAMPLES = 200
RESOLUTION_MM = 20
SENSORS_PERIOD_S = 0.5
IMU_PERIOD_S = 0.1
NUMBER_DIGITS = 5
# Digits are spread over grey levels and held over one decimated sample, so that 4:1 mean leaves them whole.
DIGIT_STEP = 20


@dataclass(frozen=True, slots=True)
class LoadFrame:
    """One AA55 frame, and what it completes: a SENSORS frame, a ping (channel, number) or an IMU burst."""

    data: bytes
    sensors_ms: int | None = None
    ping: tuple[Channel, int] | None = None
    imu_us: int | None = None


def full_load(baud: int, *, seed: int = 1) -> Iterator[LoadFrame]:
    """Frames without end, paced so that the link at this baud rate is never idle; one frame's time is its length."""
    bytes_per_s = baud / BITS_PER_BYTE
    random = np.random.default_rng(seed)
    texture = random.gamma(2.0, 20.0, (64, PING_SAMPLES)).clip(0, 255).astype(np.uint8)
    sent, numbers, turn = 0, {Channel.A: 0, Channel.B: 0}, 0
    next_sensors_s = next_imu_s = 0.0
    while True:
        now_s = sent / bytes_per_s
        frames: list[LoadFrame] = []
        if now_s >= next_sensors_s:
            frames.append(_sensors(now_s))
            next_sensors_s += SENSORS_PERIOD_S
        if now_s >= next_imu_s:
            frames.append(_imu(now_s, random))
            next_imu_s += IMU_PERIOD_S
        if not frames:
            channel = (Channel.A, Channel.B)[turn % 2]
            turn += 1
            numbers[channel] += 1
            frames = _ping(channel, numbers[channel], int(now_s * 1e6), texture[turn % len(texture)])
        for frame in frames:
            sent += len(frame.data)
            yield frame


def ping_number(samples: np.ndarray) -> int:
    """The number that `full_load` wrote into a ping's first samples."""
    digits = np.rint(samples[: NUMBER_DIGITS * 4 : 4] / DIGIT_STEP).astype(int)
    return int("".join(map(str, digits)))


def _ping(channel: Channel, number: int, t_us: int, texture: np.ndarray) -> list[LoadFrame]:
    samples = texture.copy()
    digits = np.frombuffer(f"{number % 10**NUMBER_DIGITS:0{NUMBER_DIGITS}d}".encode(), np.uint8) - ord("0")
    samples[: NUMBER_DIGITS * 4] = np.repeat(digits * DIGIT_STEP, 4)
    chunks = [
        ChartChunk(start, RESOLUTION_MM, 0, samples[start : start + CHUNK_SAMPLES].tobytes())
        for start in range(0, PING_SAMPLES, CHUNK_SAMPLES)
    ]
    payloads = compress_ping(channel, chunks, ping_number=number % 256, t_us=t_us % 2**32)
    frames = [encode_frame(MessageType.KOGGER_COMPRESSED, payload) for payload in payloads]
    return [LoadFrame(data) for data in frames[:-1]] + [LoadFrame(frames[-1], ping=(channel, number))]


def _imu(now_s: float, random: np.random.Generator) -> LoadFrame:
    samples = random.normal(0.0, 50.0, (2, 9)).astype(np.int16)
    fields = ImuBurstFields(int(now_s * 1e6) % 2**32, 50_000, ImuScale.HWT905_RAW, samples)
    return LoadFrame(encode_frame(MessageType.IMU_BURST, pack_imu_burst(fields)))


def _sensors(now_s: float) -> LoadFrame:
    device_ms = int(now_s * 1000.0)
    sample = SensorSample(
        measured_s=now_s, arrived_s=now_s, device_ms=device_ms, sender=Sender.FULL_RANGE,
        roll_rad=0.02, pitch_rad=-0.01, yaw_rad=1.0, acceleration_frd_mps2=(0.0, 0.0, -9.81),
        imu_packets=device_ms // 50, imu_errors=0, imu_alive=True,
        gps_latitude_deg=None, gps_longitude_deg=None, gps_altitude_m=None, gps_satellites=0, gps_alive=True,
        conductivity_s_per_m=4.2, ec_salinity_psu=35.0, ec_alive=True,
        pressure_pa=250_000.0, depth_sensor_temperature_degc=12.0, depth_ok=True,
        temperature_degc=12.0, temperature_ok=True,
        sound_speed_wire_mps=1497.0, depth_wire_m=14.8, salinity_wire_psu=25.0,
        a_packets=device_ms // 10, a_bytes=device_ms * 10, b_packets=device_ms // 10, b_bytes=device_ms * 10,
    )  # fmt: skip
    return LoadFrame(encode_frame(MessageType.SENSORS, pack_sensors(sensor_fields(sample))), sensors_ms=device_ms)
