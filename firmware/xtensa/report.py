"""Memory, stack and time that the core takes, from its Xtensa code and its run under QEMU: JSON and a Markdown table.

report.py BUILD_DIRECTORY SOURCE_DIRECTORY JSON

Read: the object files and call graphs of the lx106 build, the ESP32's assembly, measured.txt (the
instructions of every loop pass), and the buffers in the application's source. A row is met, not met, or has no limit.
Exit 1 where a limit is not met, but for that of board and buffers together.
"""

import json
import re
import subprocess
import sys
from collections import defaultdict
from functools import cache
from pathlib import Path

RAM_MUST, TEXT_MUST, PASS_MUST_MS = 96 * 1024, 64 * 1024, 2.0
STACK_MUST = 8192 // 2
"""Half of what the framework gives the task of the loop."""
NOT_ENFORCED = "ram_together"
SLOW_CODING = "_coded"
"""Not the default, because it takes longer: docs/decisions/0005."""
CLOCK_HZ = 240e6
CYCLES_PER_INSTRUCTION = 1.5
"""Assumed: taken branches, loads that are waited for and misses of the flash's cache, which QEMU does not have."""
CALIBRATION_INSTRUCTIONS = 200_000
INDIRECT = "__indirect_call"

Row = dict[str, object]


def row(identifier: str, name: str, value: float, unit: str, must: float | None = None) -> Row:
    met = None if must is None else value <= must
    return {"id": identifier, "name": name, "value": value, "unit": unit, "must": must, "met": met}


def output_of(*command: str | Path) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout  # noqa: S603


def memory_rows(board: int, source: Path) -> list[Row]:
    """The buffers: what the drivers allocate at boot and the application holds, by the numbers in its source."""

    def number(file: str, pattern: str) -> list[int]:
        found = re.search(pattern, (source / file).read_text())
        if found is None:
            raise ValueError(f"{file}: no {pattern}")
        return [int(group) for group in found.groups()]

    each_sonar = sum(number("ports.cpp", r"kSonarBuffers\{(\d+), (\d+)\}"))
    usb = sum(
        number("usb_link.cpp", r"kReceiveBufferBytes = (\d+)") + number("usb_link.h", r"ByteRing<(\d+)> waiting_")
    )
    each_software = sum(
        number("software_uart.cpp", r"kReceiveBufferBytes = (\d+)")
        + number("software_uart.h", r"ByteRing<(\d+)> waiting_")
    )
    block = number("ports.h", r"block_\[(\d+)\]")[0]
    buffers = 2 * each_sonar + usb + 3 * each_software + block
    return [
        row("ram_board", "RAM of one board, LX106", board, "B", RAM_MUST),
        row("ram_buffers", "buffers of the ESP32's drivers and application", buffers, "B"),
        row("ram_together", "board and buffers together", board + buffers, "B", RAM_MUST),
    ]


def text_rows(lx106: Path, esp32: Path) -> list[Row]:
    objects = sorted(lx106.rglob("brov/*.o"))
    sizes = output_of("xtensa-lx106-elf-size", "-t", *objects).splitlines()[-1].split()
    data, bss = int(sizes[1]), int(sizes[2])
    return [
        row("core_text_lx106", "core: code and constants, LX106, gcc -Os", int(sizes[0]), "B", TEXT_MUST),
        row("core_static_lx106", "core: variables outside of the board", data + bss, "B"),
        row(
            "core_text_esp32",
            "core: code and constants, ESP32, LLVM, counted in its assembly",
            esp32_bytes(esp32),
            "B",
            TEXT_MUST,
        ),
    ]


def esp32_bytes(directory: Path) -> int:
    """Instructions have three bytes, those ending in .n two; data directives as they say."""
    total = 0
    for path in directory.rglob("brov/*.s"):
        for line in path.read_text().splitlines():
            word = line.split("#")[0].split()
            if not word or not line.startswith("\t"):
                continue
            operation = word[0]
            if not operation.startswith("."):
                total += 2 if operation.endswith(".n") else 3
            elif operation in (".literal", ".long", ".word"):
                total += 4
            elif operation in (".byte", ".ascii", ".asciz", ".space", ".zero", ".short", ".half", ".quad"):
                total += data_bytes(operation, line.split(operation, 1)[1].strip())
    return total


def data_bytes(operation: str, operand: str) -> int:
    if operation in (".ascii", ".asciz"):
        text = operand[1 : operand.rindex('"')]
        return len(re.sub(r"\\(?:[0-7]{1,3}|.)", "x", text)) + (operation == ".asciz")
    if operation in (".space", ".zero"):
        return int(operand.split(",")[0].split("#")[0])
    return {".byte": 1, ".short": 2, ".half": 2, ".quad": 8}[operation]


