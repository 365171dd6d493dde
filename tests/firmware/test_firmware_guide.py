"""docs/firmware.md says what the firmware's pins, the dashboard's texts and STATUS really are."""

import re
from dataclasses import fields
from pathlib import Path

import bluerov_slam.pipeline as pipeline
from bluerov_slam.records import DeviceStatus

ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "firmware.md").read_text()
PINS = {
    name: int(pin) for name, pin in re.findall(r"k(\w+) = (\d+)", (ROOT / "firmware" / "src" / "pins.h").read_text())
}


def rows(heading: str) -> list[list[str]]:
    """The cells of every table row under a heading, without the tables' heads."""
    section = GUIDE.split(f"\n{heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_the_wiring_tables_have_the_pins_of_the_source() -> None:
    parts = {
        "Kogger sonar A": "SonarA",
        "Kogger sonar B": "SonarB",
        "GPS": "Gps",
        "Atlas EZO EC": "Ec",
        "WitMotion HWT905": "Imu",
        "computer": "Usb",
    }
    table = rows("## Wiring")
    for part, name in parts.items():
        (row,) = [row for row in table if row[0].startswith(part)]
        assert [row[2], row[3]] == [str(PINS[f"{name}Rx"]), str(PINS[f"{name}Tx"])], part
    buses = [row for row in table if row[1].startswith("I2C")]
    assert len(buses) == 2
    assert all([row[2], row[3]] == [str(PINS["Sda"]), str(PINS["Scl"])] for row in buses)
    assert f"The lamp is GPIO {PINS['Led']}:" in GUIDE


def test_the_drawing_has_the_same_pins() -> None:
    drawing = GUIDE.split("```text", 1)[1].split("```", 1)[0]
    drawn = {int(pin) for pin in re.findall(r"(\d+) (?:RX|TX|SDA|SCL|LED)\b", drawing)}
    assert drawn == {pin for name, pin in PINS.items() if not name.startswith("Usb")}


def test_every_text_of_the_dashboard_is_one_it_can_show() -> None:
    source = "".join(path.read_text() for path in Path(pipeline.__path__[0]).glob("health*.py"))
    quoted = [text for row in rows("## When something is missing")[1:] for text in re.findall(r"`([^`]+)`", row[1])]
    assert len(quoted) > 20
    for text in quoted:
        pattern = r"\{[^}]*\}".join(re.escape(part) for part in re.split(r"\bN\b", text))
        assert re.search(pattern, source), text


def test_every_counter_is_one_of_status() -> None:
    known = {field.name for field in fields(DeviceStatus)} | {"boots"}
    named = [text for row in rows("## When something is missing")[1:] for text in re.findall(r"`([^`]+)`", row[2])]
    assert len(named) > 20
    assert set(named) <= known


def test_the_boot_message_is_the_one_that_is_printed() -> None:
    source = (ROOT / "firmware" / "src" / "boot.cpp").read_text()
    printed = re.search(r'"\\r\\n(BlueROV .*?)\\r\\n"', source)
    assert printed is not None
    assert re.search(re.sub(r"%l?u|%s", r"[\\w -]+", printed[1].replace("(", r"\(").replace(")", r"\)")), GUIDE)
