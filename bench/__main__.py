"""`make bench`: every benchmark in one table, and bench/results.json."""

from __future__ import annotations

import importlib
import json
import sys
import time
from pathlib import Path

MODULES = (
    "decode",
    "coding",
    "live",
    "pose",
    "fanout",
    "recording",
    "memory",
    "navigation_filter",
    "attitude",
    "acoustic_delays",
    "acoustic_solvers",
    "simulated_dive",
    "acoustic_records",
    "rig_kinematics",
    "rig_workspace",
)
RESULTS = Path(__file__).parent / "results.json"


def main() -> int:
    """Run the benchmarks named on the command line, or all of them; exit code 1 when a target is missed."""
    rows: list[dict[str, object]] = []
    for name in sys.argv[1:] or MODULES:
        begin = time.monotonic()
        rows += importlib.import_module(f"bench.{name}").rows()
        print(f"# {name}: {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    RESULTS.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    print(table(rows))
    return 0 if all(row["met"] for row in rows) else 1


def table(rows: list[dict[str, object]]) -> str:
    """The rows as Markdown."""
    lines = ["| id | what | value | unit | must | met | beside it |", "|---|---|---|---|---|---|---|"]
    lines += [
        f"| {r['id']} | {r['name']} | {r['value']} | {r['unit']} | {r['must']} | {'yes' if r['met'] else 'NO'} "
        f"| {r.get('reference', '')} |"
        for r in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
