"""Commands to a Kogger sonar beside its settings, its answers to them, and which of them may pass.

Multi-byte values are little-endian. Every command asks for a result (MODE bit RESPONSE).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum, IntEnum

from bluerov_slam.protocol.kogger_frame import FrameType, KoggerFrame, KoggerId, build_frame

CONFIRM_KEY = 0xC96B5D4A.to_bytes(4, "little")

BOARD_NAMES = {
    1: "2D-Enhanced",
    3: "2D-Base",
    4: "2D-Base",
    5: "2D-Chirp",
    6: "Assist",
    7: "2D-Enhanced",
    8: "Side-Enhanced",
    9: "Recorder",
    10: "DVL",
    12: "Basic2D",
    15: "USBL",
    16: "Beacon",
    17: "NanoSSS",
    87: "Wi-Fi bridge",
    128: "PULSEred",
    129: "PULSEblue DSS",
}

_VERSION_V0 = struct.Struct("<2BH8x2BI16s")
_VERSION_V2 = struct.Struct("<5BH2B")
_UNIQUE_ID_BYTES = 12
_UART_BAUD = struct.Struct("<4sBI")


class FlashAction(IntEnum):
    """Versions of FLASH."""

    SAVE = 0
    RESTORE = 1
    ERASE = 2


class BootAction(IntEnum):
    """Versions of BOOT."""

    REBOOT = 0
    RUN_FIRMWARE = 1


class ResultCode(IntEnum):
    """First byte of a result frame."""

    NONE = 0
    OK = 1
    CHECKSUM = 2
    PAYLOAD = 3
    ID = 4
    VERSION = 5
    TYPE = 6
    KEY = 7
    RUNTIME = 8


@dataclass(frozen=True, slots=True)
class VersionInfo:
    """VERSION v0: what the device is."""

    board: int
    hardware_minor: int
    boot_version: tuple[int, int]
    serial_number: int
    part_number: str

    @property
    def board_name(self) -> str:
        return BOARD_NAMES.get(self.board, f"board {self.board}")


@dataclass(frozen=True, slots=True)
class UniqueId:
    """VERSION v1: the processor's own number."""

    value: bytes


@dataclass(frozen=True, slots=True)
class FirmwareInfo:
    """VERSION v2: what the device runs."""

    in_boot_loader: bool
    board: int
    hardware_minor: int
    boot_version: tuple[int, int]
    firmware_version: tuple[int, int]

    @property
    def board_name(self) -> str:
        return BOARD_NAMES.get(self.board, f"board {self.board}")


@dataclass(frozen=True, slots=True)
class CommandResult:
    """Payload of a result frame; `check` quotes the two check bytes of the command it answers."""

    code: int
    check: bytes

    @property
    def meaning(self) -> str:
        names = {code.value: code.name.lower() for code in ResultCode}
        return names.get(self.code, f"code {self.code}")


class CommandDecision(Enum):
    """What to do with a command."""

    ALLOW = "allow"
    CONFIRM = "confirm"
    REFUSE = "refuse"


@dataclass(frozen=True, slots=True)
class CommandRule:
    """A decision and, unless it is ALLOW, the reason to show."""

    decision: CommandDecision
    reason: str = ""


ALLOWED = CommandRule(CommandDecision.ALLOW)


def get_frame(frame_id: int, *, version: int = 0, payload: bytes = b"", route: int = 0) -> bytes:
    """Any GETTING: polls for one chart, distance, attitude..., or reads a setting."""
    return _command(FrameType.GETTING, frame_id, version, payload, route)


def version_get_frame(version: int, route: int = 0) -> bytes:
    """Ask who the device is: 0 board and serial number, 1 unique id, 2 firmware."""
    return get_frame(KoggerId.VERSION, version=version, route=route)


def mark_frame(route: int = 0) -> bytes:
    """Set the MARK bit in everything the device sends until it restarts."""
    return _command(FrameType.SETTING, KoggerId.MARK, 0, CONFIRM_KEY, route)


