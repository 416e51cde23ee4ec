"""Short scan: what a hand-held depth camera leaves unseen on a short walk (natural occlusion)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pcdbench import options
from pcdbench.errors import CloudError
from pcdbench.geometry.freespace import headings
from pcdbench.geometry.neighbors import nearest
from pcdbench.geometry.poses import Pose, pose
from pcdbench.geometry.scanning import FieldOfView, ScannedScene, scanned, within_view
from pcdbench.geometry.surfels import occluded
from pcdbench.incompleteness import Incompleteness
from pcdbench.scene import Scene

VIEW_EVERY_M = 0.25
VIEWS_A_LEG = 40


class ShortScan(Incompleteness):
    """Keeps what is seen first on a random walk, until just the level is left unseen.

    The camera looks where the walk goes and sways about it, as a person pans. Points are ordered by the view that
    first shows them, within a view from its middle outwards. Where `most_views` views do not show enough, the rest
    is made up of the unseen points nearest to what was seen.
    """

    class Options(options.Options):
        fov_deg: FieldOfView = Field((77.0, 60.0), description="field of view, horizontal and vertical")
        max_range_m: float = Field(6.0, gt=0, description="range of the camera, metres")
        pan_deg: float = Field(40.0, ge=0, description="how far the camera sways to either side of the walk")
        most_views: int = Field(240, ge=1, description="views, one every 25 cm, after which the walk ends")

    options: Options

    def kept(self, scene: Scene, level: float, rng: np.random.Generator) -> NDArray[np.bool_]:
        """(N,) mask over `scene.complete` of the points seen; round(level * N) are not.

        Raises:
            CloudError: where the cloud is so small that nothing would be left.
            Skipped: where there is nowhere to walk in the scene.
        """
        points = scene.complete.points
        wanted = len(points) - round(level * len(points))
        if wanted == 0:
            raise CloudError(f"{scene.name}: {len(points)} points are too few for a level of {level}")
        place = scanned(scene)
        seen = np.zeros(len(points), bool)
        order: list[NDArray[np.int64]] = []
        views = 0
        while seen.sum() < wanted and views < self.options.most_views:
            for T_scene_camera in self._leg(place, rng):
                fresh = self._newly_seen(place, points, seen, T_scene_camera)
                seen[fresh] = True
                order.append(fresh)
                views += 1
                if seen.sum() >= wanted or views == self.options.most_views:
                    break
        first = np.concatenate(order)[:wanted]
        kept = np.zeros(len(points), bool)
        kept[first] = True
        return _grown(points, kept, wanted)

    def _leg(self, place: ScannedScene, rng: np.random.Generator) -> list[Pose]:
        """The next views of the walk: camera poses in the scene."""
        path = place.free.walk(VIEWS_A_LEG * VIEW_EVERY_M, VIEW_EVERY_M, rng)
        phase, pitch_phase = rng.uniform(0, 2 * np.pi, 2)
        sway = np.radians(self.options.pan_deg) * np.sin(phase + 0.6 * np.arange(len(path)))
        pitch = np.radians(20.0) * np.sin(pitch_phase + 0.37 * np.arange(len(path)))
        yaw = headings(path, lookahead=2) + sway
        return [pose(*view) for view in zip(place.at(path), yaw, pitch, strict=True)]

    def _newly_seen(
        self, place: ScannedScene, points: NDArray[np.float64], seen: NDArray[np.bool_], T_scene_camera: Pose
    ) -> NDArray[np.int64]:
        """Index of the points that this view shows first, from the middle of the image outwards."""
        unseen = np.flatnonzero(~seen)
        index = unseen[within_view(points[unseen], T_scene_camera, self.options.max_range_m, *self.options.fov_deg)]
        origin = T_scene_camera[:3, 3]
        index = index[~occluded(place.raycaster, origin, points[index], place.tolerance_m)]
        rays = points[index] - origin
        along = rays @ T_scene_camera[:3, 0] / np.maximum(np.linalg.norm(rays, axis=1), 1e-9)
        return index[np.argsort(-along, kind="stable")]


def _grown(points: NDArray[np.float64], kept: NDArray[np.bool_], wanted: int) -> NDArray[np.bool_]:
    """`kept`, with the points nearest to it added until there are `wanted`."""
    missing = wanted - int(kept.sum())
    if missing == 0:
        return kept
    if not kept.any():
        raise CloudError("the camera sees no point of the complete cloud from anywhere on its walk")
    others = np.flatnonzero(~kept)
    distances, _ = nearest(points[others], points[kept])
    kept = kept.copy()
    kept[others[np.argsort(distances, kind="stable")[:missing]]] = True
    return kept
