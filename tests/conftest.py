import pytest

from real_data import NEEDS


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how many data tests were skipped, and name each other skip in a line that .ci/run looks for."""
    reasons = [str(report.longrepr[2]) for report in terminalreporter.stats.get("skipped", [])]
    without_data = [reason for reason in reasons if NEEDS in reason]
    terminalreporter.write_line(f"data tests skipped: {len(without_data)}")
    for reason in sorted(set(reasons) - set(without_data)):
        terminalreporter.write_line(f"SKIP: {reason.removeprefix('Skipped: ')}")
