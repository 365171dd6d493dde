"""The table of the navigation targets: outcomes of all runs in, one row for each figure out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bluerov_slam.evaluation.held_out_fixes import inside_ellipse
from bluerov_slam.evaluation.navigation_cases import (
    INERTIAL_FOR_S,
    DiveOutcome,
    HeadingOutcome,
    HeldOutOutcome,
    SnapirOutcome,
)
from bluerov_slam.evaluation.statistics import (
    Interval,
    bootstrap,
    lowest_credible_ratio,
    mean_band,
    ratio_of_rms,
    ratio_of_sums,
    total_dof,
)
from bluerov_slam.pipeline.navigator_aids import NO_SENSOR

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from bluerov_slam.evaluation.navigation_cases import Outcome

_POSITION_DOF = 3
_RATIO_MUST, _RATIO_AIM = 2.0, 1.3
_NIS_BAND = (0.7, 1.4)
_FEW_TESTED = 1000  # a sensor with fewer measurements over all seeds has no mean worth judging


@dataclass(frozen=True, slots=True)
class Target:
    """What a value must be: at least `low` and at most `high`, each None where there is no such limit."""

    low: float | None = None
    high: float | None = None

    def met_by(self, value: float) -> bool:
        """Whether it is; a value that is none never is."""
        return (
            math.isfinite(value)
            and (self.low is None or value >= self.low)
            and (self.high is None or value <= self.high)
        )

    def __str__(self) -> str:
        if self.low is None:
            return f"<= {self.high:g}"
        return f">= {self.low:g}" if self.high is None else f"{self.low:.3g}..{self.high:.3g}"


@dataclass(frozen=True, slots=True)
class Row:
    """One figure. Without `must` it is told for comparison only; `bound_ratio`: RMS over seeds / RMS of the bound."""

    id: str
    name: str
    interval: Interval
    unit: str
    must: Target | None = None
    aim: Target | None = None
    bound_ratio: float | None = None

    @property
    def met(self) -> bool | None:
        """Whether it is what it must be; None where nothing is asked."""
        return None if self.must is None else self.must.met_by(self.interval.value)

    def as_json(self) -> dict[str, Any]:
        """Plain values; what is not a number is null."""
        return {
            "id": self.id,
            "name": self.name,
            "value": _number(self.interval.value),
            "interval": [_number(self.interval.low), _number(self.interval.high)],
            "unit": self.unit,
            "must": None if self.must is None else str(self.must),
            "aim": None if self.aim is None else str(self.aim),
            "bound_ratio": self.bound_ratio,
            "met": self.met,
        }


def table(cases: Iterable[str], outcomes: Sequence[Outcome]) -> list[Row]:
    """Rows of the asked cases, in their order; a case none of whose runs is there has none."""
    dives = sorted((each for each in outcomes if isinstance(each, DiveOutcome)), key=lambda each: each.seed)
    makers: dict[str, Callable[[], list[Row]]] = {
        "N1": lambda: _inertial(dives),
        "N2": lambda: _dead_reckoning(dives),
        "N3": lambda: _ends_known(dives),
        "N4": lambda: _with_dvl(dives),
        "N5": lambda: _heading([each for each in outcomes if isinstance(each, HeadingOutcome)]),
        "N6": lambda: _consistency(dives),
        "N7": lambda: _snapir([each for each in outcomes if isinstance(each, SnapirOutcome)]),
        "N8": lambda: _held_out([each for each in outcomes if isinstance(each, HeldOutOutcome)]),
    }
    wanted = set(cases)
    return [row for case, make in makers.items() if case in wanted for row in make()]


def _of(dives: Sequence[DiveOutcome], case: str, conditions: str) -> list[DiveOutcome]:
    return [each for each in dives if (each.case, each.conditions) == (case, conditions)]


def _inertial(dives: Sequence[DiveOutcome]) -> list[Row]:
    runs = [each.inertial for each in dives if each.inertial]
    if not runs:
        return []
    band = Target(*mean_band(_POSITION_DOF, len(runs)))
    return [
        Row(
            f"N1.{seconds:.0f}s",
            f"{seconds:.0f} s pure inertial: mean NEES of position / 3",
            bootstrap(
                [run.get(seconds, math.nan) / _POSITION_DOF for run in runs], lambda rows: np.mean(rows, axis=-1)
            ),
            "1",
            band,
        )
        for seconds in INERTIAL_FOR_S
    ]


def _dead_reckoning(dives: Sequence[DiveOutcome]) -> list[Row]:
    rows: list[Row] = []
    targets = {
        "hard": (Target(high=10.0), Target(high=8.0)),
        "calm": (Target(high=6.0), Target(high=5.0)),
        "still": (None, Target(high=4.0)),
    }
    for conditions, (must, aim) in targets.items():
        runs = _of(dives, "N2", conditions)
        if not runs:
            continue
        name = f"400 s surface run, then dead reckoning, {conditions}"
        end = bootstrap([each.judged.end_percent for each in runs])
        if conditions == "still":
            # No ratio: the bound knows that there is no current, which no navigator can.
            rows.append(Row(f"N2.{conditions}", f"{name}: end error", end, "%", must, aim))
        else:
            ratio = _ratio(f"N2.{conditions}", name, runs, "end")
            rows.append(Row(f"N2.{conditions}", f"{name}: end error", end, "%", must, aim, ratio.interval.value))
            rows.append(ratio)
        rows += _comparisons(f"N2.{conditions}", runs)
    return rows


def _ends_known(dives: Sequence[DiveOutcome]) -> list[Row]:
    runs = _of(dives, "N3", "hard")
    if not runs:
        return []
    name = "GPS at both ends, hard, smoothed"
    ratio = _ratio("N3", name, runs, "ate")
    ate = bootstrap([each.judged.ate_m for each in runs])
    gain = [100.0 * (1.0 - each.judged.ate_m / each.baselines["rubber band"][0]) for each in runs]
    return [
        Row("N3", f"{name}: ATE", ate, "m", Target(high=22.0), Target(high=18.0), ratio.interval.value),
        Row("N3.gain", f"{name}: better than the rubber band by", bootstrap(gain), "%", Target(low=10.0)),
        ratio,
        *_comparisons("N3", runs),
    ]


def _with_dvl(dives: Sequence[DiveOutcome]) -> list[Row]:
    runs = _of(dives, "N4", "hard")
    if not runs:
        return []
    name = "DVL and GPS at both ends, hard, smoothed"
    ratio = _ratio("N4", name, runs, "ate")
    ate = bootstrap([each.judged.ate_m for each in runs])
    return [
        Row("N4", f"{name}: ATE", ate, "m", Target(high=4.7), Target(high=3.7), ratio.interval.value),
        ratio,
        *_comparisons("N4", runs),
    ]


def _ratio(case: str, name: str, runs: Sequence[DiveOutcome], what: str) -> Row:
    """RMS over seeds / RMS bound; below the 2.5 % chi-square limit it is a bug, of the bound or of the run."""
    if what == "end":
        pairs = [(each.judged.end_m, each.bound_end_m) for each in runs]
        dofs = [each.bound_end_dof for each in runs]
    else:
        pairs = [(each.judged.ate_m, each.bound_ate_m) for each in runs]
        dofs = [each.bound_ate_dof for each in runs]
    limit = lowest_credible_ratio(total_dof([bound**2 for _, bound in pairs], dofs))
    interval = bootstrap(np.array(pairs), ratio_of_rms)
    must, aim = Target(limit, _RATIO_MUST), Target(limit, _RATIO_AIM)
    return Row(f"{case}.ratio", f"{name}: RMS / RMS bound", interval, "1", must, aim, interval.value)


def _comparisons(case: str, runs: Sequence[DiveOutcome]) -> list[Row]:
    """What is told beside the targets."""
    bound = bootstrap([each.bound_end_m if case.startswith("N2") else each.bound_ate_m for each in runs])
    rows = [
        Row(f"{case}.bound", "its bound (RMS of one dive)", bound, "m"),
        Row(f"{case}.ate", "ATE", bootstrap([each.judged.ate_m for each in runs]), "m"),
        Row(f"{case}.end", "end error", bootstrap([each.judged.end_m for each in runs]), "m"),
        Row(
            f"{case}.aligned", "ATE after SE(2) alignment", bootstrap([each.judged.aligned_ate_m for each in runs]), "m"
        ),
        Row(f"{case}.causal", "ATE of the causal run", bootstrap([each.causal.ate_m for each in runs]), "m"),
    ]
    for place, segment in enumerate((10, 50, 100)):
        relative = [each.judged.relative_m[place] for each in runs]
        known = [error for error in relative if error is not None]
        if known:
            rows.append(Row(f"{case}.rpe{segment}", f"relative error over {segment} m", bootstrap(known), "m"))
    for baseline in ("constant speed", "thrusters", "rubber band"):
        what, index = ("end error", 1) if case.startswith("N2") else ("ATE", 0)
        errors = [each.baselines[baseline][index] for each in runs]
        rows.append(Row(f"{case}.{baseline.replace(' ', '_')}", f"{what} of: {baseline}", bootstrap(errors), "m"))
    return rows


def _heading(runs: Sequence[HeadingOutcome]) -> list[Row]:
    if not runs:
        return []
    after = bootstrap([math.degrees(each.rms_rad) for each in runs])
    before = bootstrap([math.degrees(each.without_swing_rad) for each in runs])
    return [
        Row("N5", "heading after a compass swing, moving: RMS", after, "deg", Target(high=2.0), Target(high=1.0)),
        Row("N5.before", "the same without the swing", before, "deg"),
    ]


def _consistency(dives: Sequence[DiveOutcome]) -> list[Row]:
    judged = [each for each in dives if each.conditions != "still"]
    if not judged:
        return []
    rows = _in_band("N6", "N2 to N4", judged, Target(low=90.0))
    groups: dict[tuple[str, str], list[DiveOutcome]] = {}
    for each in judged:
        groups.setdefault((each.case, each.conditions), []).append(each)
    for (case, conditions), runs in groups.items():
        rows += _in_band(f"N6.{case}.{conditions}", f"{case} {conditions}", runs, None)
    sensors = sorted({sensor for each in judged for sensor in each.nis} - {NO_SENSOR})
    for sensor in sensors:
        sums = np.array([(each.nis[sensor].nis, each.nis[sensor].dof) for each in judged if sensor in each.nis])
        if sums[:, 1].sum() < _FEW_TESTED:
            continue
        ratio = bootstrap(sums, ratio_of_sums)
        rows.append(Row(f"N6.nis.{sensor}", f"mean NIS / dof of {sensor}", ratio, "1", Target(*_NIS_BAND)))
    return rows


def _in_band(place: str, name: str, runs: Sequence[DiveOutcome], must: Target | None) -> list[Row]:
    """Share of all epochs of all runs with NEES in its band; the mean NEES tells on which side the rest is."""
    rows: list[Row] = []
    for suffix, what, dof in (("", "pose", 6), (".position", "position", 2)):
        shares, means = [], []
        for run in runs:
            figures = run.judged
            in_band, nees = (
                (figures.pose_in_band, figures.pose_nees)
                if what == "pose"
                else (figures.position_in_band, figures.position_nees)
            )
            shares.append((in_band * figures.epochs, figures.epochs))
            means.append(nees / dof)
        share = _percent(bootstrap(np.array(shares), ratio_of_sums))
        mean = bootstrap(means, lambda rows: np.mean(rows, axis=-1))
        rows += [
            Row(f"{place}{suffix}", f"{name}: epochs inside the 95 % NEES band, {what} ({dof})", share, "%", must),
            Row(f"{place}{suffix}.mean", f"{name}: mean NEES / {dof} of the {what}", mean, "1"),
        ]
    return rows


def _snapir(runs: Sequence[SnapirOutcome]) -> list[Row]:
    if not runs:
        return []
    found = [each.figures for each in runs]
    heading = [100.0 * (abs(each.heading_error_rad) <= 2.0 * each.heading_std_rad) for each in found]
    scale = [100.0 * (abs(each.scale_error) <= 2.0 * each.scale_std) for each in found]
    mean = lambda rows: np.mean(rows, axis=-1)  # noqa: E731
    end = bootstrap([each.end_percent for each in found])
    share = Target(low=90.0)
    return [
        Row("N7", "Snapir, three fixes: end error before the last fix", end, "%", Target(high=0.55), Target(high=0.46)),
        Row("N7.heading", "heading error found within 2 sigma", bootstrap(heading, mean), "%", share),
        Row("N7.scale", "scale error found within 2 sigma", bootstrap(scale, mean), "%", share),
        Row("N7.after", "end error with the last fix", bootstrap([each.after_percent for each in found]), "%"),
        Row("N7.plain", "plain integration, same errors", bootstrap([each.plain_percent for each in found]), "%"),
        Row("N7.clean", "plain integration, no errors", bootstrap([each.plain_clean_percent for each in found]), "%"),
        Row(
            "N7.heading_std",
            "stated 1 sigma of the heading error",
            bootstrap([math.degrees(each.heading_std_rad) for each in found]),
            "deg",
        ),
        Row(
            "N7.scale_std",
            "stated 1 sigma of the scale error",
            bootstrap([100.0 * each.scale_std for each in found]),
            "%",
        ),
    ]


def _held_out(runs: Sequence[HeldOutOutcome]) -> list[Row]:
    rows: list[Row] = []
    for year in ("2024", "2022"):
        of_year = [each for each in runs if each.dive.startswith(year)]
        for block_s in sorted({each.block_s for each in of_year}):
            blocks = _blocks([each for each in of_year if each.block_s == block_s])
            if not blocks:
                rows.append(_nothing(year, block_s))
                continue
            rows += _predictions(year, block_s, blocks)
        refused = [each.given for each in of_year]
        outliers = sum(each.outliers for each in refused)
        others = sum(each.others for each in refused)
        if year == "2022" and outliers:
            share = 100.0 * sum(each.outliers_refused for each in refused) / outliers
            rows.append(
                Row(
                    "N8.2022.outliers", "outliers among the given fixes refused", _exactly(share), "%", Target(low=90.0)
                )
            )
        if others:
            share = 100.0 * sum(each.others_refused for each in refused) / others
            rows.append(Row(f"N8.{year}.refused", "other given fixes refused", _exactly(share), "%"))
    return rows


def _predictions(year: str, block_s: float, blocks: list[list[tuple[float, float, float]]]) -> list[Row]:
    """Rows of one year and length. Asked is the gain in RMS, as everywhere; that of the median stands beside it."""
    name = f"{year}, {block_s:.0f} s held out"
    place = f"N8.{year}.{block_s:.0f}s"
    inside = _over_blocks(blocks, lambda fixes: 100.0 * float(np.mean([inside_ellipse(nis) for *_, nis in fixes])))
    return [
        Row(
            place,
            f"{name}: better than constant velocity by",
            _over_blocks(blocks, lambda fixes: _gain(fixes, _rms)),
            "%",
            Target(low=30.0),
            Target(low=50.0),
        ),
        Row(
            f"{place}.median_gain",
            f"{name}: in the median better by",
            _over_blocks(blocks, lambda fixes: _gain(fixes, _median)),
            "%",
        ),
        Row(f"{place}.inside", f"{name}: inside our 95 % ellipse", inside, "%", Target(90.0, 98.0)),
        Row(f"{place}.median", f"{name}: our median error", _over_blocks(blocks, lambda fixes: _median(fixes, 0)), "m"),
        Row(
            f"{place}.baseline", f"{name}: its median error", _over_blocks(blocks, lambda fixes: _median(fixes, 1)), "m"
        ),
        Row(f"{place}.rms", f"{name}: our RMS error", _over_blocks(blocks, lambda fixes: _rms(fixes, 0)), "m"),
        Row(f"{place}.baseline_rms", f"{name}: its RMS error", _over_blocks(blocks, lambda fixes: _rms(fixes, 1)), "m"),
    ]


def _blocks(runs: Sequence[HeldOutOutcome]) -> list[list[tuple[float, float, float]]]:
    """(Our error, the baseline's, our NIS) of the fixes of each block; outliers left out."""
    blocks: dict[tuple[str, int], list[tuple[float, float, float]]] = {}
    for run in runs:
        for each in run.held:
            if not each.outlier:
                blocks.setdefault((run.dive, each.block), []).append((each.ours_m, each.baseline_m, each.nis))
    return list(blocks.values())


def _nothing(year: str, block_s: float) -> Row:
    """No prediction at all is a failure, not a missing row."""
    name = f"{year}, {block_s:.0f} s held out: nothing was predicted"
    return Row(f"N8.{year}.{block_s:.0f}s", name, _exactly(math.nan), "%", Target(low=30.0), Target(low=50.0))


def _over_blocks(
    blocks: list[list[tuple[float, float, float]]], statistic: Callable[[list[tuple[float, float, float]]], float]
) -> Interval:
    """A statistic of all fixes; its interval by resampling whole blocks, whose fixes are not independent."""
    everything = [fix for block in blocks for fix in block]
    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(500):
        chosen = rng.integers(0, len(blocks), len(blocks))
        drawn.append(statistic([fix for number in chosen for fix in blocks[number]]))
    low, high = np.quantile(drawn, (0.025, 0.975))
    return Interval(statistic(everything), float(low), float(high))


def _gain(
    fixes: list[tuple[float, float, float]], error: Callable[[list[tuple[float, float, float]], int], float]
) -> float:
    return 100.0 * (1.0 - error(fixes, 0) / error(fixes, 1))


def _rms(fixes: list[tuple[float, float, float]], place: int) -> float:
    return math.sqrt(sum(fix[place] ** 2 for fix in fixes) / len(fixes))


def _median(fixes: list[tuple[float, float, float]], place: int) -> float:
    return float(np.median([fix[place] for fix in fixes]))


def _percent(interval: Interval) -> Interval:
    return Interval(100.0 * interval.value, 100.0 * interval.low, 100.0 * interval.high)


def _exactly(value: float) -> Interval:
    return Interval(value, value, value)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