class CallGraph:
    """Frames and calls as the compiler wrote them; a call through a pointer may reach every virtual function."""

    def __init__(self, lx106: Path) -> None:
        self.frames: dict[str, int] = {}
        self.calls: dict[str, set[str]] = defaultdict(set)
        for path in lx106.rglob("brov/*.ci"):
            self._read(path.read_text())
        self.virtual = self._virtual_functions(lx106)

    def _read(self, text: str) -> None:
        for title, label in re.findall(r'^node: \{ title: "([^"]*)" label: "([^"]*)"', text, re.MULTILINE):
            size = re.search(r"(\d+) bytes \(", label)
            if size:
                self.frames[title] = max(int(size[1]), self.frames.get(title, 0))
        for source, target in re.findall(r'sourcename: "([^"]*)" targetname: "([^"]*)"', text):
            self.calls[source].add(target)

    def _virtual_functions(self, lx106: Path) -> set[str]:
        names = set()
        for path in lx106.rglob("brov/*.o"):
            section = ""
            for line in output_of("xtensa-lx106-elf-objdump", "-r", path).splitlines():
                if line.startswith("RELOCATION RECORDS FOR"):
                    section = line
                elif "_ZTV" in section and ".xt.prop" not in section and "R_XTENSA_32" in line:
                    names.add(line.split()[-1].split("+")[0])
        # Local functions carry the file in front of their name.
        return {title for title in self.frames if title in names or title.rsplit(":", 1)[-1] in names}

    def deepest(self, start: str) -> int:
        """Bytes of the longest chain without a repetition; what the core never does (recursion) is left out by that."""

        @cache
        def below(function: str, seen: frozenset[str]) -> int:
            targets = set(self.calls[function])
            if INDIRECT in targets:
                targets |= self.virtual
            targets -= seen | {function, INDIRECT}
            inner = seen | {function}
            return self.frames.get(function, 0) + max((below(target, inner) for target in targets), default=0)

        return below(start, frozenset())


def stack_rows(lx106: Path, esp32: Path, measured: dict[str, dict[str, int]]) -> list[Row]:
    graph = CallGraph(lx106)
    entries = [int(size) for path in esp32.rglob("*.s") for size in re.findall(r"\tentry\ta1, (\d+)", path.read_text())]
    tick = next(title for title in graph.frames if title.endswith("_ZN4brov5Board4tickEy"))
    return [
        row("stack_frame_lx106", "largest stack frame, LX106", max(graph.frames.values()), "B"),
        row("stack_frame_esp32", "largest stack frame, ESP32 (windowed)", max(entries), "B"),
        row(
            "stack_depth_lx106",
            "deepest chain of calls from tick(), by the call graph",
            graph.deepest(tick),
            "B",
            STACK_MUST,
        ),
        row(
            "stack_seen_lx106",
            "deepest stack seen under QEMU",
            max(m["stack"] for m in measured.values()),
            "B",
            STACK_MUST,
        ),
    ]


def read_measured(path: Path) -> tuple[dict[str, int], dict[str, dict[str, int]]]:
    single, passes = {}, {}
    for line in path.read_text().splitlines():
        word = line.split()
        if word and word[0] == "passes":
            numbers = dict(zip(word[3::2], map(int, word[4::2]), strict=True))
            passes[word[1]] = {"count": int(word[2]), **numbers}
        elif len(word) == 2:
            single[word[0]] = int(word[1])
    return single, passes


def pass_rows(passes: dict[str, dict[str, int]], steps: float) -> list[Row]:
    rows = []
    for name, measured in passes.items():
        worst = round(measured["worst"] / steps)
        milliseconds = worst * CYCLES_PER_INSTRUCTION / CLOCK_HZ * 1e3
        mean = round(measured["sum"] / steps / measured["count"])
        must = PASS_MUST_MS if name.startswith("full_rate") and not name.endswith(SLOW_CODING) else None
        label = name.replace("_", " ")
        rows += [
            row(f"pass_mean_{name}", f"mean pass, {label}", mean, "instructions"),
            row(f"pass_worst_{name}", f"worst pass, {label}", worst, "instructions"),
            row(f"pass_worst_ms_{name}", f"worst pass at 240 MHz, {label}", round(milliseconds, 3), "ms", must),
        ]
    return rows


def kinematics_rows(single: dict[str, int], steps: float) -> list[Row]:
    """The rig's inverse kinematics. The LX106 has no FPU: every sum and product is a routine."""
    names = (
        ("ik_six_legs_mean", "rig: inverse kinematics of one platform, six legs, mean"),
        ("ik_six_legs_worst", "rig: inverse kinematics of one platform, worst"),
        ("ik_stack_mean", "rig: angles and counts of all 24 servos, mean"),
        ("ik_stack_worst", "rig: angles and counts of all 24 servos, worst"),
    )
    return [row(key, f"{name}, LX106 without FPU", round(single[key] / steps), "instructions") for key, name in names]


def table(rows: list[Row]) -> str:
    lines = ["| | value | unit | must | met |", "|---|---:|---|---:|---|"]
    for each in rows:
        must = "" if each["must"] is None else f"<= {each['must']:g}"
        met = {None: "", True: "yes", False: "NO"}[each["met"]]  # type: ignore[index]
        lines.append(f"| {each['name']} | {each['value']:g} | {each['unit']} | {must} | {met} |".replace("e+06", "e6"))
    return "\n".join(lines)


def main(build: Path, source: Path, target: Path) -> int:
    lx106, esp32 = build / "xtensa" / "lib", build / "xtensa" / "esp32"
    single, passes = read_measured(build / "xtensa" / "measured.txt")
    steps = single["steps_of_200000"] / CALIBRATION_INSTRUCTIONS
    rows = [
        *memory_rows(single["board_bytes"], source),
        *text_rows(lx106, esp32),
        *stack_rows(lx106, esp32, passes),
        *pass_rows(passes, steps),
        *kinematics_rows(single, steps),
    ]
    target.write_text(json.dumps({"cycles_per_instruction": CYCLES_PER_INSTRUCTION, "rows": rows}, indent=1) + "\n")
    sys.stdout.write(table(rows) + "\n")
    return 1 if any(each["met"] is False and each["id"] != NOT_ENFORCED for each in rows) else 0


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:])))
