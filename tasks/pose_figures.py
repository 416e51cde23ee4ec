"""Figures of localization and tracking: errors by completer, and places seen from above."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.leaderboard.summary import level_text

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MUTED = {"incomplete": "#9a9a9a", "ground_truth": "#1b1b1b", "resample": "#5f6b76"}
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f3c8d")
TRUE_COLOR = "#1b1b1b"
PANELS_A_ROW = 3
CASE = ["scene", "level", "incompleteness", "draw"]


def error_cdf(rows: pd.DataFrame, metric: str, label: str) -> Figure:
    """The cumulative distribution of a metric by completer, one panel a level."""
    figure, axes = _panels(len(rows.level.unique()), share=True)
    for axis, (level, at_level) in zip(axes, rows.groupby("level"), strict=True):
        for completer, values, color in _samples(at_level, metric):
            values = np.sort(values)
            share = np.arange(1, len(values) + 1) / len(values)
            axis.step(values, share, where="post", color=color, label=completer, linewidth=1.8)
        axis.set(title=missing_text(level, at_level), xlabel=label)
    # Once all is drawn: panels share their axes, and setting a limit ends their growing.
    axes[0].set(ylabel="share of the samples", xlim=(0, None), ylim=(0, 1.01))
    _legend(figure, axes)
    return figure


def error_by_step(rows: pd.DataFrame) -> Figure:
    """The mean tracking error after each step by completer, one panel a level; the band holds the middle half."""
    figure, axes = _panels(len(rows.level.unique()), share=True)
    for axis, (level, at_level) in zip(axes, rows.groupby("level"), strict=True):
        for completer, its, color in _by_completer(at_level):
            errors = np.array([row["tracking_error_m"] for row in its.samples])
            steps = np.arange(1, errors.shape[1] + 1)
            axis.plot(steps, errors.mean(axis=0), color=color, label=completer, linewidth=1.8)
            if len(errors) > 3:
                axis.fill_between(steps, *np.quantile(errors, [0.25, 0.75], axis=0), color=color, alpha=0.12, lw=0)
        axis.set(title=missing_text(level, at_level), xlabel="step")
    # Once all is drawn, as in `error_cdf`.
    axes[0].set(ylabel="tracking error (m)", xlim=(1, None), ylim=(0, None))
    _legend(figure, axes)
    return figure


def locations_from_above(rows: pd.DataFrame) -> Figure:
    """Estimated against true locations of one case, one panel a completer."""
    rows = _one_case(rows)
    found = list(_by_completer(rows))
    figure, axes = _panels(len(found), share=True)
    for axis, (completer, its, color) in zip(axes, found, strict=True):
        trace = its.trace.iloc[0]
        true, estimated = np.array(trace["true"]), np.array(trace["estimated"])
        for start, end in zip(true, estimated, strict=True):
            axis.plot([start[0], end[0]], [start[1], end[1]], color=color, linewidth=1, alpha=0.6)
        axis.scatter(true[:, 0], true[:, 1], s=42, facecolors="white", edgecolors=TRUE_COLOR, label="true", zorder=3)
        axis.scatter(estimated[:, 0], estimated[:, 1], s=36, marker="x", color=color, label="estimated", zorder=4)
        axis.scatter(
            trace["reference"][0], trace["reference"][1], s=80, marker="*", color="#e69f00", label="reference", zorder=2
        )
        _from_above(axis, completer, np.linalg.norm(estimated - true, axis=1))
    _give_room(axes[0])
    _legend(figure, axes)
    figure.suptitle(_case_title(rows))
    return figure


def paths_from_above(rows: pd.DataFrame) -> Figure:
    """The true and the estimated path of one case, one panel a completer."""
    rows = _one_case(rows)
    found = list(_by_completer(rows))
    figure, axes = _panels(len(found), share=True)
    for axis, (completer, its, color) in zip(axes, found, strict=True):
        trace = its.trace.iloc[0]
        true, estimated = np.array(trace["true"]), np.array(trace["estimated"])
        axis.plot(true[:, 0], true[:, 1], color=TRUE_COLOR, linewidth=3.5, alpha=0.25, label="true")
        axis.plot(estimated[:, 0], estimated[:, 1], ".-", color=color, linewidth=1.3, markersize=4, label="estimated")
        axis.scatter(true[0, 0], true[0, 1], s=45, facecolors="white", edgecolors=TRUE_COLOR, zorder=3, label="start")
        _from_above(axis, completer, np.linalg.norm(estimated - true, axis=1)[1:])
    _give_room(axes[0])
    _legend(figure, axes)
    figure.suptitle(_case_title(rows))
    return figure


def missing_text(level: float, rows: pd.DataFrame) -> str:
    """What is missing at the level of these rows, for titles."""
    return f"{level_text(level, rows['missing'].mean())} missing"


def _panels(count: int, share: bool) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    columns = min(count, PANELS_A_ROW)
    lines = -(-count // columns)
    figure = Figure(figsize=(3.6 * columns + 0.6, 3.3 * lines + 0.6), dpi=150, layout="constrained")
    grid = figure.subplots(lines, columns, squeeze=False, sharex=share, sharey=share).ravel()
    for axis in grid:
        axis.grid(color="#e6e6e6", linewidth=0.7)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    for place, spare in enumerate(grid[count:], count):
        spare.set_visible(False)
        # Shared axes write their numbers on the lowest panel, which is not shown here.
        grid[place - columns].tick_params(labelbottom=True)
    return figure, list(grid[:count])


def _by_completer(rows: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame, str]]:
    """Completer, its rows and its color: references in greys, methods in colors by name."""
    methods = [name for name in sorted(rows.completer.unique()) if name not in MUTED]
    colors = MUTED | {name: COLORS[place % len(COLORS)] for place, name in enumerate(methods)}
    for completer, its in rows.groupby("completer"):
        yield str(completer), its, colors[str(completer)]


def _samples(rows: pd.DataFrame, metric: str) -> Iterator[tuple[str, NDArray[np.float64], str]]:
    for completer, its, color in _by_completer(rows):
        yield completer, np.concatenate([np.asarray(row[metric], float) for row in its.samples]), color


def _one_case(rows: pd.DataFrame) -> pd.DataFrame:
    """One row a completer, all of one case: the first scene's highest level, of the cases that most completers have."""
    by_case = rows.groupby(CASE)
    completers = by_case["completer"].nunique()
    shared = completers[completers == completers.max()].index
    return by_case.get_group(min(shared, key=lambda case: (case[0], -case[1], *case[2:]))).drop_duplicates("completer")


def _case_title(rows: pd.DataFrame) -> str:
    case: Any = rows.iloc[0]
    return f"{case.scene}, {missing_text(case.level, rows)} ({case.incompleteness}), from above"


def _from_above(axis: Axes, completer: str, errors_m: NDArray[np.float64]) -> None:
    axis.set(title=f"{completer}: mean {errors_m.mean():.2f} m", xlabel="x (m)", ylabel="y (m)")
    axis.set_aspect("equal", adjustable="box")


def _give_room(axis: Axes) -> None:
    """Widen the narrower of the two ranges to most of the other: a straight path would be a strip on white."""
    (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
    side = 0.8 * max(right - left, high - low)
    for setter, start, end in ((axis.set_xlim, left, right), (axis.set_ylim, low, high)):
        margin = max(0.0, side - (end - start)) / 2
        setter(start - margin, end + margin)


def _legend(figure: Figure, axes: list[Axes]) -> None:
    """One legend below all panels, each label once."""
    entries: dict[str, Any] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(
        handles=list(entries.values()),
        labels=list(entries),
        loc="outside lower center",
        ncol=min(2 * len(axes), len(entries)),
        frameon=False,
    )
