"""The figures of a publication as SVG: ours, with the published values as marks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pcdbench.leaderboard.board_figures import draw_distributions, styles_of, svg_style
from pcdbench.leaderboard.summary import level_text
from pcdbench.paper.numbers import Numbers
from pcdbench.paper.publication import Bars, Distribution, Drawn, ShownCurve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANEL_INCHES = (3.4, 2.7)
_LEGEND_ROW_INCHES = 0.2
_MOST_COLUMNS = 5
_OURS, _PUBLISHED = "#0072B2", "#8c8c8c"


def write_figure(drawn: Drawn, numbers: Numbers, path: Path) -> bool:
    """Write a figure; False where nothing of it was measured. Equal numbers give equal files."""
    with svg_style():
        figure = _figure(drawn, numbers)
        if figure is None:
            return False
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={"Date": None, "Creator": None})
    return True


def _figure(drawn: Drawn, numbers: Numbers) -> Figure | None:
    if isinstance(drawn, Distribution):
        return _distributions(drawn, numbers)
    return _curve(drawn, numbers) if isinstance(drawn, ShownCurve) else _bars(drawn, numbers)


def _panels(count: int) -> tuple[Figure, Sequence[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_PANEL_INCHES[0] * count, _PANEL_INCHES[1] + 0.4), layout="constrained")
    panels = list(figure.subplots(1, count, squeeze=False)[0])
    for panel in panels:
        panel.grid(alpha=0.25, lw=0.5)
        panel.spines[["top", "right"]].set_visible(False)
    return figure, panels


def _with_legend(figure: Figure, panel: Axes) -> Figure:
    """The figure with a legend below, in as many columns as it is wide."""
    handles, labels = panel.get_legend_handles_labels()
    if len(labels) < 2:
        return figure
    for columns in range(min(len(labels), _MOST_COLUMNS), 0, -1):
        legend = figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)
        figure.draw_without_rendering()
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            break
        legend.remove()
    rows = -(-len(labels) // columns)
    figure.set_figheight(figure.get_figheight() + (rows - 1) * _LEGEND_ROW_INCHES)
    return figure


def _distributions(drawn: Distribution, numbers: Numbers) -> Figure | None:
    of_level = {level: numbers.samples(drawn.run, drawn.task, level) for level in drawn.levels}
    if not any(of_level.values()):
        return None
    figure, panels = _panels(len(drawn.levels))
    metric, unit, direction = numbers.metric(drawn.run, drawn.task)
    for panel, (level, samples) in zip(panels, of_level.items(), strict=True):
        shown = {name: its for name, its in samples.items() if not drawn.completers or name in drawn.completers}
        draw_distributions(panel, shown, styles_of(list(shown), numbers.references(drawn.run)), direction)
        panel.set(title=f"{level_text(level)} missing", xlabel=f"{metric} ({unit.split(',')[0]})", ylim=(0, 1))
        panel.ticklabel_format(axis="x", scilimits=(-2, 4))
    panels[0].set_ylabel("share of samples")
    return _with_legend(figure, panels[0])


def _curve(drawn: ShownCurve, numbers: Numbers) -> Figure | None:
    found = [
        (point.at, numbers.estimate(point.run, drawn.completer, drawn.level, drawn.column)) for point in drawn.points
    ]
    ours = [(at, its) for at, its in found if its is not None]
    if not ours:
        return None
    figure, (panel,) = _panels(1)
    values = np.array([its.value for _, its in ours])
    margins = np.array([[its.value - its.low, its.high - its.value] for _, its in ours]).T
    panel.errorbar(
        [at for at, _ in ours], values, np.maximum(np.nan_to_num(margins), 0), label="ours", color=_OURS,
        marker="o", ms=4, capsize=2, lw=1.4,
    )  # fmt: skip
    published = [(point.at, point.published) for point in drawn.points if not np.isnan(point.published)]
    if published:
        panel.plot(*zip(*published, strict=True), label="published", color=_PUBLISHED, ls="none", marker="D", ms=4)
    panel.set(xlabel=drawn.label, ylabel=drawn.column.heading, ylim=(0, None))
    panel.set_xticks([point.at for point in drawn.points])
    return _with_legend(figure, panel)


def _bars(drawn: Bars, numbers: Numbers) -> Figure | None:
    figure, (panel,) = _panels(1)
    width = 0.8 / len(drawn.completers)
    styles, measured = styles_of(drawn.completers, numbers.references(drawn.run)), False
    for number, completer in enumerate(drawn.completers):
        for position, level in enumerate(drawn.levels):
            at = position + (number - (len(drawn.completers) - 1) / 2) * width
            its = numbers.estimate(drawn.run, completer, level, drawn.column)
            if its is not None:
                measured = True
                margin = np.maximum(np.nan_to_num([[its.value - its.low], [its.high - its.value]]), 0)
                label = completer if position == 0 else None
                panel.bar(
                    at, its.value, width * 0.9, yerr=margin, color=styles[completer].color, label=label, capsize=2
                )
            for bar in drawn.published:
                if (bar.completer, bar.level) == (completer, level):
                    first = not any(text == "published" for text in panel.get_legend_handles_labels()[1])
                    label = "published" if first else None
                    panel.plot(at, bar.value, ls="none", marker="D", ms=5, mfc="white", color="black", label=label)
    panel.set_xticks(range(len(drawn.levels)), [f"{level_text(level)} missing" for level in drawn.levels])
    panel.set_ylabel(drawn.column.heading)
    return _with_legend(figure, panel) if measured else None
