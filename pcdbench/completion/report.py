"""The report of a completion: which regions to scan again, as JSON, as a page, and as a plan with numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pcdbench.completion.completed import Completed
from pcdbench.completion.regions import DOUBTFUL, Region, regions_to_scan
from pcdbench.errors import PcdbenchError

PIXELS = 1600
MOST_LISTED = 40
LARGEST_TICK_M = 1000.0
LABEL_INCHES = 0.3
VERSION = 1


def write_report(completed: Completed, folder: Path, source: str, completer: str) -> list[Region]:
    """Write `report.json`, `report.md` and `report.png` into a folder, and return the regions to scan again.

    Args:
        completed: what to report about.
        folder: made where it is missing.
        source: the scan's name, for the title.
        completer: the completer's name.

    Raises:
        PcdbenchError: where the folder cannot be written.
    """
    regions = regions_to_scan(completed)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        facts = _facts(completed, source, completer) | {"regions": [region.as_json() for region in regions]}
        (folder / "report.json").write_text(json.dumps(facts, indent=2) + "\n")
        (folder / "report.md").write_text(_page(completed, regions, source, completer))
        _write_plan(completed, regions, folder / "report.png", f"{source}, {completer}")
    except OSError as error:
        raise PcdbenchError(
            f"{folder}: the report cannot be written: {error.strerror}; choose another folder"
        ) from error
    return regions


def _facts(completed: Completed, source: str, completer: str) -> dict[str, object]:
    added = len(completed.spacing_m)
    trust = completed.confidence[len(completed.cloud) - added :]
    return {
        "version": VERSION,
        "source": source,
        "completer": completer,
        "observed_points": len(completed.cloud) - added,
        "added_points": added,
        "observed_m2": round(completed.surface_m2, 1),
        "added_m2": round(float((completed.spacing_m**2).sum()), 1),
        "doubtful_below": DOUBTFUL,
        "doubtful_points": int((trust < DOUBTFUL).sum()),
        "failures": list(completed.failures),
    }


def _page(completed: Completed, regions: list[Region], source: str, completer: str) -> str:
    facts = _facts(completed, source, completer)
    lines = [
        f"# What to scan again: {source}",
        "",
        f"{completer} added {facts['added_points']:,} points ({facts['added_m2']:,} m2) to "
        f"{facts['observed_points']:,} observed ones ({facts['observed_m2']:,} m2). {facts['doubtful_points']:,} of "
        f"them have a confidence below {DOUBTFUL}.",
        "",
    ]
    if regions:
        lines += [
            "![Plan from above](report.png)",
            "",
            "| | middle x, y, z (m) | size x, y, z (m) | area (m2) | share | confidence | reason |",
            "|---|---|---|---|---|---|---|",
        ]
    for region in regions[:MOST_LISTED]:
        center, size = (", ".join(f"{value:.1f}" for value in triple) for triple in (region.center_m, region.size_m))
        trust = "" if region.confidence is None else f"{region.confidence:.2f}"
        lines.append(
            f"| {region.number} | {center} | {size} | {region.area_m2:.1f} | {100 * region.share:.1f} % | {trust} | "
            f"{region.reason} |"
        )
    if len(regions) > MOST_LISTED:
        lines += ["", f"{len(regions) - MOST_LISTED} smaller ones are in report.json."]
    if not regions:
        lines.append("No region needs to be scanned again.")
    if completed.failures:
        lines += ["", "The completer failed, and nothing was added, in:", ""]
        lines += [f"- {failure}" for failure in completed.failures]
    return "\n".join(lines) + "\n"


def _write_plan(completed: Completed, regions: list[Region], path: Path, title: str) -> None:
    """The cloud from above: observed points grey, added ones by confidence, regions as numbered boxes."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    picture, low, high = _plan(completed)
    width, height = high - low
    inches = 10.0
    figure = Figure(
        figsize=(inches, float(np.clip(inches * height / width, 3.0, 16.0)) + 0.8), layout="constrained", dpi=130
    )
    axes = figure.subplots()
    # The scan's own coordinates, as in the table; only what would make map coordinates unreadable is taken off.
    start = np.where(np.abs(low) < LARGEST_TICK_M, 0.0, np.floor(low / LARGEST_TICK_M) * LARGEST_TICK_M)
    (left, bottom), (right, top) = low - start, high - start
    axes.imshow(picture, extent=(left, right, bottom, top), interpolation="antialiased", origin="lower")
    corners: list[NDArray[np.float64]] = []
    for region in regions[:MOST_LISTED]:
        corner, size = np.array(region.low_m[:2]) - start, np.maximum(np.array(region.size_m[:2]), 0.15)
        axes.add_patch(Rectangle(tuple(corner), *size, fill=False, edgecolor="black", linewidth=1.2))
        free = _free_corner(corner, size, corners, LABEL_INCHES / inches * max(width, height))
        corners.append(free)
        axes.text(
            float(free[0]),
            float(free[1]),
            str(region.number),
            fontsize=9,
            fontweight="bold",
            color="white",
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "black", "linewidth": 0},
            clip_on=False,
        )
    marked = f", the largest {MOST_LISTED} marked" if len(regions) > MOST_LISTED else ""
    axes.set_title(f"{title}: {len(regions)} region{'s' * (len(regions) != 1)} to scan again{marked}")
    for name, which in (("x", 0), ("y", 1)):
        taken_off = f" - {start[which]:,.0f}" if start[which] else ""
        axes.set(**{f"{name}label": f"{'xyz'[completed.frame.axes[which]]}{taken_off} (m)"})
    color_bar = figure.colorbar(_confidence_scale(), ax=axes, shrink=0.6)
    color_bar.set_label("confidence of added points (observed points are grey)")
    figure.savefig(path, facecolor="white")


