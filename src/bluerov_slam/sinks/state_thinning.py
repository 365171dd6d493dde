"""Fewer estimates than the navigator makes: what is written down need not be as fast as what steers."""

from __future__ import annotations

from bluerov_slam.records import NavState

# Half a period of a 20 Hz estimate early is on time.
_EARLY_S = 0.025


class StateThinning:
    """Lets an estimate through at most once in `period_s`, but each one that brings a new mode or a jump."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._before: NavState | None = None

    def wants(self, state: NavState) -> bool:
        """Whether this one is kept."""
        before = self._before
        wanted = (
            before is None
            or state.mode is not before.mode
            or state.reset_counter != before.reset_counter
            or not 0.0 <= state.measured_s - before.measured_s < self._period_s - _EARLY_S
        )
        if wanted:
            self._before = state
        return wanted
