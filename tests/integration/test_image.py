"""The built image, run read-only without privileges on its virtual ESP32; `scripts/test-image` calls this."""

import http.client
import json
import os
import stat
import subprocess
import time
import urllib.request

import pytest

from free_ports import free_port

IMAGE = os.environ.get("IMAGE")
EMULATED = os.environ.get("ARCH", "amd64") != "amd64"
PATIENCE_S = 600.0 if EMULATED else 180.0

pytestmark = [
    pytest.mark.long,
    pytest.mark.image,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(not IMAGE, reason="scripts/test-image builds the image and names it in IMAGE"),
]


def podman(*arguments, check=True):
    return subprocess.run(["podman", *arguments], check=check, capture_output=True, text=True, timeout=PATIENCE_S)


def get(port, path):
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=PATIENCE_S) as answer:
        return answer.read()


def poll(condition, container):
    """The first true value of `condition`; what is not there yet counts as not true."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            value = condition()
        except (OSError, http.client.HTTPException, LookupError, TypeError, ValueError):
            value = None
        if value:
            return value
        time.sleep(0.5)
    logs = podman("logs", "--tail", "60", container, check=False)
    raise AssertionError(f"not within {PATIENCE_S} s; the container said:\n{logs.stdout}\n{logs.stderr}")


@pytest.fixture(scope="module")
def container():
    ports = {name: free_port() for name in ("http", "ws", "viewer", "waterfall", "udp_a", "udp_b")}
    environment = {
        "BLUEROV_SLAM_HTTP__HOST": "127.0.0.1",
        "BLUEROV_SLAM_HTTP__PORT": ports["http"],
        "BLUEROV_SLAM_HTTP__SENSOR_WS_PORT": ports["ws"],
        "BLUEROV_SLAM_VIEWER__PORT": ports["viewer"],
        "BLUEROV_SLAM_VIEWER__WATERFALL_WS_PORT": ports["waterfall"],
        "BLUEROV_SLAM_VIEWER__UDP_PORT_A": ports["udp_a"],
        "BLUEROV_SLAM_VIEWER__UDP_PORT_B": ports["udp_b"],
    }
    options = [option for key, value in environment.items() for option in ("--env", f"{key}={value}")]
    # Host network, as on the vehicle; read-only and without capabilities, to see that nothing else is needed.
    started = podman(
        "run", "--detach", "--network", "host", "--read-only", "--cap-drop", "ALL",
        "--tmpfs", "/usr/blueos/extensions/bluerov-slam", "--tmpfs", "/tmp",
        *options, IMAGE, "bluerov-slam", "run", "--simulate",
    )  # fmt: skip
    name = started.stdout.strip()
    try:
        yield name, ports
    finally:
        podman("rm", "--force", "--time", "5", name, check=False)


def test_both_services_answer_with_live_data(container):
    name, ports = container
    poll(lambda: json.loads(get(ports["http"], "/health"))["serial"], name)
    poll(lambda: json.loads(get(ports["http"], "/api/latest"))["imu"]["alive"], name)
    poll(lambda: json.loads(get(ports["viewer"], "/health"))["a_pings"] > 5, name)
    assert b"<title>" in get(ports["http"], "/")
    assert b"<title>" in get(ports["viewer"], "/")


def test_the_libraries_of_the_pages_are_shipped(container):
    name, ports = container
    poll(lambda: get(ports["http"], "/health"), name)
    assert len(get(ports["http"], "/static/vendor/uplot/dist/uPlot.esm.js")) > 10_000
    assert b"swagger" in get(ports["http"], "/docs").lower()


def test_the_dive_is_recorded(container):
    name, ports = container

    def recorded():
        document = json.loads(get(ports["http"], "/api/recordings"))
        return any(
            file["name"].endswith(".mcap") and file["bytes"] > 0 for r in document["recordings"] for file in r["files"]
        )

    poll(recorded, name)


def test_the_health_check_command_agrees(container):
    name, ports = container
    for service in ("http", "viewer"):
        poll(lambda service=service: get(ports[service], "/health"), name)
    asked = ("exec", name, "bluerov-slam", "health")
    # The command gives each service three seconds, which a busy or emulated one may miss once.
    answer = poll(lambda: (a := podman(*asked, check=False)).returncode == 0 and a, name)
    assert answer.stdout.split() == ["extension:", "healthy", "viewer:", "healthy"]


def test_the_labels_permissions_open_serial_ports_without_privileges(tmp_path):
    """A node whose driver is missing answers ENXIO to who may open it, EPERM to who may not."""
    os.mknod(tmp_path / "ttyUSB0", 0o660 | stat.S_IFCHR, os.makedev(188, 0))
    labels = json.loads(podman("image", "inspect", IMAGE).stdout)[0]["Labels"]
    host = json.loads(labels["permissions"])["HostConfig"]
    rules = [option for rule in host["DeviceCgroupRules"] for option in ("--device-cgroup-rule", rule)]
    probe = "import os; os.open('/hostdev/ttyUSB0', os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)"
    run = ("run", "--rm", "--volume", f"{tmp_path}:/hostdev")
    allowed = podman(*run, *rules, IMAGE, "python3", "-c", probe, check=False)
    refused = podman(*run, IMAGE, "python3", "-c", probe, check=False)
    assert "Errno 6" in allowed.stderr
    assert "Errno 1" in refused.stderr
    assert not host.get("Privileged")


def test_labels_are_what_the_store_and_kraken_read():
    configuration = json.loads(podman("image", "inspect", IMAGE).stdout)[0]
    labels = configuration["Labels"]
    assert json.loads(labels["permissions"])["HostConfig"]["NetworkMode"] == "host"
    assert configuration.get("HealthCheck") or configuration.get("Healthcheck")
