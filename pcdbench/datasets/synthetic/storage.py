"""Generated scenes as arrays for the cache, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.scene import Box, Scene, Surface, TaggedObject


def arrays_of_scene(scene: Scene) -> dict[str, NDArray[Any]]:
    """A scene without its surface, points in single precision and colors in 8 bits."""
    colors = scene.dense.colors
    assert colors is not None
    boxes = [[*tagged.box.center, *tagged.box.size, tagged.box.yaw_rad] for tagged in scene.objects]
    return {
        "points": scene.dense.points.astype(np.float32),
        "colors": np.rint(colors * 255).astype(np.uint8),
        "complete_index": scene.complete_index.astype(np.int32),
        "labels": np.array([tagged.label for tagged in scene.objects], dtype=np.str_),
        "boxes": np.array(boxes, np.float64).reshape(-1, 7),
        "source": np.array(scene.source),
        "info": np.array([list(item) for item in scene.info.items()], dtype=np.str_).reshape(-1, 2),
    }


def scene_of_arrays(name: str, arrays: Mapping[str, NDArray[Any]], surface: Surface) -> Scene:
    """The scene that `arrays_of_scene` was given.

    Raises:
        KeyError: an array is missing.
    """
    dense = PointCloud(arrays["points"].astype(np.float64), arrays["colors"].astype(np.float32) / np.float32(255))
    index = arrays["complete_index"].astype(np.int64)
    objects = tuple(
        TaggedObject(str(label), Box(row[:3], row[3:6], float(row[6])))
        for label, row in zip(arrays["labels"], arrays["boxes"], strict=True)
    )
    info = {str(key): str(value) for key, value in arrays["info"]}
    return Scene(name, dense.select(index), dense, index, objects, surface, str(arrays["source"]), info)


def arrays_of_surface(surface: Surface) -> dict[str, NDArray[Any]]:
    """A surface for an NPZ file."""
    return {
        "vertices": surface.vertices,
        "triangles": surface.triangles.astype(np.int32),
        "transparent": surface.transparent,
    }


def surface_of_arrays(arrays: Mapping[str, NDArray[Any]]) -> Surface:
    """The surface that `arrays_of_surface` was given.

    Raises:
        KeyError: an array is missing.
    """
    return Surface(arrays["vertices"], arrays["triangles"].astype(np.int64), arrays["transparent"])
