import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted((ROOT / "src").rglob("*.py"))
WEB = ROOT / "web"
PAGES = sorted(
    path
    for path in WEB.rglob("*")
    if path.suffix in {".js", ".html", ".css", ".svg"} and path.relative_to(WEB).parts[0] not in {"vendor", "test"}
)
SVG_NAMESPACE = "http://www.w3.org/2000/svg"
# Names of formats that look like addresses; nothing is fetched from them.
NAMESPACES = (SVG_NAMESPACE, "http://www.topografix.com/GPX/1/1")
# Run on a laptop, never on the vehicle.
OFFLINE = {"evaluation", "survey"}


def test_layers_import_only_what_stands_below_them() -> None:
    command = Path(sys.executable).with_name("lint-imports")
    result = subprocess.run([command, "--no-logo", "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert re.search(r"Contracts: \d+ kept, 0 broken", result.stdout)


def imported_packages(path: Path) -> set[str]:
    packages: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            packages.update(alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            packages.add(node.module.split(".")[0])
    return packages


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_scipy_is_imported_offline_only(path: Path) -> None:
    """The vehicle has no SciPy: evaluation and surveys may use it, inside a function and with their extra installed."""
    if path.relative_to(ROOT / "src" / "bluerov_slam").parts[0] not in OFFLINE:
        assert "scipy" not in imported_packages(path)
    else:
        top = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.Import | ast.ImportFrom)]
        assert not [node for node in top if "scipy" in ast.unparse(node)]


def print_calls(path: Path) -> list[int]:
    return [
        node.lineno
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
    ]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_only_the_command_line_prints(path: Path) -> None:
    assert not print_calls(path) or "cli" in path.parts


def external_urls(text: str) -> list[str]:
    without_comments = re.sub(r"/\*.*?\*/|<!--.*?-->|(?<![:\"'`])//[^\n]*", "", text, flags=re.DOTALL)
    urls = re.findall(r"(?:https?:)?//[\w.\[-][^\s\"'`)<>]*", without_comments)
    return [url for url in urls if not url.startswith(NAMESPACES)]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('<script src="https://cdn.example/x.js">', True),
        ("import x from '//cdn.example/x.js';", True),
        ("@import url(http://fonts.example/a.css);", True),
        (f"document.createElementNS('{SVG_NAMESPACE}', 'svg')", False),
        ("// see https://example.org\n/* http://example.org */ <!-- http://example.org -->", False),
    ],
)
def test_the_search_for_external_urls_works(text: str, found: bool) -> None:
    assert bool(external_urls(text)) is found


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(WEB)))
def test_pages_fetch_nothing_from_outside(path: Path) -> None:
    assert external_urls(path.read_text()) == []


@pytest.mark.parametrize(
    "path", [path for path in PAGES if path.suffix == ".html"], ids=lambda path: str(path.relative_to(WEB))
)
def test_pages_work_under_any_path_prefix(path: Path) -> None:
    assert re.findall(r"(?:src|href|action)\s*=\s*[\"']/[^\"']*", path.read_text()) == []
