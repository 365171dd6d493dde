"""What a serial line carries that is no frame: the boot ROM's text, and the vehicle's own probe of every port."""

from __future__ import annotations

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


def boot_text(reset_reason: int) -> bytes:
    """What the boot ROM prints after a reset for this reason (ESP-IDF's numbers)."""
    return _BOOT_TEXT.format(code=_RESET_CODES.get(reset_reason, _RESET_CODES[1])).encode()


def _ping_protocol_request(message_id: int) -> bytes:
    """A Blue Robotics Ping request: what the vehicle's ping service asks of every serial port it finds."""
    head = b"BR" + (2).to_bytes(2, "little") + (6).to_bytes(2, "little") + b"\0\0" + message_id.to_bytes(2, "little")
    return head + sum(head).to_bytes(2, "little")


PROBE_BYTES = b"\0" + b"U" * 11 + _ping_protocol_request(4) + _ping_protocol_request(5)