def flash_frame(action: FlashAction, route: int = 0) -> bytes:
    """Save, restore or erase what the device keeps without power."""
    return _command(FrameType.SETTING, KoggerId.FLASH, action, CONFIRM_KEY, route)


def boot_frame(action: BootAction, route: int = 0) -> bytes:
    """Restart the device."""
    return _command(FrameType.SETTING, KoggerId.BOOT, action, CONFIRM_KEY, route)


def uart_baud_frame(uart: int, baud: int, route: int = 0) -> bytes:
    """Change the baud rate. Refused by `classify_command`: it cuts the link that carries it."""
    return _command(FrameType.SETTING, KoggerId.UART, 0, _UART_BAUD.pack(CONFIRM_KEY, uart, baud), route)


def uart_address_frame(uart: int, address: int, route: int = 0) -> bytes:
    """Change the device's address on one UART. Refused by `classify_command`."""
    return _command(FrameType.SETTING, KoggerId.UART, 1, CONFIRM_KEY + bytes((uart, address)), route)


def uart_default_address_frame(address: int, route: int = 0) -> bytes:
    """Change the device's default address. Refused by `classify_command`."""
    return _command(FrameType.SETTING, KoggerId.UART, 2, CONFIRM_KEY + bytes((address,)), route)


def uart_get_frame(version: int, uart: int = 1, route: int = 0) -> bytes:
    """Read baud rate (0), address (1) or default address (2)."""
    payload = CONFIRM_KEY if version == 2 else CONFIRM_KEY + bytes((uart,))
    return get_frame(KoggerId.UART, version=version, payload=payload, route=route)


def parse_version(frame: KoggerFrame) -> VersionInfo | UniqueId | FirmwareInfo | None:
    """The device's answer to `version_get_frame`; None for any other frame."""
    if frame.frame_id != KoggerId.VERSION or frame.frame_type != FrameType.CONTENT or frame.response:
        return None
    payload = frame.payload
    if frame.version == 0 and len(payload) >= _VERSION_V0.size:
        hardware_minor, board, _, boot_minor, boot_major, serial, part = _VERSION_V0.unpack_from(payload)
        part_number = part.split(b"\0", 1)[0].decode("ascii", "replace")
        return VersionInfo(board, hardware_minor, (boot_major, boot_minor), serial, part_number)
    if frame.version == 1 and len(payload) >= _UNIQUE_ID_BYTES:
        return UniqueId(payload[:_UNIQUE_ID_BYTES])
    if frame.version == 2 and len(payload) >= _VERSION_V2.size:
        run_mode, hardware_minor, board, boot_minor, boot_major, _, minor, major = _VERSION_V2.unpack_from(payload)
        return FirmwareInfo(run_mode == 1, board, hardware_minor, (boot_major, boot_minor), (major, minor))
    return None


def version_content_frame(info: VersionInfo | UniqueId | FirmwareInfo, route: int = 0, *, mark: bool = False) -> bytes:
    """The answer of a device, for simulators and gateways."""
    if isinstance(info, VersionInfo):
        part = info.part_number.encode("ascii", "replace")
        boot_major, boot_minor = info.boot_version
        version = 0
        payload = _VERSION_V0.pack(info.hardware_minor, info.board, 0, boot_minor, boot_major, info.serial_number, part)
    elif isinstance(info, UniqueId):
        version, payload = 1, info.value
    else:
        boot_major, boot_minor = info.boot_version
        major, minor = info.firmware_version
        version = 2
        payload = _VERSION_V2.pack(
            info.in_boot_loader, info.hardware_minor, info.board, boot_minor, boot_major, 0, minor, major
        )
    return build_frame(KoggerId.VERSION, payload, version=version, route=route, mark=mark)


def parse_result(frame: KoggerFrame) -> CommandResult | None:
    """The result a device gives to a command; None for any other frame."""
    if frame.frame_type != FrameType.CONTENT or not frame.response or len(frame.payload) < 3:
        return None
    return CommandResult(frame.payload[0], frame.payload[1:3])


