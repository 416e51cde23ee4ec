"""Triangulation of simple polygons with holes, by clipping ears; for outlines of some dozens of corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Corner = tuple[float, float]


def signed_area(ring: Floats) -> float:
    """The area of a ring (K, 2), positive where it runs counter-clockwise."""
    x, y = ring[:, 0], ring[:, 1]
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


def triangulated(ring: Floats) -> NDArray[np.int64]:
    """(K - 2, 3) triangles of a counter-clockwise simple ring (K, 2), counter-clockwise.

    Source: G. H. Meisters, "Polygons have ears", American Mathematical Monthly 82 (1975).
    """
    if np.all(_turns(ring, np.roll(ring, -1, axis=0), np.roll(ring, -2, axis=0)) > 0):
        after = np.arange(1, len(ring) - 1)
        return np.column_stack([np.zeros_like(after), after, after + 1])
    corners = [(float(x), float(y)) for x, y in ring]
    left = list(range(len(corners)))
    triangles: list[tuple[int, int, int]] = []
    while len(left) > 3:
        place = next((k for k in range(len(left)) if _is_ear(corners, left, k)), 0)
        triangles.append((left[place - 1], left[place], left[(place + 1) % len(left)]))
        del left[place]
    triangles.append((left[0], left[1], left[2]))
    return np.array(triangles, np.int64)


def _is_ear(corners: list[Corner], left: list[int], place: int) -> bool:
    a, b, c = corners[left[place - 1]], corners[left[place]], corners[left[(place + 1) % len(left)]]
    (ax, ay), (bx, by), (cx, cy) = a, b, c
    if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) <= 1e-14:
        return False
    # Written out, as it is gone through a hundred thousand times: left of a-b, of b-c and of c-a is in the ear.
    for other in left:
        x, y = point = corners[other]
        if (
            (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0
            and (cx - bx) * (y - by) - (cy - by) * (x - bx) >= 0
            and (ax - cx) * (y - cy) - (ay - cy) * (x - cx) >= 0
            and point not in (a, b, c)
        ):
            return False
    return True


def _turns(a: Floats, b: Floats, points: Floats) -> Floats:
    """Twice the signed areas of a-b-point, for single or (K, 2) corners."""
    along, towards = b - a, points - a
    return along[..., 0] * towards[:, 1] - along[..., 1] * towards[:, 0]


def bridged(outer: Floats, holes: Sequence[Floats]) -> Floats:
    """One ring out of a counter-clockwise ring and its clockwise holes, each joined by a bridge of no width.

    Source: D. Eberly, "Triangulation by Ear Clipping" (Geometric Tools, 2002), section 3.
    """
    ring = outer
    for hole in sorted(holes, key=lambda points: -float(points[:, 0].max())):
        start = int(np.argmax(np.round(hole[:, 0], 9)))  # rounded: a tie is broken alike everywhere
        corner = hole[start]
        order = np.argsort(np.round(np.sum((ring - corner) ** 2, axis=1), 9), kind="stable")
        other_edges = [ring, hole]
        end = next(int(k) for k in order if not any(_crosses(ring[k], corner, edges) for edges in other_edges))
        ring = np.concatenate([ring[: end + 1], np.roll(hole, -start, axis=0), corner[None], ring[end:]])
    return ring


def _crosses(a: Floats, b: Floats, ring: Floats) -> bool:
    """Whether the open segment a-b properly crosses an edge of the ring."""
    after = np.roll(ring, -1, axis=0)
    first = _turns(a, b, ring) * _turns(a, b, after)
    from_a = (after[:, 0] - ring[:, 0]) * (a[1] - ring[:, 1]) - (after[:, 1] - ring[:, 1]) * (a[0] - ring[:, 0])
    from_b = (after[:, 0] - ring[:, 0]) * (b[1] - ring[:, 1]) - (after[:, 1] - ring[:, 1]) * (b[0] - ring[:, 0])
    return bool(np.any((first < 0) & (from_a * from_b < 0)))
