"""A completed cloud: what was observed, as it was, and what was added, with the confidence of each point."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats import MARKS, carries_fields, write_cloud
from pcdbench.formats.columns import NO_FIELDS, Fields
from pcdbench.geometry.frames import Frame

# As in the viewer.
_GREY, _ORANGE = (0.62, 0.65, 0.69), (0.89, 0.42, 0.05)


@dataclass(frozen=True, eq=False)
class Completed:
    """What `pcdbench.complete` returns.

    Attributes:
        cloud: the observed points, in their order and to the last bit, and after them the added ones.
        added: (N,) which points of the cloud were added.
        confidence: (N,) float32 in [0, 1]; 1 for observed points.
        spacing_m: (A,) of each added point: how far points are apart there, as on a square grid.
        weakest: (A,) uint8 of each added point: which of `confidence.FACTORS` lowers its confidence most.
        gaps: (G, 3) metres, in the cloud's own frame: places in gaps that stayed open.
        gaps_m2: (G,) square metres of gap that each stands for.
        surface_m2: area of what was observed, about.
        frame: which axis is up.
        tiles: how many tiles were completed, failed ones too.
        failures: one line for each tile that the completer failed on; nothing was added there. Area and gaps count
            these tiles, but for those whose line says otherwise.
    """

    cloud: PointCloud
    added: NDArray[np.bool_]
    confidence: NDArray[np.float32]
    spacing_m: NDArray[np.float64]
    weakest: NDArray[np.uint8]
    gaps: NDArray[np.float64]
    gaps_m2: NDArray[np.float64]
    surface_m2: float
    frame: Frame
    tiles: int
    failures: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"Completed({int((~self.added).sum()):,} observed and {len(self.spacing_m):,} added points)"

    def _repr_html_(self) -> str:
        """What a notebook shows: the cloud as clouds show themselves, upright, what was added in orange."""
        from pcdbench.viewing.notebook import cloud_html

        colors = np.full(self.cloud.points.shape, _GREY) if self.cloud.colors is None else self.cloud.colors.copy()
        colors[self.added] = _ORANGE
        return cloud_html(PointCloud(self.frame.upright(self.cloud.points), colors), repr(self))

    @property
    def added_cloud(self) -> PointCloud:
        """The added points alone."""
        return self.cloud.select(slice(len(self.cloud) - len(self.spacing_m), None))  # type: ignore[arg-type]

    def write(
        self,
        path: str | Path,
        *,
        added_only: bool = False,
        fields: Fields = NO_FIELDS,
        like: str | Path | None = None,
    ) -> None:
        """Write the cloud with the fields `added` (0 or 1) and `confidence`, in formats that have fields.

        Observed coordinates are written to the last bit where the format can (see `write_cloud`).

        Args:
            added_only: write the added points alone, without further fields.
            fields: further numbers of each observed point, (N,) or (N, K), written too where the format has fields. Of
                added points they are not known: 0 where numbers are whole, else NaN. A scan's own `added` and
                `confidence` become `added_scan` and `confidence_scan`, or the next free name (`added_scan_2`).
            like: the scan, whose coordinate reference system (LAS to LAS) or VIEWPOINT (PCD to PCD) is taken over.

        Raises:
            CloudError: where nothing was added and nothing else is asked for, or the file cannot be written.
        """
        path = Path(path)
        cloud = self.added_cloud if added_only else self.cloud
        first = len(self.cloud) - len(cloud)
        written: dict[str, NDArray[Any]] = {}
        if carries_fields(path):
            observed = len(self.cloud) - len(self.spacing_m)
            for name, values in ({} if added_only else fields).items():
                column = np.asarray(values)
                if column.shape[:1] != (observed,):
                    raise CloudError(f"field {name} must have a row for each of the {observed:,} observed points")
                kept = name_beside_marks(name, fields)
                written[kept] = _lengthened(column, len(self.spacing_m), name)
            written |= dict(zip(MARKS, (self.added[first:], self.confidence[first:]), strict=True))
        write_cloud(cloud, path, written, exact=True, like=None if like is None else Path(like))


def name_beside_marks(name: str, fields: Container[str]) -> str:
    """What a field of a scan is called in its completion: its own name but for `added` and `confidence`."""
    found, number = f"{name}_scan" if name in MARKS else name, 1
    while name in MARKS and found in fields:
        number += 1
        found = f"{name}_scan_{number}"
    return found


def _lengthened(values: NDArray[Any], count: int, name: str) -> NDArray[Any]:
    """A field of the observed points with `count` rows more, of which nothing is known but that they are to be seen."""
    unknown: Any = np.nan if values.dtype.kind == "f" else 0
    if name == "alpha":
        unknown = values.max(initial=0)
    more = np.full((count, *values.shape[1:]), unknown).astype(values.dtype)
    return np.concatenate([values, more])
