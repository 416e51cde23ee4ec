"""Triangle meshes whose every triangle knows its material and a tint that sets objects apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcdbench.datasets.synthetic.materials import material_id
from pcdbench.geometry.poses import rotation_about

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in metres, wound counter-clockwise seen from outside.

    Attributes:
        vertices: (V, 3) float64 metres.
        triangles: (T, 3) int64 indices into `vertices`.
        materials: (T,) int32 indices into `materials.MATERIALS`.
        tints: (T,) int64 seeds that vary a material from object to object; the same tint looks the same.
    """

    vertices: Floats
    triangles: NDArray[np.int64]
    materials: NDArray[np.int32]
    tints: NDArray[np.int64]

    @staticmethod
    def of(vertices: ArrayLike, triangles: ArrayLike, material: str, tint: int) -> Mesh:
        """A mesh of one material, without the triangles that have no area (poles, closed caps)."""
        points = np.asarray(vertices, np.float64).reshape(-1, 3)
        corners = np.asarray(triangles, np.int64).reshape(-1, 3)
        x, y, z = _edge_products(points, corners)
        solid = x * x + y * y + z * z > 1e-20
        return Mesh.of_solid(points, corners if solid.all() else corners[solid], material, tint)

    @staticmethod
    def of_solid(vertices: Floats, triangles: NDArray[np.int64], material: str, tint: int) -> Mesh:
        """A mesh of one material, of vertices (V, 3) and triangles (T, 3) that all have an area."""
        count = len(triangles)
        # As numpy.full would make them, in a fifth of its time: there are ten thousands of small meshes.
        materials, tints = np.empty(count, np.int32), np.empty(count, np.int64)
        materials.fill(material_id(material))
        tints.fill(int(tint))
        return Mesh(vertices, triangles, materials, tints)

    @staticmethod
    def merge(meshes: Iterable[Mesh]) -> Mesh:
        """All of them as one mesh; of none, an empty mesh."""
        parts: Sequence[Mesh] = list(meshes)
        if not parts:
            return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros(0, np.int32), np.zeros(0, np.int64))
        starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
        return Mesh(
            np.concatenate([part.vertices for part in parts]),
            np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=True)]),
            np.concatenate([part.materials for part in parts]),
            np.concatenate([part.tints for part in parts]),
        )

    def moved(self, translation: ArrayLike, yaw_rad: float = 0.0) -> Mesh:
        """Turned by `yaw_rad` about the z axis of its own frame, then translated (3,) metres."""
        turned = self.vertices
        if yaw_rad:
            turned = turned @ rotation_about("z", yaw_rad).T
        return Mesh(turned + np.asarray(translation, np.float64), self.triangles, self.materials, self.tints)

    def rotated(self, axis: str, angle_rad: float) -> Mesh:
        """Turned by `angle_rad` about the x, y or z axis of its own frame."""
        return replace(self, vertices=self.vertices @ rotation_about(axis, angle_rad).T)

    def scaled(self, factors: ArrayLike) -> Mesh:
        """Scaled about the origin by one positive factor or by three (x, y, z)."""
        return replace(self, vertices=self.vertices * np.asarray(factors, np.float64))

    def deformed(self, displaced: Callable[[Floats], Floats]) -> Mesh:
        """With `displaced(vertices)` in place of its vertices: bends, sags and tapers."""
        return replace(self, vertices=np.asarray(displaced(self.vertices), np.float64))

    def bounds(self) -> tuple[Floats, Floats]:
        """The lowest and the highest corner, each (3,) metres."""
        return self._bounds

    @cached_property
    def _bounds(self) -> tuple[Floats, Floats]:
        # By columns: numpy reduces the rows of a narrow array ten times slower.
        columns = np.ascontiguousarray(self.vertices.T)
        low, high = columns.min(axis=1), columns.max(axis=1)
        low.flags.writeable = high.flags.writeable = False
        return low, high


def _edge_products(vertices: Floats, triangles: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
    """x, y and z, (T,) each, of the cross product of two edges of each triangle: its normal, twice its area long."""
    corners = vertices.T[:, triangles]
    (ax, ay, az), (bx, by, bz) = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
