"""A number on the command line that is one: click's own range lets NaN through, because nothing is beyond NaN."""

from __future__ import annotations

import math

import click


class FiniteRange(click.FloatRange):
    """As click's, without NaN and infinity."""

    def convert(self, value: float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is no number in the range {self._describe_range()}.", param, ctx)
        return number
