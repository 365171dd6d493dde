"""Every setting of both services: default, unit, allowed range and reason. Two levels, `group.key`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Self

from pydantic import field_validator, model_validator
from pydantic_core import PydanticCustomError

from bluerov_slam.config.acoustics import AcousticsSettings
from bluerov_slam.config.kinds import (
    PLACE_PATTERN,
    Angles3,
    Directions,
    Group,
    HostName,
    Names,
    Origins,
    Port,
    Vector3,
    on_earth,
    place_deg,
    setting,
)

# On every BlueROV2. Its port 14401 is where QGroundControl reads NMEA.
SURFACE_COMPUTER = "192.168.2.1"
NMEA_PORT = 14401
# Identities of others on the vehicle's network: to speak as them disturbs arming, steering or the lost-link failsafe.
FOREIGN_COMPONENTS = {1: "the autopilot's", 190: "a ground station's"}


class SerialSettings(Group):
    """The USB serial link to the ESP32."""

    port: str = setting(
        "auto",
        "'auto' looks in /dev/serial/by-id, then by-path, then for ttyUSB, ttyACM and ttyAMA0; or the path of a port",
        live=True,
        min_length=1,
        max_length=255,
    )
    baud: Literal[115200, 921600] = setting(
        115200, "must be what the firmware uses; ours and the first system's use 115200", unit="baud", live=True
    )


class HttpSettings(Group):
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


class ViewerSettings(Group):
    """The sonar viewer's ports."""

    port: Port = setting(8100, "waterfall page and HTTP API; 0 takes a free port")
    waterfall_ws_port: Port = setting(8101, "WebSocket of the 200-bin waterfall JSON; 0 takes a free port")
    udp_port_a: Port = setting(14555, "sonar A: the viewer's own port, and the port of every forwarding target")
    udp_port_b: Port = setting(14556, "sonar B: the viewer's own port, and the port of every forwarding target")
    history_mb: int = setting(
        512, "pings kept for scrolling back, in a scratch file of the state folder", unit="MB", ge=1, le=8192
    )


class ForwardingSettings(Group):
    """Sonar frames by UDP: to the viewer and to surface computers with KoggerApp."""

    targets: Names = setting(
        ("127.0.0.1",), "host names or addresses that get both sonars; 127.0.0.1 is the viewer", live=True
    )
    route_a: int = setting(1, "BB55 route of sonar A, so that KoggerApp tells the two apart", live=True, ge=0, le=255)
    route_b: int = setting(2, "BB55 route of sonar B", live=True, ge=0, le=255)
    mod255_targets: Names = setting(
        (), "targets that need the seed's checksum (modulo 255); KoggerApp rejects it", live=True
    )


class MavlinkSettings(Group):
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

    @field_validator("component_id")
    @classmethod
    def _not_somebody_else(cls, component_id: int) -> int:
        if component_id in FOREIGN_COMPONENTS:
            raise ValueError(f"expected another number: this is {FOREIGN_COMPONENTS[component_id]}; ours is 197")
        return component_id

    @model_validator(mode="after")
    def _never_the_nmea_port(self) -> Self:
        if (self.target_host, self.target_port) == (SURFACE_COMPUTER, NMEA_PORT):
            raise PydanticCustomError(
                "setting",
                "expected an endpoint on the vehicle, such as 127.0.0.1: port 14401 of the surface computer is "
                "QGroundControl's NMEA port",
                {"key": "mavlink.target_host"},
            )
        return self


class RecordingSettings(Group):
    """The session log and the recording of the raw link."""

    enabled: bool = setting(True, "record from the first valid frame on", live=True)
    folder: str = setting("", "where dives are kept; empty: 'recordings' in the state folder", max_length=255)
    max_file_mb: int = setting(256, "a new file is begun at this size", unit="MB", live=True, ge=1, le=4096)
    max_file_minutes: int = setting(60, "a new file is begun after this time", unit="min", live=True, ge=1, le=1440)
    min_free_mb: int = setting(
        500, "recording pauses when less is free, so that the vehicle's disk never fills up", unit="MB", live=True,
        ge=10, le=100000,
    )  # fmt: skip


class SonarSettings(Group):
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


class SensorSettings(Group):
    """What the sensors' readings are referred to."""

    surface_pressure_pa: float = setting(
        101325.0, "air pressure at the surface: depth is counted from it", unit="Pa", ge=50000.0, le=110000.0
    )