def _free_corner(
    corner: NDArray[np.float64], size: NDArray[np.float64], taken: list[NDArray[np.float64]], apart_m: float
) -> NDArray[np.float64]:
    """(2,) that corner of a box which is farthest from other labels, or the first that is far enough."""
    options = [corner + size * share for share in ((1, 1), (0, 1), (1, 0), (0, 0))]
    if not taken:
        return options[0]
    away = [float(np.linalg.norm(np.array(taken) - option, axis=1).min()) for option in options]
    return next((option for option, gap in zip(options, away, strict=True) if gap >= apart_m), options[np.argmax(away)])


def _confidence_scale():  # type: ignore[no-untyped-def]  # matplotlib is imported when it is needed
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(0, 1), "RdYlGn")


def _plan(completed: Completed) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(H, W, 3) the picture, and (2,) the lowest and highest corner that it shows, upright, metres."""
    x, y = (completed.frame.column(completed.cloud.points, axis) for axis in (0, 1))
    low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
    margin = 0.03 * float((high - low).max()) + 0.1
    low, high = low - margin, high + margin
    scale = PIXELS / float((high - low).max())
    # A thin cloud must not look like dust.
    scale = min(scale, 0.8 / _plan_spacing(completed, high - low))
    shape = np.ceil((high - low) * scale).astype(int) + 1
    pixels = ((y - low[1]) * scale).astype(np.int64) * shape[0] + ((x - low[0]) * scale).astype(np.int64)
    count = int(shape.prod())
    observed = np.bincount(pixels[~completed.added], minlength=count)
    added = np.bincount(pixels[completed.added], minlength=count)
    trust = np.bincount(pixels[completed.added], completed.confidence[completed.added], minlength=count)
    typical = float(np.percentile(observed[observed > 0], 90)) if observed.any() else 1.0
    grey = 1.0 - 0.55 * np.clip(observed / typical, 0.0, 1.0) ** 0.5
    picture = np.repeat(grey[:, None], 3, axis=1)
    filled = added > 0.25 * observed
    filled &= added > 0
    colors = np.asarray(_confidence_scale().to_rgba(trust[filled] / added[filled]))[:, :3]
    picture[filled] = colors
    return picture.reshape(shape[1], shape[0], 3), low, high


def _plan_spacing(completed: Completed, extent: NDArray[np.float64]) -> float:
    """Metres between points on the plan, as if all lay on the floor."""
    return float((extent.prod() / max(1, len(completed.cloud))) ** 0.5)
