"""The figures of a board as SVG: error by level, cumulative distributions, quality against time."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.leaderboard.summary import level_text
from pcdbench.paths import file_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pcdbench.leaderboard.board import Board, BoardMetric, Standing
    from pcdbench.leaderboard.statistics import Estimate

# Okabe and Ito (2008), for all kinds of colour vision; dashes tell the second and third round of them apart.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_DASHES = ("-", "--", ":")
_REFERENCE_DASHES = ("-", "--", "-.", ":")
_REFERENCE_COLOR = "#8c8c8c"
_SHARES = np.linspace(0.0, 1.0, 201)
_SHOWN_QUANTILE = 0.98  # a few lost scans would flatten all others
_PANEL_INCHES = (3.3, 2.6)
_LEGEND_ROW_INCHES = 0.18
_LEGEND_COLUMN_INCHES = 1.6


@dataclass(frozen=True)
class Style:
    """How a completer is drawn."""

    color: str
    linestyle: str
    width: float


def write_figures(board: Board, folder: Path) -> dict[str, Path]:
    """Write the figures of a board; equal boards give equal files.

    Returns:
        By title, the files, in `folder`: `by_level.svg`, `distribution_<task>.svg`, `time.svg`, each with the data
        set and split before it where a board has several.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = {}
    with svg_style():
        for name, title, figure in _figures(board):
            path = folder / f"{name}.svg"
            figure.savefig(path, metadata={"Date": None, "Creator": None})
            written[title] = path
    return written


def svg_style() -> AbstractContextManager[None]:
    """Figures that are made while the `with` block lasts look alike, and equal ones give equal files."""
    from matplotlib import rc_context

    return rc_context({"svg.hashsalt": "pcdbench", "svg.fonttype": "none", "font.size": 8, "axes.titlesize": 8})


