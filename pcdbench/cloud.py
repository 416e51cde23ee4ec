"""The point cloud: the one value that datasets make, completers change and tasks measure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcdbench.errors import CloudError


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points in metres and, where known, their colours. Immutable.

    Attributes:
        points: (N, 3) float64, metres. Double precision, because map coordinates of 10^6 m must keep
            their millimetres.
        colors: (N, 3) float32 in [0, 1], or None where the cloud has no colour.

    Raises:
        CloudError: for wrong shapes, points that are not finite, or colours outside [0, 1].
    """

    points: NDArray[np.float64]
    colors: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        points = _frozen(self.points, np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise CloudError(f"points must have shape (N, 3), not {points.shape}")
        if not np.isfinite(points).all():
            bad = int((~np.isfinite(points).all(axis=1)).sum())
            raise CloudError(f"{bad} of {len(points)} points are not finite; drop them before use")
        object.__setattr__(self, "points", points)
        if self.colors is None:
            return
        colors = _frozen(self.colors, np.float32)
        if colors.shape != points.shape:
            raise CloudError(f"colors must have shape {points.shape} like the points, not {colors.shape}")
        if colors.size and not (colors.min() >= 0.0 and colors.max() <= 1.0):
            bad = int((~np.isfinite(colors).all(axis=1)).sum())
            if bad:
                raise CloudError(f"the colors of {bad} of {len(colors)} points are not finite; mend or drop them")
            raise CloudError("colors must lie in [0, 1]; divide 8-bit colours by 255")
        object.__setattr__(self, "colors", colors)

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        color = "no colour" if self.colors is None else "colour"
        if not len(self):
            return f"PointCloud(0 points, {color})"
        extent = " x ".join(f"{side:.2f}" for side in np.ptp(self.points, axis=0))
        return f"PointCloud({len(self):,} points, {color}, {extent} m)"

    def _repr_html_(self) -> str:
        """What a notebook shows; nothing is drawn before one asks."""
        from pcdbench.viewing.notebook import cloud_html

        return cloud_html(self)

    @classmethod
    def read(cls, path: str | Path) -> PointCloud:
        """Read a cloud from PLY, PCD, XYZ/TXT, LAS/LAZ, E57 or NPZ, by the file's extension.

        Raises:
            CloudError: naming the file and the cure where it cannot be read.
        """
        from pcdbench.formats import read_cloud

        return read_cloud(Path(path))

    def write(self, path: str | Path) -> None:
        """Write the cloud in the format of the path's extension; the file appears complete or not at all."""
        from pcdbench.formats import write_cloud

        write_cloud(self, Path(path))

    def select(self, index: NDArray[Any]) -> PointCloud:
        """The points (and colours) at `index`: a boolean mask (N,) or an integer array."""
        return PointCloud(self.points[index], None if self.colors is None else self.colors[index])

    def without_colors(self) -> PointCloud:
        """The same points, colours forgotten."""
        return PointCloud(self.points)

    @staticmethod
    def concatenate(clouds: list[PointCloud]) -> PointCloud:
        """One cloud of all points, in order; it has colour only where every part has."""
        points = np.concatenate([cloud.points for cloud in clouds]) if clouds else np.empty((0, 3))
        colors = [cloud.colors for cloud in clouds if cloud.colors is not None]
        keep_colors = clouds and len(colors) == len(clouds)
        return PointCloud(points, np.concatenate(colors) if keep_colors else None)


def _frozen(array: ArrayLike, dtype: type) -> NDArray[Any]:
    """A read-only array of this type: the caller's own array is never frozen nor shared while writable."""
    source = np.asarray(array)
    owned: NDArray[Any] = np.ascontiguousarray(source, dtype=dtype)
    if owned is source and not source.flags.writeable:
        return owned
    if np.shares_memory(owned, source):
        owned = owned.copy()
    owned.flags.writeable = False
    return owned