class NavigationSettings(Group):
    """Where the vehicle is: what the estimator must know that no sensor tells it."""

    enabled: bool = setting(True, "estimate position, velocity and attitude from what the sensors bring", live=True)
    imu_mounting_rpy_deg: Angles3 = setting(
        (0.0, 0.0, 0.0),
        "roll, pitch, yaw that turn the IMU's readings into the vehicle's forward, right, down; upside down: 180, 0, 0",
        unit="deg", live=True,
    )  # fmt: skip
    imu_latency_ms: float = setting(
        12.0, "age of an IMU sample when the ESP32 stamps it", unit="ms", live=True, ge=0.0, le=500.0
    )
    gps_lever_arm_frd_m: Vector3 = setting(
        (0.0, 0.0, -0.15), "GPS antenna from the IMU: forward, right, down", unit="m", live=True
    )
    gps_latency_ms: float = setting(
        100.0, "age of a GPS position when it arrives at the ESP32", unit="ms", live=True, ge=0.0, le=2000.0
    )
    dvl_lever_arm_frd_m: Vector3 = setting(
        (0.0, 0.0, 0.0), "DVL from the IMU: forward, right, down", unit="m", live=True
    )
    position_lever_arm_frd_m: Vector3 = setting(
        (0.0, 0.0, 0.0), "what an outside positioning system tracks, from the IMU: forward, right, down", unit="m",
        live=True,
    )  # fmt: skip
    position_latency_ms: float = setting(
        0.0, "age of an outside position when it arrives", unit="ms", live=True, ge=0.0, le=10000.0
    )
    thruster_frame: Literal["standard", "heavy", "off"] = setting(
        "standard",
        "BlueROV2 with six thrusters (standard) or eight (heavy); off: another vehicle, thrusters tell nothing",
        live=True,
    )
    thruster_directions: Directions = setting(
        (),
        "1 or -1 for each thruster, as MOT_1_DIRECTION and so on are in the autopilot; empty: all 1",
        live=True,
    )
    origin: str = setting(
        "",
        "fixed zero of the map: latitude and longitude in degrees, such as 54.3219, 10.1356; empty: the first fix",
        live=True,
        pattern=PLACE_PATTERN,
    )
    external_position: Literal["off", "gps_input"] = setting(
        "off",
        "take GPS_INPUT messages heard on the MAVLink endpoint, as positioning systems under water send them, as "
        "positions of the vehicle; never together with a forwarded surface GPS",
        live=True,
    )
    odometry_enabled: bool = setting(
        False,
        "send our position to the autopilot (ODOMETRY), so that ArduSub can hold it; needs MAVLink on and the "
        "parameters of the Navigation tab",
        live=True,
    )
    odometry_rate_hz: float = setting(
        5.0, "how often; the autopilot calls it lost after 0.3 s", unit="Hz", live=True, ge=4.0, le=20.0
    )
    odometry_max_std_m: float = setting(
        10.0, "nothing is sent while the position is less certain than this, one standard deviation", unit="m",
        live=True, ge=0.5, le=100.0,
    )  # fmt: skip
    odometry_heading: bool = setting(
        False, "the autopilot shall take its heading from us too, instead of from its own compass", live=True
    )
    odometry_when_simulated: bool = setting(
        False, "send positions of a simulated vehicle to a real autopilot: only for a simulated one", live=True
    )

    @model_validator(mode="after")
    def _directions_fit(self) -> Self:
        needed = {"standard": 6, "heavy": 8}.get(self.thruster_frame, 0)
        if self.thruster_directions and len(self.thruster_directions) < needed:
            raise PydanticCustomError(
                "setting",
                "expected as many directions as the frame has thrusters (6 or 8), or none",
                {"key": "navigation.thruster_directions"},
            )
        return self

    @field_validator("origin")
    @classmethod
    def _origin_is_on_earth(cls, origin: str) -> str:
        return on_earth(origin)

    @property
    def origin_deg(self) -> tuple[float, float] | None:
        """The fixed origin, if there is one."""
        return place_deg(self.origin)


class DisplaySettings(Group):
    """Defaults of both pages; a browser may differ."""

    units: Literal["metric", "imperial"] = setting("metric", "units shown on the pages", live=True)
    theme: Literal["auto", "light", "dark"] = setting("auto", "'auto' follows the browser", live=True)


class PathSettings(Group):
    """Where things are kept."""

    state: str = setting(
        "var",
        "settings, token and recordings; on the vehicle the bound folder /usr/blueos/extensions/bluerov-slam",
        min_length=1,
        max_length=255,
    )


class SimulationSettings(Group):
    """The virtual ESP32 of `bluerov-slam run --simulate` and `simulate`."""

    scenario: str = setting(
        "survey", "what is simulated: a name of `bluerov-slam simulate --list-scenarios` or a file", min_length=1,
        max_length=255,
    )  # fmt: skip
    seed: int = setting(1, "world, vehicle and noise follow from it", ge=0, le=2**31 - 1)


class Settings(Group):
    """The whole tree."""

    serial: SerialSettings = SerialSettings()
    http: HttpSettings = HttpSettings()
    viewer: ViewerSettings = ViewerSettings()
    forwarding: ForwardingSettings = ForwardingSettings()
    mavlink: MavlinkSettings = MavlinkSettings()
    recording: RecordingSettings = RecordingSettings()
    sonar: SonarSettings = SonarSettings()
    sensors: SensorSettings = SensorSettings()
    navigation: NavigationSettings = NavigationSettings()
    acoustics: AcousticsSettings = AcousticsSettings()
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
        udp = {
            "viewer.udp_port_a": self.viewer.udp_port_a,
            "viewer.udp_port_b": self.viewer.udp_port_b,
            "acoustics.udp_port": self.acoustics.udp_port,
        }
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


def _refuse_twins(ports: Mapping[str, int]) -> None:
    owners: dict[int, str] = {}
    for key, port in ports.items():
        if port and port in owners:
            raise ValueError(f"{owners[port]} and {key} are both {port}; give each its own port")
        owners[port] = key
