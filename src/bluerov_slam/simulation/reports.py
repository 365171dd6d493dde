"""Payloads of the board's reports beside SENSORS: IMU_BURST, GPS; and the texts that are no frames at all."""

from __future__ import annotations

import math

import numpy as np

from bluerov_slam.protocol.esp32_messages import GpsFields, ImuBurstFields, ImuScale, pack_gps, pack_imu_burst
from bluerov_slam.simulation.sensors import GpsReading, ImuReading

_IMU_BURST_S = 0.1  # the protocol allows no more data than this in one burst
_RESET_CODES = {
    1: "0x1 (POWERON_RESET)",
    3: "0xc (SW_CPU_RESET)",
    4: "0xc (SW_CPU_RESET)",
    9: "0xf (RTCWDT_BROWN_OUT_RESET)",
}
_BOOT_TEXT = (
    "ets Jul 29 2019 12:21:46\r\n\r\nrst:{code},boot:0x13 (SPI_FAST_FLASH_BOOT)\r\nconfigsip: 0, SPIWP:0xee\r\n"
    "clk_drv:0x00,q_drv:0x00,d_drv:0x00,cs0_drv:0x00,hd_drv:0x00,wp_drv:0x00\r\nmode:DIO, clock div:1\r\n"
    "load:0x3fff0030,len:1344\r\nload:0x40078000,len:13964\r\nload:0x40080400,len:3600\r\nentry 0x400805f0\r\n"
)


class ImuBurstCollector:
    """Gathers samples until a burst is full."""

    def __init__(self) -> None:
        self._samples: list[tuple[int, ...]] = []
        self._t0_us = 0

    def add(self, reading: ImuReading | None, t_us: int, interval_s: float) -> bytes | None:
        """Take one sample; the payload of IMU_BURST when one is due. A silent IMU ends the burst without a trace."""
        if reading is None:
            self._samples.clear()
            return None
        if not self._samples:
            self._t0_us = t_us
        self._samples.append((*reading.acceleration, *reading.angular_rate, *reading.magnetic_field))
        if (len(self._samples) + 0.5) * interval_s < _IMU_BURST_S:
            return None
        samples = np.array(self._samples, np.int16)
        self._samples.clear()
        return pack_imu_burst(ImuBurstFields(self._t0_us, round(interval_s * 1.0e6), ImuScale.HWT905_RAW, samples))


def gps_payload(report: GpsReading, t_us: int) -> bytes:
    """GPS, one per report of the receiver."""
    return pack_gps(
        GpsFields(
            t_us=t_us,
            fix=report.fix,
            satellites=report.satellites,
            hdop_x100=round(report.hdop * 100),
            latitude_e7=round(report.latitude_deg * 1.0e7),
            longitude_e7=round(report.longitude_deg * 1.0e7),
            altitude_mm=round(report.altitude_m * 1000),
            speed_cmps=round(report.speed_mps * 100),
            course_cdeg=round(math.degrees(report.course_rad) * 100) % 36_000,
            utc_ms=0 if report.utc_unix_s is None else round(report.utc_unix_s * 1000),
        )
    )


def boot_text(reset_reason: int) -> bytes:
    """What the boot ROM prints after a reset for this reason (ESP-IDF's numbers)."""
    return _BOOT_TEXT.format(code=_RESET_CODES.get(reset_reason, _RESET_CODES[1])).encode()


def _ping_protocol_request(message_id: int) -> bytes:
    """A Blue Robotics Ping request: what the vehicle's ping service asks of every serial port it finds."""
    head = b"BR" + (2).to_bytes(2, "little") + (6).to_bytes(2, "little") + b"\0\0" + message_id.to_bytes(2, "little")
    return head + sum(head).to_bytes(2, "little")


PROBE_BYTES = b"\0" + b"U" * 11 + _ping_protocol_request(4) + _ping_protocol_request(5)
