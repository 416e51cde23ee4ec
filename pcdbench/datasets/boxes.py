"""Tagged objects from JSON files: boxes with labels, as people keep them beside a cloud."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.errors import CloudError
from pcdbench.scene import Box, TaggedObject

SHARED_NAME = "boxes.json"
OWN_SUFFIX = ".boxes.json"
_FARTHEST_M = 1e10
# Of the cloud's longest side. A box around a whole building may go with a crop of it; one in millimetres may not.
_LARGEST_SHARE = 10.0


def boxes_file(cloud: Path) -> Path | None:
    """The file that holds a cloud's boxes: `<stem>.boxes.json` beside it, else the folder's `boxes.json`, or None."""
    candidates = (cloud.with_name(cloud.stem + OWN_SUFFIX), cloud.with_name(SHARED_NAME))
    return next((path for path in candidates if path.is_file()), None)


def read_boxes(path: Path, cloud: Path, is_only_cloud: bool, longest_m: float) -> tuple[TaggedObject, ...]:
    """The objects that a boxes file holds for a cloud, in its order.

    The file is a list of boxes, or an object whose `instances` are one; the folder's `boxes.json` may also be
    an object that gives such a list to each file name (with or without its extension). A box has a `label` and
    either `min` and `max` or `center`, `size` and, perhaps, `yaw_rad`; all else in it is passed over.

    Args:
        path: the boxes file.
        cloud: the cloud's file; only its name is used.
        is_only_cloud: whether the cloud is alone in its folder; a `boxes.json` that names no file belongs to
            it only then.
        longest_m: the longest side of the cloud.

    Raises:
        CloudError: naming the file, the box and what is wrong with it.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise CloudError(f"{path} is not JSON ({error}); correct or remove it") from error
    boxes = content.get("instances", content) if isinstance(content, dict) else content
    if isinstance(boxes, dict):
        boxes = boxes.get(cloud.name, boxes.get(cloud.stem, []))
        boxes = boxes.get("instances", boxes) if isinstance(boxes, dict) else boxes
    elif path.name == SHARED_NAME and not is_only_cloud:
        raise CloudError(
            f'{path} does not say which cloud its boxes belong to; write {{"{cloud.name}": [...]}}, '
            f"or name the file {cloud.stem}{OWN_SUFFIX}"
        )
    if not isinstance(boxes, list):
        raise CloudError(f"{path}: the boxes of {cloud.name} must be a list")
    return tuple(
        _tagged(box, f"{path}: box {number} of {cloud.name}", longest_m) for number, box in enumerate(boxes, 1)
    )


def _tagged(box: Any, where: str, longest_m: float) -> TaggedObject:
    if not isinstance(box, Mapping):
        raise CloudError(f'{where} must look like {{"label": "chair", "min": [x, y, z], "max": [x, y, z]}}')
    label = box.get("label")
    if not isinstance(label, str) or not label.strip():
        raise CloudError(f"{where} has no label (a text); add one")
    if "min" in box and "max" in box:
        low, high = _three(box["min"], f"{where}: min"), _three(box["max"], f"{where}: max")
        center, size, yaw = (low + high) / 2, high - low, 0.0
    elif "center" in box and "size" in box:
        center, size = _three(box["center"], f"{where}: center"), _three(box["size"], f"{where}: size")
        yaw = _number(box.get("yaw_rad", 0.0), f"{where}: yaw_rad")
    else:
        raise CloudError(f"{where} needs min and max, or center and size (and yaw_rad)")
    if (size < 0).any():
        raise CloudError(f"{where} has a negative size {size.round(3).tolist()}; exchange min and max")
    if size.max() > _LARGEST_SHARE * longest_m:
        raise CloudError(f"{where} is {size.max():,.4g} m long, the cloud {longest_m:.4g} m; give the box in metres")
    return TaggedObject(label.strip(), Box(center, size, yaw))


def _three(value: Any, where: str) -> NDArray[np.float64]:
    if not isinstance(value, list) or len(value) != 3:
        raise CloudError(f"{where} must be three numbers [x, y, z]")
    return np.array([_number(item, where) for item in value])


def _number(value: Any, where: str) -> float:
    # NaN compares false; whole numbers of JSON may be too large for a float.
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _FARTHEST_M:
        raise CloudError(f"{where} holds {repr(value)[:40]}, which is not a finite number below 10^10")
    return float(value)
