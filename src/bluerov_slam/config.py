"""Every setting of both services: default, unit, allowed range and reason, and how the layers of values combine.

Two levels, `group.key`. Later layers win: default < TOML file < what the page changed < environment < flag.
`config/example.toml` is `example_toml()`; a test keeps them the same.
"""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, Self, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError, model_validator
from pydantic.fields import FieldInfo

from bluerov_slam.errors import ConfigError

ENVIRONMENT_PREFIX = "BLUEROV_SLAM_"
Port = Annotated[int, Field(ge=0, le=65535)]
HostName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:\-]{1,253}$")]
Metres = Annotated[float, Field(ge=-10.0, le=10.0)]
Vector3 = Annotated[tuple[Metres, Metres, Metres], Field(strict=False)]
Names = Annotated[tuple[HostName, ...], Field(strict=False, max_length=16)]
Origins = Annotated[
    tuple[Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:/\-]{1,253}$")], ...],
    Field(strict=False, max_length=16),
]


def setting(
    default: Any, reason: str, *, unit: str | None = None, live: bool = False, secret: bool = False, **limits: Any
) -> Any:
    """One setting. `live`: a change takes effect at once, without a restart. `secret`: never shown or backed up."""
    extra: dict[str, Any] = {"unit": unit, "restart": not live, "secret": secret}
    return Field(default=default, description=reason, json_schema_extra=extra, **limits)


