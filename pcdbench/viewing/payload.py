"""Clouds as the viewer's script takes them: positions in 16 bits, everything else in 8, in base64."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.geometry.neighbors import median_spacing
from pcdbench.viewing.shown import SAME_POINT_M, Shown, ceiling_cut_m, cell_numbers

MODES = {
    "color": "Colour",
    "added": "Added",
    "confidence": "Confidence",
    "height": "Height",
    "distance": "Distance",
}
COLORMAPS = {"confidence": "RdYlGn", "height": "viridis", "distance": "plasma"}
_STEPS = 65535
_SMALLEST_SPAN_M = 1e-3
_CELLS = 80
_DARKEST = 0.15
_FRAMED_QUANTILES = (0.002, 0.998)


def payload(shown: Sequence[Shown]) -> dict[str, Any]:
    """What the script draws, JSON values alone.

    One frame for all clouds: its corner is their lowest one, its unit the 65,535th part of their longest side
    (0.15 mm for 10 m). Keys: `span_m`, that longest side; `low` and `high`, the corners of what the camera
    shows at first, `cut_m`, where the ceiling is taken off (null where there is none) and `top_m`, all metres
    above the frame's corner; `spacing_m`, how wide points are drawn at first; `modes`, `mode`, those to choose from
    and the first one; `distance_max_m`, what the last colour stands for; `maps`, 256 colours each; `clouds`,
    each with `xyz` (uint16, little endian), `rgb`, `added` (bits, lowest first), `confidence` and `distance` (or null).
    """
    points = np.concatenate([its.cloud.points for its in shown])
    corner = points.min(axis=0)
    span = _span_m(points)
    low, high = np.quantile(points - corner, _FRAMED_QUANTILES, axis=0)
    cut = ceiling_cut_m(points)
    modes = _modes(shown)
    distance_max = _distance_max_m(shown) if "distance" in modes else None
    return {
        "span_m": span,
        "low": low.tolist(),
        "high": high.tolist(),
        "cut_m": None if cut is None else cut - float(corner[2]),
        "top_m": float(points[:, 2].max() - corner[2]),
        "spacing_m": float(np.median([_spacing_m(its.cloud.points, span) for its in shown])),
        "modes": modes,
        "mode": modes[0],
        "distance_max_m": distance_max,
        "maps": {mode: base64_text(_map(COLORMAPS[mode])) for mode in modes if mode in COLORMAPS},
        "clouds": [_packed(its, corner, span, distance_max) for its in shown],
    }


def too_coarse(shown: Sequence[Shown]) -> str | None:
    """One line where the payload's steps are coarser than a tenth of a cloud's spacing, and None where they are not."""
    step = _span_m(np.concatenate([its.cloud.points for its in shown])) / _STEPS
    blurred = [its.name for its in shown if len(its.cloud) > 1 and step > median_spacing(its.cloud.points) / 10]
    if not blurred:
        return None
    cure = "view them one by one, or bring them into one frame" if len(shown) > 1 else "view a part of it"
    return (
        f"{', '.join(its.name for its in shown)}: {step * _STEPS:,.0f} m across, so that the page shows points in "
        f"steps of {step:.2g} m, too coarse for {', '.join(blurred)}; {cure}"
    )


def _span_m(points: NDArray[np.float64]) -> float:
    return max(float(np.ptp(points, axis=0).max()), _SMALLEST_SPAN_M)


def _packed(its: Shown, corner: NDArray[np.float64], span: float, distance_max: float | None) -> dict[str, Any]:
    steps = np.rint((its.cloud.points - corner) / span * _STEPS).astype("<u2")
    distance = None
    if its.distance_m is not None and distance_max is not None:
        distance = np.rint(np.minimum(its.distance_m / distance_max, 1.0) * 255).astype(np.uint8)
    colors = its.cloud.colors
    return {
        "xyz": base64_text(steps),
        "rgb": None if colors is None else base64_text(np.rint(colors * 255).astype(np.uint8)),
        "added": None if its.added is None else base64_text(np.packbits(its.added, bitorder="little")),
        "confidence": None if its.confidence is None else base64_text(np.rint(its.confidence * 255).astype(np.uint8)),
        "distance": None if distance is None else base64_text(distance),
    }


def _spacing_m(points: NDArray[np.float64], span: float) -> float:
    """How wide a point must be for surfaces to look closed: the root of the area about each point.

    The distance to the nearest point is half of it where points lie at random, and less where a thin wall is
    beside a dense desk. The area is that of the cells of a coarse grid which hold points.
    """
    cell = span / _CELLS
    occupied = len(np.unique(cell_numbers(points, cell)))
    return max(cell * math.sqrt(occupied / len(points)), median_spacing(points))


def _modes(shown: Sequence[Shown]) -> list[str]:
    """What the clouds can be coloured by; the first is what is shown at first."""
    possible = {
        "color": any(its.cloud.colors is not None for its in shown),
        "added": any(its.added is not None for its in shown),
        "confidence": any(its.confidence is not None for its in shown),
        "height": True,
        "distance": any(its.distance_m is not None for its in shown),
    }
    return [mode for mode in MODES if possible[mode]]


def _distance_max_m(shown: Sequence[Shown]) -> float:
    """A round length that 95 % of the points that are apart from the reference do not exceed."""
    distances = np.concatenate([its.distance_m for its in shown if its.distance_m is not None])
    apart = distances[distances > SAME_POINT_M]
    if not len(apart):
        return 0.01
    wanted = max(float(np.quantile(apart, 0.95)), 0.001)
    decade = 10.0 ** math.floor(math.log10(wanted))
    return next(step * decade for step in (1, 2, 5, 10) if step * decade >= wanted * 0.999)


def _map(name: str) -> NDArray[np.uint8]:
    """(256, 3) the colours of one of matplotlib's maps, without its darkest: they would not stand out at night."""
    from matplotlib import colormaps

    return np.rint(np.asarray(colormaps[name](np.linspace(_DARKEST, 1, 256)))[:, :3] * 255).astype(np.uint8)


def base64_text(array: NDArray[Any]) -> str:
    """The bytes of an array, row by row."""
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
