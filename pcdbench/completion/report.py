"""The report of a completion: which regions to scan again, as JSON, as a page, and as a plan with numbers."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.completion.completed import Completed
from pcdbench.completion.regions import DOUBTFUL, SMALLEST_M2, Region, regions_to_scan
from pcdbench.completion.tiles import too_thin, typical_spacing
from pcdbench.errors import PcdbenchError
from pcdbench.paths import require_writable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_LISTED = 40
LARGEST_TICK_M = 1000.0
LONGEST_INCHES = 9.0
BADGE_INCHES = 0.3
DPI = 150
MOST_CELLS = 900
# With fewer in half of the cells, cells without a point are a pattern of their own.
POINTS_A_CELL = 3
# Colours that those who confuse red and green tell apart (Okabe and Ito); gaps are hatched, too.
TRUSTED, GUESSED, UNFILLED = "#8CCFB7", "#E0670B", "#0B5FA5"
HATCH = "////"
VERSION = 2
_CORE_QUANTILES = (0.001, 0.999)
_MARGIN = 0.02
_NARROWEST = 0.3
_VISIBLE_SHARE = 0.1


def write_report(completed: Completed, folder: Path, source: str, completer: str) -> list[Region]:
    """Write `report.json`, `report.md` and `report.png` into a folder, and return the regions to scan again.

    Args:
        completed: what to report about.
        folder: made where it is missing.
        source: the scan's name, for the title.
        completer: the completer's name.

    Raises:
        PcdbenchError: where the folder cannot be written, or holds such files that are no report.
    """
    require_report_folder(folder)
    regions = regions_to_scan(completed)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        facts = _facts(completed, source, completer) | {"regions": [region.as_json() for region in regions]}
        (folder / "report.json").write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
        (folder / "report.md").write_text(
            _page(completed, regions, source, completer), encoding="utf-8", errors="replace"
        )
        _write_plan(completed, regions, folder / "report.png", f"{source}, {completer}")
    except OSError as error:
        raise PcdbenchError(
            f"{folder}: the report cannot be written: {error.strerror}; choose another folder"
        ) from error
    return regions


def require_report_folder(folder: Path) -> None:
    """Refuse a folder that a report cannot be written into, or whose files it would overwrite were no report.

    Raises:
        PcdbenchError: for such a folder.
    """
    require_writable(folder)
    taken = [name for name in ("report.json", "report.md", "report.png") if (folder / name).exists()]
    if not taken:
        return
    try:
        facts = json.loads((folder / "report.json").read_text())
        ours = isinstance(facts, dict) and {"version", "completer", "regions"} <= facts.keys()
    except (OSError, ValueError, RecursionError):
        ours = False
    if not ours:
        raise PcdbenchError(f"{folder} holds a {taken[-1]} that is no report of pcdbench; give --report another folder")


def _facts(completed: Completed, source: str, completer: str) -> dict[str, object]:
    added = len(completed.spacing_m)
    trust = completed.confidence[len(completed.cloud) - added :]
    return {
        "version": VERSION,
        "source": source,
        "completer": completer,
        "frame": "the scan's own x, y and z, metres",
        "up": completed.frame.up,
        "observed_points": len(completed.cloud) - added,
        "added_points": added,
        "observed_m2": round(completed.surface_m2, 1),
        "added_m2": round(float((completed.spacing_m**2).sum()), 1),
        "doubtful_below": DOUBTFUL,
        "doubtful_points": int((trust < DOUBTFUL).sum()),
        "failures": list(completed.failures),
        "too_thin": too_thin(completed.cloud.points[: len(completed.cloud) - added]),
    }


def _page(completed: Completed, regions: list[Region], source: str, completer: str) -> str:
    facts = _facts(completed, source, completer)
    lines = [
        f"# What to scan again: {source}",
        "",
        f"{completer} added {facts['added_points']:,} points ({facts['added_m2']:,} m2) to "
        f"{facts['observed_points']:,} observed ones ({facts['observed_m2']:,} m2). Of the added points "
        f"{facts['doubtful_points']:,} have a confidence below {DOUBTFUL}.",
        "",
    ]
    if regions:
        lines += [
            f"Places are in the scan's own frame ({completed.frame.up} is up), metres; places under {SMALLEST_M2} m2 "
            "are left out, and large ones told in pieces.",
            "",
            "![Plan from above](report.png)",
            "",
            "| | middle x, y, z (m) | size x, y, z (m) | area (m2) | share of all surface | confidence | reason |",
            "|---|---|---|---|---|---|---|",
        ]
    for region in regions[:MOST_LISTED]:
        # Zero has no sign.
        center, size = (
            ", ".join(f"{round(value, 1) + 0.0:.1f}" for value in triple) for triple in (region.center_m, region.size_m)
        )
        trust = "" if region.confidence is None else f"{region.confidence:.2f}"
        lines.append(
            f"| {region.number} | {center} | {size} | {region.area_m2:.1f} | {100 * region.share:.1f} % | {trust} | "
            f"{region.reason} |"
        )
    if len(regions) > MOST_LISTED:
        lines += ["", f"{len(regions) - MOST_LISTED} smaller ones are in report.json."]
    if facts["too_thin"]:
        lines += [*([""] if regions else []), f"What to scan again cannot be told of {source}: {facts['too_thin']}"]
    elif not regions and not completed.failures:
        lines.append(f"No place of {SMALLEST_M2} m2 or more needs to be scanned again.")
    if completed.failures:
        lines += ["", "The completer failed, and nothing was added, in:", ""]
        lines += [f"- {failure}" for failure in completed.failures]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Plan:
    """The cloud from above, upright: cells of (H, W) grids, lowest y first.

    Attributes:
        low, high: (2,) corners, metres, upright.
        cell_m: edge of a cell.
        grey: how light each cell is, 1 where nothing was observed.
        trusted, doubtful, gaps: where points were added, those below the confidence that counts, and the open gaps
            that are regions.
        marks: (R, 2) of each region, a place in it near its middle, metres, upright.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    cell_m: float
    grey: NDArray[np.float64]
    trusted: NDArray[np.bool_]
    doubtful: NDArray[np.bool_]
    gaps: NDArray[np.bool_]
    marks: NDArray[np.float64]