class _Group(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class SerialSettings(_Group):
    """The USB serial link to the ESP32."""

    port: str = setting(
        "auto",
        "'auto' looks in /dev/serial/by-id, then by-path, then for ttyUSB, ttyACM and ttyAMA0; or the path of a port",
        live=True,
        min_length=1,
        max_length=255,
    )
    baud: Literal[115200, 921600] = setting(
        115200, "must be what the firmware uses; the seed's firmware uses 115200", unit="baud", live=True
    )


class HttpSettings(_Group):
    """The extension's web server."""

    host: str = setting(
        "0.0.0.0",  # noqa: S104  BlueOS finds only services that listen on every address
        "address both services listen on; BlueOS finds only what listens on 0.0.0.0",
        min_length=1,
        max_length=253,
    )
    port: Port = setting(8099, "dashboard and HTTP API; 0 takes a free port")
    sensor_ws_port: Port = setting(8766, "WebSocket of the bare sensor JSON; 0 takes a free port")
    trusted_origins: Origins = setting(
        (),
        "further origins (http://name or name) whose pages may change something; the vehicle's own are always allowed",
        live=True,
    )
    token: str = setting(
        "", "lets programs without an Origin change something (Authorization: Bearer); empty lets none", secret=True
    )


class ViewerSettings(_Group):
    """The sonar viewer's ports."""

    port: Port = setting(8100, "waterfall page and HTTP API; 0 takes a free port")
    waterfall_ws_port: Port = setting(8101, "WebSocket of the 200-bin waterfall JSON; 0 takes a free port")
    udp_port_a: Port = setting(14555, "sonar A: the viewer's own port, and the port of every forwarding target")
    udp_port_b: Port = setting(14556, "sonar B: the viewer's own port, and the port of every forwarding target")
    history_mb: int = setting(
        512, "pings kept for scrolling back, in a scratch file of the state folder", unit="MB", ge=1, le=8192
    )


class ForwardingSettings(_Group):
    """Sonar frames by UDP: to the viewer and to surface computers with KoggerApp."""

    targets: Names = setting(
        ("127.0.0.1",), "host names or addresses that get both sonars; 127.0.0.1 is the viewer", live=True
    )
    route_a: int = setting(1, "BB55 route of sonar A, so that KoggerApp tells the two apart", live=True, ge=0, le=255)
    route_b: int = setting(2, "BB55 route of sonar B", live=True, ge=0, le=255)
    mod255_targets: Names = setting(
        (), "targets that need the seed's checksum (modulo 255); KoggerApp rejects it", live=True
    )


class MavlinkSettings(_Group):
    """What goes to the autopilot and the ground station. Off until switched on."""

    enabled: bool = setting(False, "send MAVLink; nothing is sent before someone switches this on", live=True)
    target_host: HostName = setting(
        "127.0.0.1",
        "a BlueOS endpoint of type UDP server; never the surface computer's 14401, its NMEA port",
        live=True,
    )
    target_port: int = setting(14401, "UDP port of that endpoint", live=True, ge=1, le=65535)
    system_id: int = setting(
        1, "the vehicle's MAVLink system; BlueOS gives it in MAV_SYSTEM_ID", live=True, ge=1, le=254
    )
    component_id: int = setting(
        197, "197 is MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY, which no BlueOS service uses", live=True, ge=1, le=250
    )
    send_attitude: bool = setting(True, "ATTITUDE (30) from our IMU", live=True)
    send_scaled_pressure: bool = setting(True, "SCALED_PRESSURE (29): absolute pressure and temperature", live=True)
    send_gps_raw_int: bool = setting(True, "GPS_RAW_INT (24), only with a fix", live=True)
    send_named_values: bool = setting(
        True, "NAMED_VALUE_FLOAT: water temperature, sound speed, salinity, depth of the CTD", live=True
    )
    send_status_text: bool = setting(True, "STATUSTEXT when a fault appears or clears", live=True)
    defer_to_autopilot: bool = setting(
        True,
        "hold our ATTITUDE and GPS_RAW_INT back while the autopilot sends its own: ground stations would mix the two",
        live=True,
    )
    mavlink2rest_url: str = setting(
        "", "mavlink2rest WebSocket to use instead of UDP, such as ws://127.0.0.1:6040/v1/ws/mavlink; empty: UDP",
        pattern=r"^(wss?://[^\s]{1,250})?$", live=True,
    )  # fmt: skip


class RecordingSettings(_Group):
    """The session log and the recording of the raw link."""

    enabled: bool = setting(True, "record from the first valid frame on", live=True)
    folder: str = setting("", "where dives are kept; empty: 'recordings' in the state folder", max_length=255)
    max_file_mb: int = setting(256, "a new file is begun at this size", unit="MB", live=True, ge=1, le=4096)
    max_file_minutes: int = setting(60, "a new file is begun after this time", unit="min", live=True, ge=1, le=1440)
    min_free_mb: int = setting(
        500, "recording pauses when less is free, so that the vehicle's disk never fills up", unit="MB", live=True,
        ge=10, le=100000,
    )  # fmt: skip


class SonarSettings(_Group):
    """How the two sonars are mounted and understood."""

    swap_a_b: bool = setting(False, "exchange A and B when the cables are crossed; A is starboard", live=True)
    mirror: bool = setting(False, "exchange left and right on the viewer's page only", live=True)
    kogger_checksum: Literal["auto", "mod256", "mod255"] = setting(
        "auto", "checksum of the sonars' frames: 'auto' learns it; real sonars use mod256, the seed wrote mod255"
    )
    kogger_app_may_change_settings: bool = setting(
        False, "let KoggerApp change the sonars' settings by UDP; reading them is always allowed", live=True
    )
    a_position_frd_m: Vector3 = setting(
        (0.0, 0.0, 0.0), "sonar A from the vehicle's origin: forward, right, down", unit="m", live=True
    )
    b_position_frd_m: Vector3 = setting(
        (0.0, 0.0, 0.0), "sonar B from the vehicle's origin: forward, right, down", unit="m", live=True
    )
    a_depression_deg: float = setting(
        30.0, "how far sonar A looks below the horizontal", unit="deg", live=True, ge=0.0, le=90.0
    )
    b_depression_deg: float = setting(
        30.0, "how far sonar B looks below the horizontal", unit="deg", live=True, ge=0.0, le=90.0
    )
    expected_samples: int = setting(
        0, "samples of one whole ping, where the sonar's setting cannot be read; 0: learn it", ge=0, le=20000
    )


class SensorSettings(_Group):
    """What the sensors' readings are referred to."""

    surface_pressure_pa: float = setting(
        101325.0, "air pressure at the surface: depth is counted from it", unit="Pa", ge=50000.0, le=110000.0
    )


class DisplaySettings(_Group):
    """Defaults of both pages; a browser may differ."""

    units: Literal["metric", "imperial"] = setting("metric", "units shown on the pages", live=True)
    theme: Literal["auto", "light", "dark"] = setting("auto", "'auto' follows the browser", live=True)


class PathSettings(_Group):
    """Where things are kept."""

    state: str = setting(
        "var",
        "settings, token and recordings; on the vehicle the bound folder /usr/blueos/extensions/bluerov-slam",
        min_length=1,
        max_length=255,
    )


class SimulationSettings(_Group):
    """The virtual ESP32 of `bluerov-slam run --simulate` and `simulate`."""

    scenario: str = setting(
        "survey", "what is simulated: a name of `bluerov-slam simulate --list-scenarios` or a file", min_length=1,
        max_length=255,
    )  # fmt: skip
    seed: int = setting(1, "world, vehicle and noise follow from it", ge=0, le=2**31 - 1)


class Settings(_Group):
    """The whole tree."""

    serial: SerialSettings = SerialSettings()
    http: HttpSettings = HttpSettings()
    viewer: ViewerSettings = ViewerSettings()
    forwarding: ForwardingSettings = ForwardingSettings()
    mavlink: MavlinkSettings = MavlinkSettings()
    recording: RecordingSettings = RecordingSettings()
    sonar: SonarSettings = SonarSettings()
    sensors: SensorSettings = SensorSettings()
    display: DisplaySettings = DisplaySettings()
    paths: PathSettings = PathSettings()
    simulation: SimulationSettings = SimulationSettings()

    @model_validator(mode="after")
    def _ports_differ(self) -> Self:
        tcp = {
            "http.port": self.http.port,
            "http.sensor_ws_port": self.http.sensor_ws_port,
            "viewer.port": self.viewer.port,
            "viewer.waterfall_ws_port": self.viewer.waterfall_ws_port,
        }
        udp = {"viewer.udp_port_a": self.viewer.udp_port_a, "viewer.udp_port_b": self.viewer.udp_port_b}
        for ports in (tcp, udp):
            _refuse_twins(ports)
        if self.forwarding.route_a == self.forwarding.route_b:
            raise ValueError("forwarding.route_a and forwarding.route_b must differ")
        return self

    @property
    def state_folder(self) -> Path:
        """Where settings.json and the tokens are."""
        return Path(self.paths.state).expanduser()

    @property
    def recordings_folder(self) -> Path:
        """Where the dives are."""
        folder = self.recording.folder
        return Path(folder).expanduser() if folder else self.state_folder / "recordings"


@dataclass(frozen=True, slots=True)
class Layer:
    """Values of one origin by dotted key. `origin` is what an error names: a file, 'environment', 'command line'."""

    origin: str
    values: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class SettingInfo:
    """What a page shows about one setting."""

    key: str
    default: object
    unit: str | None
    minimum: float | None
    maximum: float | None
    choices: tuple[object, ...] | None
    reason: str
    group: str
    restart: bool
    secret: bool


class InvalidSettingsError(ConfigError):
    """One line per fault in `lines`; `keys` are those at fault, by dotted key with their origin."""

    def __init__(self, lines: Sequence[str], keys: Iterable[tuple[str, str]] = ()) -> None:
        super().__init__("\n".join(lines))
        self.lines = tuple(lines)
        self.keys = tuple(keys)


def combine(layers: Sequence[Layer]) -> Settings:
    """The settings that these layers give, later ones winning. Raises InvalidSettingsError naming every fault."""
    known = {info.key for info in setting_infos()}
    unknown = [(key, layer.origin) for layer in layers for key in layer.values if key not in known]
    lines = [_unknown_key(key, origin, known) for key, origin in unknown]
    merged: dict[str, tuple[object, str]] = {}
    for layer in layers:
        merged.update({key: (value, layer.origin) for key, value in layer.values.items() if key in known})
    tree: dict[str, dict[str, object]] = {}
    for key, (value, _) in merged.items():
        group, name = key.split(".", 1)
        tree.setdefault(group, {})[name] = value
    at_fault = list(unknown)
    settings = None
    try:
        settings = Settings.model_validate(tree)
    except ValidationError as error:
        for fault in error.errors():
            key = ".".join(str(part) for part in fault["loc"][:2])
            value, origin = merged.get(key, (None, ""))
            at_fault.append((key, origin))
            lines.append(_bad_value(key, value, origin) if key else str(fault["msg"]).removeprefix("Value error, "))
    if settings is None or lines:
        raise InvalidSettingsError(list(dict.fromkeys(lines)), at_fault)
    return settings


def toml_layer(path: Path) -> Layer:
    """The values of a TOML file. Raises ConfigError when it cannot be read or is not TOML."""
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    return Layer(str(path), flatten(tree))


def environment_layer(environment: Mapping[str, str]) -> Layer:
    """The values of BLUEROV_SLAM_<GROUP>__<KEY>; lists as JSON or separated by commas."""
    values: dict[str, object] = {}
    if "MAV_SYSTEM_ID" in environment:  # BlueOS 1.5 tells every extension the vehicle's MAVLink system this way
        values["mavlink.system_id"] = from_text("mavlink.system_id", environment["MAV_SYSTEM_ID"])
    for name, text in environment.items():
        if name.startswith(ENVIRONMENT_PREFIX) and "__" in name:
            key = name.removeprefix(ENVIRONMENT_PREFIX).lower().replace("__", ".", 1)
            values[key] = from_text(key, text)
    return Layer("environment", values)


def from_text(key: str, text: str) -> object:
    """A value for `key` from the text of a variable or flag; text that fits no type is left for `combine` to refuse."""
    annotation = _annotations().get(key)
    if annotation is str:
        return text
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        if _is_list(annotation):
            return [part.strip() for part in text.split(",") if part.strip()]
        return {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}.get(
            text.lower(), text
        )


def flatten(tree: Mapping[str, object]) -> dict[str, object]:
    """`{"serial": {"port": "x"}}` as `{"serial.port": "x"}`; a value where a group belongs keeps its own name."""
    flat: dict[str, object] = {}
    for group, values in tree.items():
        if isinstance(values, Mapping):
            flat.update({f"{group}.{name}": value for name, value in values.items()})
        else:
            flat[group] = values
    return flat


def values_of(settings: Settings) -> dict[str, object]:
    """Every setting's value by dotted key, tuples as lists."""
    return flatten(settings.model_dump(mode="json"))


def setting_infos() -> tuple[SettingInfo, ...]:
    """Every setting with its default, unit, range and reason, in the order of the tree."""
    return tuple(
        _info(group, name, field) for group, model in _groups().items() for name, field in model.model_fields.items()
    )


def example_toml() -> str:
    """The text of config/example.toml: every setting with default, unit, range and reason."""
    lines = [
        "# Every setting with its default. Copy, keep the lines you change, and start with",
        "#     bluerov-slam run --config my.toml",
        f"# Environment: {ENVIRONMENT_PREFIX}<GROUP>__<KEY>, such as {ENVIRONMENT_PREFIX}SERIAL__PORT=/dev/ttyUSB0.",
    ]
    infos = setting_infos()
    for group, model in _groups().items():
        lines += ["", f"# {model.__doc__}", f"[{group}]"]
        for info in infos:
            if info.group == group:
                notes = [*([f"unit {info.unit}"] if info.unit else []), *([allowed(info)] if allowed(info) else [])]
                lines += [f"# {info.reason}" + (f" ({'; '.join(notes)})" if notes else "")]
                lines += [f"{info.key.split('.', 1)[1]} = {_toml_value(info.default)}"]
    return "\n".join(lines) + "\n"


def allowed(info: SettingInfo) -> str:
    """The allowed range in words; empty where any text will do."""
    if info.choices:
        return "one of " + ", ".join(str(choice) for choice in info.choices)
    if info.minimum is not None and info.maximum is not None:
        return f"{_plain(info.minimum)} to {_plain(info.maximum)}"
    return ""


def _groups() -> dict[str, type[_Group]]:
    return {name: _as_group(field.annotation) for name, field in Settings.model_fields.items()}


def _as_group(annotation: object) -> type[_Group]:
    assert isinstance(annotation, type)
    assert issubclass(annotation, _Group)
    return annotation


def _annotations() -> dict[str, object]:
    return {
        f"{group}.{name}": f.annotation for group, model in _groups().items() for name, f in model.model_fields.items()
    }


def _info(group: str, name: str, field: FieldInfo) -> SettingInfo:
    extra = field.json_schema_extra
    assert isinstance(extra, dict)
    limits = {bound: getattr(part, bound) for part in field.metadata for bound in ("ge", "le") if hasattr(part, bound)}
    choices = tuple(get_args(field.annotation)) if get_origin(field.annotation) is Literal else None
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    return SettingInfo(
        key=f"{group}.{name}", default=default, unit=_text_or_none(extra.get("unit")),
        minimum=limits.get("ge"), maximum=limits.get("le"), choices=choices, reason=field.description or "",
        group=group, restart=bool(extra.get("restart")), secret=bool(extra.get("secret")),
    )  # fmt: skip


def _text_or_none(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _is_list(annotation: object) -> bool:
    return get_origin(annotation) is tuple


def _refuse_twins(ports: Mapping[str, int]) -> None:
    owners: dict[int, str] = {}
    for key, port in ports.items():
        if port and port in owners:
            raise ValueError(f"{owners[port]} and {key} are both {port}; give each its own port")
        owners[port] = key


def _unknown_key(key: str, origin: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(key, list(known), n=1)
    hint = f"; did you mean {close[0]}?" if close else "; config/example.toml lists them all"
    return f"{origin}: {key}: unknown setting{hint}"


def _bad_value(key: str, value: object, origin: str) -> str:
    shown = json.dumps(value, default=str)
    shown = shown if len(shown) <= 80 else shown[:77] + "..."
    info = next((info for info in setting_infos() if info.key == key), None)
    if info is None:
        return f"{origin}: {key} = {shown}: expected a group of settings"
    return f"{origin}: {key} = {shown}: expected {_expectation(info)}"


def _expectation(info: SettingInfo) -> str:
    unit = f" in {info.unit}" if info.unit else ""
    if info.choices:
        return allowed(info) + unit
    kinds: dict[type, str] = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
    annotation = _annotations()[info.key]
    if _is_list(annotation):
        kind = (
            "a list of three numbers from -10 to 10" if info.unit == "m" else "a list of at most 16 names or addresses"
        )
    else:
        kind = kinds.get(annotation if isinstance(annotation, type) else NoneType, "another value")
    limits = f" from {allowed(info)}" if allowed(info) else ""
    return f"{kind}{limits}{unit} ({info.reason})"


def _plain(number: float) -> str:
    return str(int(number)) if number == int(number) else str(number)


def _toml_value(value: object) -> str:
    return json.dumps(value)