def styles_of(labels: Sequence[str], references: Collection[str]) -> dict[str, Style]:
    """A colour and dashes for each completer, in this order but references first; references are grey."""
    methods = [label for label in labels if label not in references]
    found = {
        label: Style(_REFERENCE_COLOR, _REFERENCE_DASHES[number % len(_REFERENCE_DASHES)], 1.0)
        for number, label in enumerate(label for label in labels if label in references)
    }
    for number, label in enumerate(methods):
        dashes = _DASHES[number // len(_COLORS) % len(_DASHES)]
        found[label] = Style(_COLORS[number % len(_COLORS)], dashes, 1.4)
    return found


def _figures(board: Board) -> Iterator[tuple[str, str, Figure]]:
    """File name, title and figure of each."""
    references = {its.label for its in board.completers if its.reference}
    styles = styles_of([its.label for its in board.completers], references)
    for number, data in enumerate(board.data):
        several = len(board.data) > 1
        prefix = f"{file_name(f'{data.dataset}_{data.split}')}_" if several else ""
        of = f" on {data.dataset} {data.split}" if several else ""
        main = _main_standings(board, number)
        if not main:
            continue
        yield f"{prefix}by_level", f"By level{of}", _by_level(main, styles)
        for (task, metric), samples in _samples(board, number).items():
            yield (
                f"{prefix}distribution_{task}",
                f"Distributions of {task}{of}",
                _distributions(task, metric, samples, styles),
            )
        yield f"{prefix}time", f"Quality against time{of}", _against_time(board, main, styles)


_Main = Mapping[tuple[str, str], tuple["BoardMetric", Sequence["Standing"]]]


def _main_standings(board: Board, data: int) -> _Main:
    """By (incompleteness, task), the task's main metric and its measured standings."""
    found: dict[tuple[str, str], tuple[BoardMetric, list[Standing]]] = {}
    for its in board.standings:
        metric = board.task_of[its.task].main
        if its.data == data and metric is not None and its.metric == metric.name and its.mean is not None:
            found.setdefault((its.incompleteness, its.task), (metric, []))[1].append(its)
    return found


def _samples(board: Board, data: int) -> Mapping[tuple[str, BoardMetric], Any]:
    """By (task, main metric), then (incompleteness, level), then completer: all samples."""
    found: dict[tuple[str, BoardMetric], Any] = {}
    pooled: dict[tuple[str, str, float, str], list[float]] = defaultdict(list)
    for cell in board.cells:
        case = board.cases[cell.case]
        if case.data == data:
            for task, result in cell.results.items():
                pooled[task, case.incompleteness, case.level, cell.completer].extend(result.samples)
    for (task, incompleteness, level, completer), samples in sorted(pooled.items()):
        metric = board.task_of[task].main
        if metric is not None and samples:
            panels = found.setdefault((task, metric), {})
            panels.setdefault((incompleteness, level), {})[completer] = np.asarray(samples)
    return found


def _by_level(main: _Main, styles: Mapping[str, Style]) -> Figure:
    """A panel a task and incompleteness: the metric's own statistic and its interval, by level."""
    tasks, incompletenesses = _names(main)
    figure, axes = _panels(len(incompletenesses), len(tasks), styles)
    for (incompleteness, task), (metric, standings) in main.items():
        panel = axes[incompletenesses.index(incompleteness)][tasks.index(task)]
        for completer, lines in _by_completer(standings).items():
            style = styles[completer]
            levels = [100 * (line.level or line.missing) for line in lines]
            estimates = [getattr(line, metric.summary) for line in lines]
            values = [one.value for one in estimates]
            panel.errorbar(
                levels, values, _margins(estimates), label=completer, color=style.color, ls=style.linestyle,
                lw=style.width, marker="o", ms=3, capsize=2, elinewidth=0.7,
            )  # fmt: skip
        panel.set(
            title=f"{task} · {incompleteness}\n({metric.direction} is better)",
            xlabel="missing (%)",
            ylabel=_axis_label(metric),
        )
    return _with_legend(figure, axes, styles)


def _distributions(task: str, metric: BoardMetric, panels: Any, styles: Mapping[str, Style]) -> Figure:
    """A panel an incompleteness and level: the share of samples that are at most as large, by completer."""
    incompletenesses = list(dict.fromkeys(incompleteness for incompleteness, _ in panels))
    columns = {name: [level for its, level in panels if its == name] for name in incompletenesses}
    figure, axes = _panels(len(incompletenesses), max(len(levels) for levels in columns.values()), styles)
    for (incompleteness, level), by_completer in panels.items():
        panel = axes[incompletenesses.index(incompleteness)][columns[incompleteness].index(level)]
        draw_distributions(panel, by_completer, styles, metric.direction)
        title = f"{task} · {incompleteness}, {level_text(level)} missing\n({metric.direction} is better)"
        panel.set(title=title, xlabel=_axis_label(metric), ylim=(0, 1))
        panel.set_ylabel("share of samples")
    return _with_legend(figure, axes, styles)


def draw_distributions(
    panel: Axes, samples: Mapping[str, NDArray[np.float64]], styles: Mapping[str, Style], direction: str
) -> None:
    """Draw, for each completer, the share of its samples that are at most as large as a value."""
    for completer in (name for name in styles if name in samples):
        style = styles[completer]
        values = np.quantile(samples[completer], _SHARES, method="inverted_cdf")
        panel.plot(
            values, _SHARES, label=completer, color=style.color, ls=style.linestyle, lw=style.width,
            drawstyle="steps-post",
        )  # fmt: skip
    ends = [np.quantile(its, _SHOWN_QUANTILE) for its in samples.values()]
    if direction == "lower" and max(ends, default=0) > 0:
        panel.set_xlim(0, 1.05 * max(ends))


def _against_time(board: Board, main: _Main, styles: Mapping[str, Style]) -> Figure:
    """A panel a task and incompleteness, at its middle level: the metric by the seconds of completing."""
    from matplotlib.ticker import LogLocator, NullFormatter

    tasks, incompletenesses = _names(main)
    figure, axes = _panels(len(incompletenesses), len(tasks), styles)
    for (incompleteness, task), (metric, standings) in main.items():
        panel = axes[incompletenesses.index(incompleteness)][tasks.index(task)]
        levels = sorted({its.level for its in standings})
        level = levels[len(levels) // 2]
        for its in (its for its in standings if its.level == level):
            style = styles[its.completer]
            estimate = getattr(its, metric.summary)
            if board.completer_of[its.completer].reference:
                panel.axhline(
                    estimate.value, label=its.completer, color=style.color, ls=style.linestyle, lw=style.width
                )
            elif its.seconds > 0:
                face = style.color if style.linestyle == "-" else "white"
                panel.errorbar(
                    [its.seconds], [estimate.value], _margins([estimate]), label=its.completer, color=style.color,
                    marker="o", ms=5, capsize=2, ls="none", elinewidth=0.8, mfc=face,
                )  # fmt: skip
        panel.set_xscale("log")
        low, high = panel.get_xlim()
        middle = math.sqrt(low * high)
        panel.set_xlim(min(low, middle / 4), max(high, middle * 4))
        panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=6))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
        missing = next((its.missing for its in standings if its.level == level), float("nan"))
        title = f"{task} · {incompleteness}, {level_text(level, missing)} missing\n({metric.direction} is better)"
        panel.set(title=title, xlabel="seconds of completing a case (median)", ylabel=_axis_label(metric))
    return _with_legend(figure, axes, styles)