def _plan(completed: Completed, regions: list[Region]) -> _Plan:
    from scipy.ndimage import binary_closing, gaussian_filter

    unsure = completed.confidence < DOUBTFUL
    cloud = completed.frame.upright(completed.cloud.points)[:, :2]
    places = {True: completed.gaps, False: completed.cloud.points[unsure]}
    members = [completed.frame.upright(_within(places[region.confidence is None], region))[:, :2] for region in regions]
    marks = [its[np.linalg.norm(its - (its.min(axis=0) + its.max(axis=0)) / 2, axis=1).argmin()] for its in members]
    open_ones = [its for its, region in zip(members, regions, strict=True) if region.confidence is None]
    gaps = np.concatenate([np.empty((0, 2)), *open_ones])
    # What lies far from nearly all others would make a dot of them.
    core = np.quantile(cloud, _CORE_QUANTILES, axis=0)
    reach = float(np.ptp(core, axis=0).max())
    near = ((cloud >= core[0] - reach) & (cloud <= core[1] + reach)).all(axis=1)
    shown = np.concatenate([cloud[near], gaps])
    margin = _MARGIN * float(np.ptp(shown, axis=0).max())
    low, high = shown.min(axis=0) - margin, shown.max(axis=0) + margin
    seen = cloud[near & ~completed.added] - low
    cell_m = max(float((high - low).max()) / MOST_CELLS, typical_spacing(completed.cloud.points[~completed.added]))
    while np.median(np.unique(_cells(seen, cell_m), return_counts=True)[1]) < POINTS_A_CELL:
        cell_m *= 1.2
    shape = np.ceil((high - low) / cell_m).astype(int) + 1
    high = low + shape * cell_m

    def counts(places: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y = ((places - low) / cell_m).astype(np.int64).T
        return np.bincount(y * shape[0] + x, minlength=int(shape.prod())).reshape(shape[::-1]).astype(np.float64)

    def closed(cells: NDArray[np.bool_], apart_m: float = 0.0) -> NDArray[np.bool_]:
        """Cells that were left out among others, too: by chance, or because places are so far apart."""
        reach = 1 + int(np.ceil(apart_m / cell_m))
        return np.asarray(cells | binary_closing(cells, np.ones((2 * reach + 1,) * 2)), np.bool_)

    observed = counts(cloud[near & ~completed.added])
    density = gaussian_filter(observed, 0.5)
    typical = float(np.percentile(density[observed > 0], 95)) if observed.any() else 1.0
    grey = np.where(closed(observed > 0), 0.88 - 0.5 * np.clip(density / typical, 0.0, 1.0) ** 0.7, 1.0)
    trusted, doubtful = (counts(cloud[near & completed.added & which]) for which in (~unsure, unsure))
    return _Plan(
        low=low,
        high=high,
        cell_m=cell_m,
        grey=grey,
        trusted=closed((trusted > 0) & (trusted > _VISIBLE_SHARE * observed)),
        doubtful=closed((doubtful > 0) & (doubtful > _VISIBLE_SHARE * observed)),
        gaps=closed(counts(gaps) > 0, float(completed.gaps_m2.max(initial=0.0)) ** 0.5),
        marks=np.array(marks).reshape(-1, 2),
    )


def _cells(places: NDArray[np.float64], edge_m: float) -> NDArray[np.int64]:
    """(N,) a number for the cell of each of (N, 2) places, which are not negative."""
    cells = (places / edge_m).astype(np.int64)
    return (cells[:, 1] << 32) | cells[:, 0]


def _within(places: NDArray[np.float64], region: Region) -> NDArray[np.float64]:
    """Those of (N, 3) places that lie in a region's box; its corners are rounded to centimetres."""
    inside = (places >= np.array(region.low_m) - 0.01) & (places <= np.array(region.high_m) + 0.01)
    return places[inside.all(axis=1)]


def _as_text(title: str) -> str:
    """A title that matplotlib shows as it is: dollars are no formulas, and what is no UTF-8 is shown as such."""
    return title.encode(errors="replace").decode().replace("$", r"\$")


def _write_plan(completed: Completed, regions: list[Region], path: Path, title: str) -> None:
    """The cloud from above: observed points grey, added ones and open gaps in colours, regions numbered."""
    from matplotlib import rc_context
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    plan = _plan(completed, regions)
    # The scan's own coordinates, as in the table; only what would make map coordinates unreadable is taken off.
    start = np.where(np.abs(plan.low) < LARGEST_TICK_M, 0.0, np.floor(plan.low / LARGEST_TICK_M) * LARGEST_TICK_M)
    low, high = plan.low - start, plan.high - start
    # A corridor gets room beside it.
    beside = np.maximum(0.0, _NARROWEST * (high - low).max() - (high - low)) / 2
    low, high = low - beside, high + beside
    inches_a_m = LONGEST_INCHES / float((high - low).max())
    figure = Figure(figsize=tuple((high - low) * inches_a_m), dpi=DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    picture = np.repeat(plan.grey[:, :, None], 3, axis=2)
    for cells, color in ((plan.trusted, TRUSTED), (plan.doubtful, GUESSED)):
        picture[cells] = to_rgb(color)
    (left, bottom), (right, top) = plan.low - start, plan.high - start
    axes.imshow(picture, extent=(left, right, bottom, top), interpolation="nearest", origin="lower")
    with rc_context({"hatch.linewidth": 1.2}):
        if plan.gaps.any():
            x, y = (
                np.linspace(a, b, n, endpoint=False) + plan.cell_m / 2
                for a, b, n in ((left, right, plan.gaps.shape[1]), (bottom, top, plan.gaps.shape[0]))
            )
            filled = axes.contourf(x, y, plan.gaps, levels=[0.5, 1.5], hatches=[HATCH], colors="none")
            filled.set(edgecolor=UNFILLED, linewidth=1.2)
        _number(axes, regions[:MOST_LISTED], plan.marks[:MOST_LISTED] - start, BADGE_INCHES / inches_a_m)
        handles = [
            Patch(facecolor="0.6", label="observed"),
            Patch(facecolor=TRUSTED, label=f"added, confidence {DOUBTFUL} and more"),
            Patch(facecolor=GUESSED, label=f"added, confidence below {DOUBTFUL}"),
            Patch(facecolor="none", edgecolor=UNFILLED, hatch=HATCH, label="open gap"),
        ]
        axes.legend(
            handles=handles,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.5 / figure.get_figheight()),
            ncols=2,
            frameon=False,
        )
        more = f", the largest {MOST_LISTED} marked" if len(regions) > MOST_LISTED else ""
        axes.set_title(f"{_as_text(title)}: {len(regions)} region{'s' * (len(regions) != 1)} to scan again{more}")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        for name, which in (("x", 0), ("y", 1)):
            taken_off = f" - {start[which]:,.0f}" if start[which] else ""
            axes.set(**{f"{name}label": f"the scan's {'xyz'[completed.frame.axes[which]]}{taken_off} (m)"})
        figure.savefig(path, facecolor="white", bbox_inches="tight", pad_inches=0.1)


def _number(axes: Axes, regions: list[Region], marks: NDArray[np.float64], badge_m: float) -> None:
    """Put a region's number on its mark, (2,) metres, or beside it with a line to it where another number is."""
    for region, mark, (x, y) in zip(regions, marks, _free_places(marks, badge_m), strict=True):
        color = UNFILLED if region.confidence is None else GUESSED
        axes.plot([mark[0], x], [mark[1], y], color=color, linewidth=1.4)
        box = {"boxstyle": "circle,pad=0.22", "facecolor": color, "edgecolor": "white"}
        style: dict[str, Any] = {"fontsize": 9, "fontweight": "bold", "color": "white", "bbox": box}
        axes.text(x, y, str(region.number), ha="center", va="center", **style)


def _free_places(wanted: NDArray[np.float64], apart_m: float) -> NDArray[np.float64]:
    """(R, 2) places for labels, each as near to the wanted one as those before it leave room, `apart_m` apart."""
    turns = np.arange(240)
    # A spiral of even density.
    spiral = 0.35 * np.sqrt(turns)[:, None] * np.stack([np.cos(2.4 * turns), np.sin(2.4 * turns)], axis=1)
    placed = np.empty((0, 2))
    for place in wanted:
        options = place + apart_m * spiral
        room = np.linalg.norm(options[:, None] - placed, axis=2).min(axis=1, initial=np.inf)
        placed = np.vstack([placed, options[np.argmax(room >= apart_m)]])
    return placed
