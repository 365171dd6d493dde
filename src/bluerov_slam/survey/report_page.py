"""The page of a report: one HTML file that needs nothing else, and figures in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bluerov_slam.evaluation.navigation_table import Row

NO_PLOTS = '<p class=banner>No plots: get matplotlib with pip install "bluerov-slam[survey]".</p>'

_CSS = """
:root{color-scheme:light}*{box-sizing:border-box}
body{margin:0 auto;max-width:60rem;padding:1.5rem 1rem 4rem;background:#fff;color:#1f2328;
font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
h1{font-size:1.6rem;margin:0 0 .25rem;overflow-wrap:anywhere}h2{font-size:1.2rem;margin:2.2rem 0 .5rem}
p,li{max-width:46rem}.sub{color:#57606a;margin:0 0 1rem}
.banner{border-left:4px solid #d4a72c;background:#fff8c5;padding:.6rem .9rem;margin:.8rem 0}
.banner.bad{border-color:#cf222e;background:#ffebe9}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(9rem,1fr));gap:.6rem;margin:1rem 0}
.facts div{border:1px solid #d0d7de;border-radius:6px;padding:.5rem .7rem}
.facts b{display:block;font-size:1.15rem}.facts span{color:#57606a;font-size:.85rem}
figure{margin:.8rem 0;overflow-x:auto}figure svg{max-width:100%;height:auto}
figcaption{color:#57606a;font-size:.9rem;max-width:46rem}
table{border-collapse:collapse;font-size:.9rem;display:block;overflow-x:auto}
th,td{text-align:left;padding:.3rem .7rem .3rem 0;border-bottom:1px solid #d0d7de;vertical-align:top}
td.n,th.n{text-align:right}td.n{white-space:nowrap}details{margin:.8rem 0}summary{cursor:pointer}
@media print{body{max-width:none}figure{break-inside:avoid}}
"""


def page_html(title: str, parts: Iterable[str]) -> str:
    """The whole page; `parts` are HTML."""
    meta = '<meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">'
    head = f"{meta}<title>{escape(title)}</title><style>{_CSS}</style>"
    return f"<!doctype html><html lang=en><head>{head}</head><body>{''.join(parts)}</body></html>\n"


def figure_html(plots: dict[str, str] | None, name: str, title: str, caption: str) -> str:
    """A drawn plot by its name with heading and caption; nothing where it was not drawn."""
    if not plots or name not in plots:
        return ""
    head = f"<h2>{escape(title)}</h2>" if title else ""
    label = escape(title or name)
    svg = plots[name].replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)
    return f"{head}<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def drawn(draw: Callable[[], dict[str, str]]) -> dict[str, str] | None:
    """What `draw` makes, None where matplotlib is not there; import what draws inside of it."""
    try:
        return draw()
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("matplotlib"):
            raise
        return None


def table_html(heads: Sequence[str], lines: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """A table of words; the columns `numbers` stand to the right."""
    right = set(numbers)
    kinds = ["n" if column in right else "" for column in range(len(heads))]
    head = "".join(f"<th class={kind or 't'}>{escape(text)}" for kind, text in zip(kinds, heads, strict=True))
    rows = "".join(
        "<tr>" + "".join(f"<td class={kind or 't'}>{escape(text)}" for kind, text in zip(kinds, line, strict=True))
        for line in lines
    )
    return f"<table><tr>{head}{rows}</table>"


def rows_html(rows: Sequence[Row]) -> str:
    """Figures beside their targets, as the commands print them."""
    lines = []
    for row in rows:
        low, high = row.interval.low, row.interval.high
        lines.append(
            (
                row.id,
                row.name,
                f"{shown(row.interval.value)} {row.unit}".strip(),
                "" if math.isnan(low) or low == high else f"{low:.3g} to {high:.3g}",
                *("" if target is None else str(target) for target in (row.must, row.aim)),
                "" if row.bound_ratio is None else f"{row.bound_ratio:.2f}",
                {True: "yes", False: "no", None: ""}[row.met],
            )
        )
    return table_html(("Id", "Figure", "value", "95 %", "must", "aim", "/ bound", "met"), lines, range(2, 7))


def verdict_html(rows: Sequence[Row]) -> str:
    """In one line: what was missed."""
    missed = [row.id for row in rows if row.met is False]
    judged = sum(row.met is not None for row in rows)
    if missed:
        return f"<p class='banner bad'>{judged} targets, not met: {escape(', '.join(missed))}.</p>"
    return f"<p class=sub>{judged} targets, all met.</p>" if judged else ""


def shown(value: float) -> str:
    """A figure with four digits, whole ones without a fraction; "-" is none."""
    if math.isnan(value):
        return "-"
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e6 else f"{value:.4g}"
