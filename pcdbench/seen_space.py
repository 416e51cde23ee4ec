"""What a real complete scan can judge of a completed cloud: the space that it saw, empty or not."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.errors import Skipped
from pcdbench.geometry.scanning import MOST_SURFELS, scanned
from pcdbench.geometry.surfels import SurfelCloud
from pcdbench.geometry.visibility import MeshRaycaster
from pcdbench.incompleteness import UNSEEN_SHARE
from pcdbench.scene import Scene
from pcdbench.threads import thread_count

MOST_VIEWPOINTS = 16
# Nearer to the complete scan than this, a point is judged by it, seen through or not.
NEAR_M = 0.05


class SeenSpace:
    """The space that the complete scan of a scene saw.

    A point was seen if it lies on the scan's surface or in front of it: within `near_m` of a point of the dense cloud,
    or on a free line of sight that starts where the scanner may have been and ends at a surface further on, which
    shows that the scanner looked through there. All else (behind walls, under tables, outside) is unknown.

    Attributes:
        viewpoints: (V, 3) metres: where the scan was taken from where the scene tells, else places to stand in it.
    """

    def __init__(self, scene: Scene) -> None:
        points = scene.dense.points
        self._center = points.mean(axis=0)
        self._tree = cKDTree(points - self._center)
        self._raycaster: MeshRaycaster
        try:
            place = scanned(scene)
            self._raycaster, tolerance_m, standing = place.raycaster, place.tolerance_m, place.at(place.free.centers)
        except Skipped:
            # Nowhere to stand: a scan of a shelf, say. Then the middle of what was seen is as good as any place.
            surfels = SurfelCloud(points[:: -(-len(points) // MOST_SURFELS)])
            self._raycaster, tolerance_m, standing = (
                surfels.raycaster,
                surfels.tolerance_m,
                np.median(points, axis=0)[None],
            )
        self._near_m = max(NEAR_M, tolerance_m)
        self.viewpoints = _spread(standing if scene.viewpoints is None else scene.viewpoints)

    def holds(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) mask of the (N, 3) points, metres, that lie where the scan saw what is there."""
        distances, _ = self._tree.query(
            points - self._center, distance_upper_bound=self._near_m, workers=thread_count()
        )
        seen = np.isfinite(distances)
        for viewpoint in self.viewpoints:
            open_ = np.flatnonzero(~seen)
            rays = points[open_] - viewpoint
            range_m = np.linalg.norm(rays, axis=1)
            hits = self._raycaster.cast(viewpoint, rays / np.maximum(range_m, 1e-9)[:, None])
            seen[open_] = np.isfinite(hits.range_m) & (hits.range_m > range_m)
        return seen


def judged(case: Case, completed: PointCloud) -> tuple[PointCloud, dict[str, float]]:
    """The part of a completed cloud that is measured, and what the trace says of it.

    All of it where points were taken away from the complete cloud, since both ends of the comparison were made from
    one scan. Of a real pair, the points where the complete scan saw what is there; the trace holds the share that it
    did not see, `unseen_share`.

    Raises:
        Skipped: where the complete scan saw nothing of what was completed.
    """
    if case.scan is None:
        return completed, {}
    if case.scene not in _seen:
        _seen[case.scene] = SeenSpace(case.scene)
    mask = _seen[case.scene].holds(completed.points)
    if not mask.any():
        raise Skipped("the complete scan saw nothing of the space that the completed cloud lies in")
    return completed.select(mask), {UNSEEN_SHARE: 1.0 - float(mask.mean())}


_seen: WeakKeyDictionary[Scene, SeenSpace] = WeakKeyDictionary()


def _spread(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """At most `MOST_VIEWPOINTS` of (V, 3) places, as far from each other as can be, from the middlemost on."""
    chosen = [int(np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1)))]
    distances = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < MOST_VIEWPOINTS and distances.max() > 0:
        chosen.append(int(np.argmax(distances)))
        distances = np.minimum(distances, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return places[chosen]
