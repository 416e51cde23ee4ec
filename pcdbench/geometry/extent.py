"""Whether coordinates can be those of an indoor scan in metres: how long it is, and whether it has a surface at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SMALLEST_M, LARGEST_M = 0.5, 500.0
# A cloud this much thinner than long, or this thin (standard deviations), is a line: it has no surface to complete.
# Files round to 0.1 or 1 mm, so that lines are seldom exact.
_THINNEST, _THINNEST_M = 1e-5, 5e-4
# Squares of more would be too large for a float.
_LARGEST_SQUARED = 1e100
_FEW = 0.01
_FAR_SPREADS = 10.0
_LONGEST_WRITTEN = 1e9


def lies_on_a_line(points: NDArray[np.float64]) -> bool:
    """Whether (N, 3) points, N at least 2, lie on one line, to half a millimetre or a 100,000th of its length."""
    offsets = points - points[0]
    unit_m = max(1.0, float(offsets.max()) / _LARGEST_SQUARED, -float(offsets.min()) / _LARGEST_SQUARED)
    _, middle, largest = np.linalg.eigvalsh(np.cov(offsets / unit_m, rowvar=False))
    return bool(middle <= max(_THINNEST**2 * largest, (_THINNEST_M / unit_m) ** 2))


def no_surface(points: NDArray[np.float64]) -> str | None:
    """What to say of (N, 3) points, N at least 2, that lie on one line, or seem to beside a few strays; None of others.

    A point so far away that all others are one place beside it is what is wrong with such a cloud.
    """
    if not lies_on_a_line(points):
        return None
    far = strays(points)
    if len(far) and not lies_on_a_line(np.delete(points, far, axis=0)):
        return where_strays_lie(points, far)
    if parts := two_parts(points):
        return parts
    return f"its {len(points):,} points lie on one line; there is no surface to complete"


def odd_scale(longest_m: float) -> str | None:
    """What to say of a scan whose longest side is odd indoors, were it metres; None of others."""
    if SMALLEST_M <= longest_m <= LARGEST_M:
        return None
    cure = "millimetres or centimetres? Multiply its coordinates by 0.001 or 0.01"
    if longest_m < SMALLEST_M:
        cure = "kilometres or normalised? Multiply its coordinates by what makes them metres"
    length = f"{longest_m:,.0f}" if longest_m >= 1000 else f"{longest_m:.4g}"
    return f"longest side is {length} m, odd for an indoor scan; is its unit {cure} and save it again"


def strays(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Rows of the few (N, 3) points, one in a hundred at most, that lie far from all others; none if more do.

    Far is ten times as far from the middle half of the points, along an axis, as that is wide along any.
    """
    low, high = np.quantile(points, [0.25, 0.75], axis=0)
    reach = _FAR_SPREADS * max(float((high - low).max()), SMALLEST_M)
    far = np.flatnonzero(((points < low - reach) | (points > high + reach)).any(axis=1))
    return far if len(far) <= _FEW * len(points) else far[:0]


def two_parts(points: NDArray[np.float64]) -> str | None:
    """What to say of (N, 3) points, N at least 2, in two parts farther apart than any building is long; None of others.

    So lie stations that were never brought into one frame, and points without a return, which many programs put at 0.
    """
    axis = int(np.ptp(points, axis=0).argmax())
    ascending = np.sort(points[:, axis])
    gaps = np.diff(ascending)
    at = int(gaps.argmax())
    if gaps[at] <= LARGEST_M:
        return None
    low = points[:, axis] <= ascending[at]
    parts = points[low], points[~low]
    if gaps[at] <= _FAR_SPREADS * max(float(np.ptp(part, axis=0).max()) for part in parts):
        return None
    if all(len(part) < 2 or lies_on_a_line(part) for part in parts):
        return None
    nowhere = (points == 0).all(axis=1)
    if np.array_equal(nowhere, low) or np.array_equal(nowhere, ~low):
        lie = "points lie" if nowhere.sum() > 1 else "points lies"
        return f"{nowhere.sum():,} of its {lie} at (0, 0, 0), {gaps[at]:,.0f} m from all others; delete them"
    return (
        f"its points lie in two parts, {low.sum():,} and {(~low).sum():,} points, {gaps[at]:,.0f} m apart; bring them "
        "into one frame, or complete each by itself"
    )


def where_strays_lie(points: NDArray[np.float64], far: NDArray[np.int64]) -> str:
    """What to say of the strays, at least one row, among (N, 3) points."""
    where = ", ".join(f"{value:,.1f}" if abs(value) < _LONGEST_WRITTEN else f"{value:g}" for value in points[far[0]])
    if len(far) == 1:
        return f"1 point lies far from all others, at ({where}); delete it from the scan"
    return f"{len(far):,} points lie far from all others, the first at ({where}); delete them from the scan"
