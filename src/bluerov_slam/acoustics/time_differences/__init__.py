"""Arrival time differences of one pulse at several receivers, from a record of all of them."""

from bluerov_slam.acoustics.time_differences.estimate import METHODS, Method, estimate_delays
from bluerov_slam.acoustics.time_differences.result import DelayPrior, TimeDifferences

__all__ = ["METHODS", "DelayPrior", "Method", "TimeDifferences", "estimate_delays"]
