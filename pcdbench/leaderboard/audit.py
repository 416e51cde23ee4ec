"""Whether a task measures anything: the references must come out in the order that they were made in.

For a task's main metric, over the scenes of a split: the truth is at least as good as the noise ceiling (a
tie within the interval is fine), which is better than what is left when little is missing, which is better
than with more missing, and so on; and at the highest level the ceiling and what is left lie so far apart that
their 95 % intervals do not touch.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from pcdbench.leaderboard.statistics import Estimate, mean_estimate
from pcdbench.leaderboard.summary import case_means, level_text, samples_table

# The audit's protocol is about these three: they are what they are called, whatever else is registered.
TRUTH, CEILING, FLOOR = "ground_truth", "resample", "incomplete"


@dataclass(frozen=True)
class ReferenceStanding:
    """What a reference scores at a level: the mean over cases, each case counting with its mean sample."""

    reference: str
    level: float
    cases: int
    failed: int
    skipped: int
    mean: Estimate | None


@dataclass(frozen=True)
class Check:
    """One comparison of the audit.

    Attributes:
        advantage: by how much the first is better than the second, in the metric's unit, paired by case.
        note: for people: a tie, an interval that includes zero.
    """

    name: str
    holds: bool
    advantage: Estimate | None
    note: str = ""


@dataclass(frozen=True)
class Audit:
    """The audit of a task under one incompleteness."""

    task: str
    metric: str
    unit: str
    direction: str
    incompleteness: str
    scenes: int
    ceiling: str
    standings: tuple[ReferenceStanding, ...]
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        return bool(self.checks) and all(check.holds for check in self.checks)

    @property
    def broken(self) -> list[str]:
        """The names of the comparisons that do not hold."""
        return [check.name for check in self.checks if not check.holds]

    def as_json(self) -> dict[str, Any]:
        """The audit as JSON values; an interval that does not exist is null."""
        return _without_nan(asdict(self) | {"passed": self.passed})


def audits(rows: Sequence[Mapping[str, Any]]) -> list[Audit]:
    """One audit for each task and incompleteness of a run of the references."""
    found: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        found.setdefault((row["task"]["name"], row["incompleteness"]["name"]), []).append(row)
    return [_audit(task, incompleteness, its) for (task, incompleteness), its in found.items()]


def _audit(task: str, incompleteness: str, rows: Sequence[Mapping[str, Any]]) -> Audit:
    table = samples_table(rows)
    table = table[table["main"].astype(bool)]
    levels = sorted({row["level"] for row in rows})
    if table.empty:
        reason = next((row["error"] for row in rows if row["status"] != "ok"), "no samples")
        nothing = Check("something is measured", False, None, str(reason))
        return Audit(task, "", "", "", incompleteness, 0, "", _standings(rows, table, levels), (nothing,))
    first = table.iloc[0]
    ceiling = CEILING if CEILING in set(table["completer"]) else TRUTH
    judge = _Judge(table, first["direction"])
    highest = levels[-1]
    checks = [] if ceiling == TRUTH else [judge.at_least_as_good()]
    checks.append(
        judge.better(f"{ceiling} beats {FLOOR} {level_text(levels[0])}", (ceiling, levels[0]), (FLOOR, levels[0]))
    )
    for less, more in pairwise(levels):
        checks.append(
            judge.better(f"{FLOOR} {level_text(less)} beats {level_text(more)}", (FLOOR, less), (FLOOR, more))
        )
    checks.append(
        judge.apart(f"{ceiling} apart from {FLOOR} {level_text(highest)}", (ceiling, highest), (FLOOR, highest))
    )
    return Audit(
        task=task,
        metric=first["metric"],
        unit=first["unit"],
        direction=first["direction"],
        incompleteness=incompleteness,
        scenes=int(table["scene"].nunique()),
        ceiling=ceiling,
        standings=_standings(rows, table, levels),
        checks=tuple(checks),
    )


class _Judge:
    """Compares references of one task's main metric, paired by scene and draw; intervals are over environments."""

    def __init__(self, table: pd.DataFrame, direction: str) -> None:
        self._sign = 1.0 if direction == "lower" else -1.0
        self._means = {name: case_means(table, name) for name in table["completer"].unique()}
        self._environments = _environments(table)

    def at_least_as_good(self) -> Check:
        """The truth against the ceiling, at all levels: worse only where the interval says so."""
        name = f"{TRUTH} no worse than {CEILING}"
        both = [self._means.get(reference) for reference in (TRUTH, CEILING)]
        if any(one is None for one in both):
            return Check(name, False, None, "not measured")
        advantage = self._advantage(*both)
        if advantage is None:
            return Check(name, False, None, "no case in common")
        worse = advantage.high < 0 if advantage.has_interval else advantage.value < 0
        tie = advantage.has_interval and advantage.low <= 0 <= advantage.high
        return Check(name, not worse, advantage, "tie" if tie else "")

    def better(self, name: str, first: tuple[str, float], second: tuple[str, float]) -> Check:
        """The first is better on the mean; the note says where the interval cannot exclude the contrary."""
        advantage = self._advantage(self._at(*first), self._at(*second))
        if advantage is None:
            return Check(name, False, None, "no case in common")
        if not advantage.has_interval:
            return Check(name, advantage.value > 0, advantage, "no interval: it takes two scenes or more")
        unclear = advantage.low <= 0 <= advantage.high
        return Check(name, advantage.value > 0, advantage, "interval includes 0" if unclear else "")

    def apart(self, name: str, first: tuple[str, float], second: tuple[str, float]) -> Check:
        """The intervals of the two, each on its own, do not touch, and the first is the better one."""
        upper, lower = (self._mean(self._at(*which)) for which in (first, second))
        if upper is None or lower is None or not (upper.has_interval and lower.has_interval):
            return Check(name, False, None, "no intervals: it takes two scenes or more")
        gap = lower.low - upper.high if self._sign > 0 else upper.low - lower.high
        advantage = self._advantage(self._at(*first), self._at(*second))
        return Check(name, gap > 0, advantage, "intervals are apart" if gap > 0 else "intervals touch")

    def _at(self, reference: str, level: float) -> pd.Series:
        means = self._means.get(reference)
        if means is None:
            return pd.Series(dtype=float, index=pd.MultiIndex.from_arrays([[], []], names=["scene", "draw"]))
        its = means[means.index.get_level_values("level") == level]
        return its.droplevel(["incompleteness", "level"])

    def _advantage(self, first: pd.Series, second: pd.Series) -> Estimate | None:
        return self._mean(self._sign * (second - first).dropna())

    def _mean(self, means: pd.Series) -> Estimate | None:
        if means.empty:
            return None
        return _over_environments(means, self._environments)


def _standings(
    rows: Sequence[Mapping[str, Any]], table: pd.DataFrame, levels: Sequence[float]
) -> tuple[ReferenceStanding, ...]:
    standings = []
    for reference in (TRUTH, CEILING, FLOOR):
        for level in levels:
            its = [row for row in rows if row["completer"]["name"] == reference and row["level"] == level]
            means = case_means(table[table["level"] == level], reference)
            skipped = sum(row["status"] == "skipped" for row in its)
            failed = sum(row["status"] not in ("ok", "skipped") for row in its)
            mean = _over_environments(means, _environments(table)) if len(means) else None
            standings.append(ReferenceStanding(reference, level, len(means), failed, skipped, mean))
    return tuple(standings)


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(its) for key, its in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(its) for its in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _environments(table: pd.DataFrame) -> dict[str, str]:
    return dict(zip(table["scene"], table["environment"], strict=True))


def _over_environments(means: pd.Series, environments: Mapping[str, str]) -> Estimate:
    """The mean of case means, with its interval over the environments that their scenes are a part of."""
    of = means.index.get_level_values("scene").map(environments)
    return mean_estimate(means.to_numpy(), pd.factorize(of, sort=True)[0])
