"""Records in, NavState and Event out: the one estimator of live operation, replay and batch."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bluerov_slam.pipeline.navigator_commands import NavigatorAction, NavigatorCommand, SavedNavigation
from bluerov_slam.pipeline.navigator_options import NavigatorOptions

if TYPE_CHECKING:
    from bluerov_slam.records import Event, NavState, Record

__all__ = ["Navigator", "NavigatorAction", "NavigatorCommand", "NavigatorOptions", "SavedNavigation"]


class Navigator:
    """Takes records in order of arrival; the same records give the same results, bit for bit."""

    def __init__(
        self,
        options: NavigatorOptions | None = None,
        saved: SavedNavigation | None = None,
        saved_age_s: float | None = None,
    ) -> None:
        self.options = options or NavigatorOptions()
        self._saved = saved
        self._saved_age_s = saved_age_s
        self._now_s = 0.0

    def feed(self, record: Record) -> list[NavState | Event]:
        """Take one record."""
        self._now_s = getattr(record, "arrived_s", self._now_s)
        return []

    def command(self, command: NavigatorCommand) -> list[NavState | Event]:
        """Do what the user asked; the answer is an event."""
        return []

    def save(self) -> SavedNavigation:
        """What a restart needs."""
        return SavedNavigation(at_s=self._now_s)

    def expire(self, now_s: float) -> list[NavState | Event]:
        """Live only, when records stay away: says when nothing is known any more. Changes nothing in the estimate."""
        return []
