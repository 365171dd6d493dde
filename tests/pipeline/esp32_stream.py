"""AA55 frames for pipeline tests, from the golden vectors and from made-up pings."""

import json
from pathlib import Path

import numpy as np

from bluerov_slam.protocol.esp32_messages import (
    GpsFields,
    ImuBurstFields,
    ImuScale,
    KoggerRawFields,
    MessageType,
    StatusFields,
    encode_frame,
    pack_gps,
    pack_imu_burst,
    pack_kogger_raw,
    pack_status,
)
from bluerov_slam.protocol.kogger_bundle import compress_ping
from bluerov_slam.protocol.kogger_frame import build_frame
from bluerov_slam.protocol.ping_assembly import ChartChunk
from bluerov_slam.protocol.sensor_frame import SensorFields, pack_sensors
from bluerov_slam.records import Channel

MESSAGES = {
    message["name"]: message
    for message in json.loads((Path(__file__).parents[1] / "vectors" / "esp32.json").read_text())["messages"]
}


def sensors(name: str = "sensors_full_range", **changes: int) -> bytes:
    """One SENSORS frame."""
    return encode_frame(MessageType.SENSORS, pack_sensors(SensorFields(**{**MESSAGES[name]["fields"], **changes})))


def status(**changes: int) -> bytes:
    """One STATUS frame."""
    return encode_frame(MessageType.STATUS, pack_status(StatusFields(**{**MESSAGES["status"]["fields"], **changes})))


def gps(name: str = "gps_3d", **changes: int) -> bytes:
    """One GPS frame."""
    return encode_frame(MessageType.GPS, pack_gps(GpsFields(**{**MESSAGES[name]["fields"], **changes})))


def imu(t0_us: int) -> bytes:
    """One IMU_BURST frame of two samples, 50 ms apart."""
    samples = np.array([[1, -1, 2048, 10, 20, 30, 5, -6, 7]] * 2, np.int16)
    return encode_frame(
        MessageType.IMU_BURST, pack_imu_burst(ImuBurstFields(t0_us, 50_000, ImuScale.HWT905_RAW, samples))
    )


def golden(name: str) -> bytes:
    """A golden frame as it is."""
    return bytes.fromhex(MESSAGES[name]["frame"])


def chunks(samples: bytes, resolution_mm: int = 20) -> list[ChartChunk]:
    """A ping cut into chart chunks of 200 samples."""
    return [ChartChunk(at, resolution_mm, 0, samples[at : at + 200]) for at in range(0, len(samples), 200)]


def compressed_ping(samples: bytes, channel: Channel = Channel.A, *, number: int = 0, t_us: int = 0) -> list[bytes]:
    """The 0x04 frames of one ping."""
    payloads = compress_ping(channel, chunks(samples), ping_number=number, t_us=t_us)
    return [encode_frame(MessageType.KOGGER_COMPRESSED, payload) for payload in payloads]


def chart_frames(samples: bytes) -> list[bytes]:
    """The BB55 chart frames of one ping."""
    return [
        build_frame(3, b"".join(value.to_bytes(2, "little") for value in chunk[:3]) + chunk.samples)
        for chunk in chunks(samples)
    ]


def raw_ping(samples: bytes, channel: Channel = Channel.A, *, t_us: int = 0) -> bytes:
    """A whole ping as one KOGGER_RAW frame."""
    payload = pack_kogger_raw(KoggerRawFields(t_us, b"".join(chart_frames(samples))))
    return encode_frame(MessageType.KOGGER_RAW_A + channel.index, payload)
