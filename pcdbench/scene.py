"""The scene: a complete cloud to be measured against, and what it came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.geometry.poses import rotation_about

if TYPE_CHECKING:
    from pcdbench.geometry.visibility import MeshRaycaster


@dataclass(frozen=True, eq=False)
class Box:
    """A box with a heading: where a tagged object is.

    Attributes:
        center: (3,) metres, scene frame.
        size: (3,) full side lengths in metres along the box's own axes.
        yaw_rad: rotation of the box about the vertical (z) axis, radians.
    """

    center: NDArray[np.float64]
    size: NDArray[np.float64]
    yaw_rad: float = 0.0

    def contains(self, points: NDArray[np.float64], margin_m: float = 0.0) -> NDArray[np.bool_]:
        """(N,) mask of the (N, 3) points inside the box, grown by `margin_m` on every side."""
        local = self.to_local(points)
        return np.all(np.abs(local) <= np.asarray(self.size) / 2 + margin_m, axis=1)

    def to_local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The (N, 3) points in the box's own frame: origin at its centre, axes along its sides."""
        return (np.asarray(points) - self.center) @ rotation_about("z", self.yaw_rad)


@dataclass(frozen=True, eq=False)
class TaggedObject:
    """An object someone would tag on a map: a label and where it is."""

    label: str
    box: Box


@dataclass(frozen=True, eq=False)
class Surface:
    """The triangle mesh a generated scene was scanned from; live scans are cast on it.

    Attributes:
        vertices: (V, 3) metres, scene frame.
        triangles: (T, 3) indices into vertices.
        transparent: (T,) mask of triangles that rays pass through (glass), though they exist.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    transparent: NDArray[np.bool_]

    @cached_property
    def raycaster(self) -> MeshRaycaster:
        """Casts rays on all but the transparent triangles; built once."""
        from pcdbench.geometry.visibility import MeshRaycaster

        return MeshRaycaster(self.vertices, self.triangles[~self.transparent])


@dataclass(frozen=True, eq=False)
class Scene:
    """A place that was scanned as completely as it ever will be.

    Attributes:
        name: unique in its data set; only letters, digits, `.`, `_` and `-`.
        complete: the cloud to be measured against (20,000 points, say).
        dense: the cloud that `complete` was sampled from (hundreds of thousands of points, where there are).
        complete_index: (N,) rows of `dense` that make up `complete`, so that others can be drawn independently.
        objects: what is tagged in it.
        surface: the mesh it was scanned from, or None for real scans.
        source: where it came from, for people (a file, a generator with its seed).
        info: facts for people and figures (kind of room, extent); nothing is computed from it.
        partial: what another, shorter scan of the same place saw, in the scene's frame: the other half of a real
            pair (incompleteness `real_pair`). None for most scenes.
        viewpoints: (V, 3) metres, where the complete scan was taken from, where that is known.
    """

    name: str
    complete: PointCloud
    dense: PointCloud
    complete_index: NDArray[np.int64]
    objects: tuple[TaggedObject, ...] = ()
    surface: Surface | None = None
    source: str = ""
    info: Mapping[str, str] = field(default_factory=dict)
    partial: PointCloud | None = None
    viewpoints: NDArray[np.float64] | None = None

    @property
    def longest_side_m(self) -> float:
        """The longest side of the complete cloud's bounding box: the unit of normalised metrics."""
        return float(np.ptp(self.complete.points, axis=0).max())