def _margins(estimates: Sequence[Estimate]) -> NDArray[np.float64]:
    """(2, n) how far intervals reach below and above their values; 0 where there is none."""
    margins = [[its.value - its.low for its in estimates], [its.high - its.value for its in estimates]]
    return np.maximum(np.nan_to_num(margins), 0)


def _names(main: _Main) -> tuple[list[str], list[str]]:
    return sorted({task for _, task in main}), sorted({incompleteness for incompleteness, _ in main})


def _by_completer(standings: Sequence[Standing]) -> Mapping[str, Sequence[Standing]]:
    found: dict[str, list[Standing]] = defaultdict(list)
    for its in standings:
        found[its.completer].append(its)
    return found


def _axis_label(metric: BoardMetric) -> str:
    return f"{metric.name} ({metric.unit.split(',')[0]})"


def _panels(rows: int, columns: int, styles: Mapping[str, Style]) -> tuple[Figure, list[list[Axes]]]:
    """A figure with room for a legend of all completers below its panels."""
    from matplotlib.figure import Figure

    legend = 0.2 + _LEGEND_ROW_INCHES * math.ceil(len(styles) / _legend_columns(columns))
    width, height = _PANEL_INCHES[0] * columns, _PANEL_INCHES[1] * rows + legend
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left=0.6 / width,
        right=1 - 0.12 / width,
        bottom=(0.42 + legend) / height,
        top=1 - 0.42 / height,
        wspace=0.3,
        hspace=0.5,
    )
    return figure, [list(row) for row in figure.subplots(rows, columns, squeeze=False)]


def _legend_columns(columns: int) -> int:
    return max(2, round(columns * _PANEL_INCHES[0] / _LEGEND_COLUMN_INCHES))


def _with_legend(figure: Figure, axes: Sequence[Sequence[Axes]], styles: Mapping[str, Style]) -> Figure:
    """The figure with one legend for all panels, and without those that stayed empty."""
    handles: dict[str, Any] = {}
    for panel in (panel for row in axes for panel in row):
        if not panel.has_data():
            panel.remove()
            continue
        panel.grid(alpha=0.25, lw=0.5)
        panel.ticklabel_format(axis="y", scilimits=(-2, 4))
        if panel.get_xscale() == "linear":
            panel.ticklabel_format(axis="x", scilimits=(-2, 4))
        panel.spines[["top", "right"]].set_visible(False)
        found, labels = panel.get_legend_handles_labels()
        handles |= dict(zip(labels, found, strict=True))
    shown = [label for label in styles if label in handles]
    columns = min(len(shown), _legend_columns(len(axes[0])))
    figure.legend([handles[label] for label in shown], shown, loc="lower center", ncols=columns, frameon=False)
    return figure
