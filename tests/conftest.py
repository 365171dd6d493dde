import pytest
from hypothesis import HealthCheck, settings

from real_data import NEEDS

# The same examples in every run and no clock: a busy machine fails no test, and what fails, fails again.
# To look for what they miss: pytest --hypothesis-profile random
settings.register_profile("random", deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", settings.get_profile("random"), derandomize=True)
settings.load_profile("same")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how many data tests were skipped, and name each other skip in a line that .ci/run looks for."""
    reasons = [str(report.longrepr[2]) for report in terminalreporter.stats.get("skipped", [])]
    without_data = [reason for reason in reasons if NEEDS in reason]
    terminalreporter.write_line(f"data tests skipped: {len(without_data)}")
    for reason in sorted(set(reasons) - set(without_data)):
        terminalreporter.write_line(f"SKIP: {reason.removeprefix('Skipped: ')}")