def answers(frame: KoggerFrame, command: KoggerFrame) -> bool:
    """Whether `frame` is the result of `command`: same id, version and route, and the command's two check bytes."""
    result = parse_result(frame)
    return (
        result is not None
        and (frame.frame_id, frame.version, frame.route) == (command.frame_id, command.version, command.route)
        and result.check == command.check
    )


def result_frame(command: KoggerFrame, code: ResultCode, *, mark: bool = False) -> bytes:
    """The result frame that a device sends for `command`."""
    payload = bytes((code,)) + command.check
    return build_frame(
        command.frame_id, payload, version=command.version, route=command.route, mark=mark, response=True
    )


_SETTING_IDS = range(KoggerId.DATASET, KoggerId.SOUND_SPEED + 1)
_REFUSED: dict[tuple[int, int | None], str] = {
    (KoggerId.UART, 0): "a new baud rate moves the sonar off 921600 and cuts its link to the ESP32",
    (KoggerId.UART, 1): "a new address hides the sonar from everything that knows the old one",
    (KoggerId.UART, 2): "a new default address hides the sonar from everything that knows the old one",
    (KoggerId.FLASH, FlashAction.ERASE): "erasing the sonar's memory loses its factory settings",
    (KoggerId.BOOT, BootAction.RUN_FIRMWARE): "it is only for a sonar in its boot loader",
    (KoggerId.UPDATE, None): "firmware is updated by KoggerApp on the sonar's own cable",
}
_CONFIRMED: dict[tuple[int, int], str] = {
    (KoggerId.FLASH, FlashAction.SAVE): "it overwrites what the sonar keeps without power",
    (KoggerId.FLASH, FlashAction.RESTORE): "it replaces the sonar's settings by the saved ones",
    (KoggerId.BOOT, BootAction.REBOOT): "the sonar restarts and is silent for a moment",
}


def classify_command(frame: KoggerFrame) -> CommandRule:
    """Whether a frame may go down: every GETTING, settings 0x10-0x15, VERSION and MARK; some if confirmed."""
    if frame.frame_type == FrameType.GETTING:
        return ALLOWED
    if frame.frame_type != FrameType.SETTING:
        return CommandRule(CommandDecision.REFUSE, "only SETTING and GETTING frames go to a sonar")
    if frame.frame_id in _SETTING_IDS or frame.frame_id in (KoggerId.VERSION, KoggerId.MARK):
        return ALLOWED
    reason = _CONFIRMED.get((frame.frame_id, frame.version))
    if reason is not None:
        return CommandRule(CommandDecision.CONFIRM, reason)
    reason = _REFUSED.get((frame.frame_id, frame.version)) or _REFUSED.get((frame.frame_id, None))
    fallback = f"SETTING 0x{frame.frame_id:02X} version {frame.version} is not on the list of safe commands"
    return CommandRule(CommandDecision.REFUSE, reason or fallback)


def classify_udp_command(frame: KoggerFrame, *, settings_allowed: bool) -> CommandRule:
    """The stricter rule for frames from the network: GETTING, MARK, VERSION; settings 0x10-0x15 with the switch on."""
    rule = classify_command(frame)
    if rule.decision is CommandDecision.CONFIRM:
        return CommandRule(CommandDecision.REFUSE, f"{rule.reason}; it is confirmed on the viewer page")
    changes_settings = frame.frame_type == FrameType.SETTING and frame.frame_id in _SETTING_IDS
    if changes_settings and not settings_allowed:
        return CommandRule(CommandDecision.REFUSE, 'the switch "KoggerApp may change settings" is off')
    return rule


def _command(frame_type: FrameType, frame_id: int, version: int, payload: bytes, route: int) -> bytes:
    return build_frame(frame_id, payload, frame_type=frame_type, version=version, route=route, response=True)
