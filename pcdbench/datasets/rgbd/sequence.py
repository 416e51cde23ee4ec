"""The values of posed RGB-D: cameras, frames, a sequence of them; and the calibration file beside the images."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.errors import CloudError
from pcdbench.geometry.poses import Pose

CALIBRATION_NAMES = ("calibration.json", "transform_and_calibration.json")


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; pixel (u, v) = (fx x / z + cx, fy y / z + cy), x right, y down, z forward.

    Attributes:
        fx, fy, cx, cy: pixels.
        width, height: pixels of the image that they are meant for; None where they fit any image they come with.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int | None = None
    height: int | None = None

    def scaled_to(self, width: int, height: int) -> Camera:
        """The same camera with images of another size."""
        if self.width is None or self.height is None or (self.width, self.height) == (width, height):
            return self
        x, y = width / self.width, height / self.height
        return Camera(self.fx * x, self.fy * y, (self.cx + 0.5) * x - 0.5, (self.cy + 0.5) * y - 0.5, width, height)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) the camera matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Frame:
    """A depth image, the colour image taken with it, and where the depth camera was.

    Attributes:
        name: as its file is called, or its time.
        depth: 16-bit PNG.
        color: None where there is none.
        T_world_depth: (4, 4) as the files have it, maybe not finite or not rigid.
        camera: of the depth image where each frame has its own, else None.
    """

    name: str
    depth: Path
    color: Path | None
    T_world_depth: Pose
    camera: Camera | None = None


@dataclass(frozen=True, eq=False)
class Sequence:
    """Posed RGB-D images of one place.

    Attributes:
        root: its folder.
        frames: in the order they were taken.
        depth_camera: of all depth images whose frame has none of its own.
        color_camera: None where colour images are aligned with depth images, pixel by pixel.
        T_color_depth: (4, 4) takes points of the depth camera into the colour camera.
        depth_scale: depth values a metre.
        T_zup_world: (4, 4) takes the poses' world into one with z up; None where it has to be found.
        unusable: by reason, how many frames the layout's files name that cannot be used.
        files: those that decide the scene beside the images: poses, calibrations.
        is_camera_by_name: whether the depth camera follows from what the folder is called and from no file.
    """

    root: Path
    frames: tuple[Frame, ...]
    depth_camera: Camera
    color_camera: Camera | None = None
    T_color_depth: Pose | None = None
    depth_scale: float = 1000.0
    T_zup_world: Pose | None = None
    unusable: Mapping[str, int] | None = None
    files: tuple[Path, ...] = ()
    is_camera_by_name: bool = False


def calibration_file(root: Path) -> Path | None:
    """The calibration beside a sequence's images or in the folder above: the link's, then its target's."""
    candidates = [folder / name for folder in (root, root.parent, root.resolve().parent) for name in CALIBRATION_NAMES]
    return next((path for path in candidates if path.is_file()), None)


def calibrated(sequence: Sequence) -> Sequence:
    """The sequence with what its calibration file says, where it has one; what the file leaves out stays.

    Raises:
        CloudError: where the file is not as docs/data.md describes it.
    """
    path = calibration_file(sequence.root)
    if path is None:
        return sequence
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        depth = content.get("depth", content.get("depth_intrinsics"))
        color = content.get("color", content.get("colour_camera_fitted"))
        T_zup_world = content.get("T_zup_world", content.get("world_to_zup_4x4"))
        return replace(
            sequence,
            depth_camera=sequence.depth_camera if depth is None else _camera(depth),
            depth_scale=_positive("scale", (depth or {}).get("scale", sequence.depth_scale)),
            color_camera=sequence.color_camera if color is None else _camera(color),
            T_color_depth=sequence.T_color_depth if color is None else _T_color_depth(color),
            T_zup_world=sequence.T_zup_world if T_zup_world is None else matrix4(T_zup_world),
            files=(*sequence.files, path),
            is_camera_by_name=sequence.is_camera_by_name and depth is None,
        )
    except (OSError, ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise CloudError(f"{path} is no calibration as docs/data.md describes it ({error!r}); correct it") from error


def is_rigid(T: NDArray[np.float64]) -> bool:
    """Whether a (4, 4) matrix is a rotation and a translation, but for the rounding of text files."""
    rotation = T[:3, :3]
    return bool(
        np.abs(rotation.T @ rotation - np.eye(3)).max() < 1e-2
        and np.linalg.det(rotation) > 0
        and np.abs(T[3] - [0, 0, 0, 1]).max() < 1e-3
    )


def matrix4(values: Any) -> Pose:
    """(4, 4) floats of nested or flat lists of 16 numbers.

    Raises:
        ValueError: for any other shape, or what is not rigid.
    """
    matrix = np.asarray(values, np.float64).reshape(4, 4)
    if not (np.isfinite(matrix).all() and is_rigid(matrix)):
        raise ValueError("its 4 x 4 matrix is no rigid transform")
    return matrix


def _camera(values: Mapping[str, Any]) -> Camera:
    width, height = values.get("width", values.get("w")), values.get("height", values.get("h"))
    return Camera(
        _positive("fx", values["fx"]),
        _positive("fy", values["fy"]),
        float(values["cx"]),
        float(values["cy"]),
        None if width is None else int(_positive("width", int(width))),
        None if height is None else int(_positive("height", int(height))),
    )


def _positive(name: str, value: Any) -> float:
    number = float(value)
    if not 0 < number < float("inf"):
        raise ValueError(f"{name} is {value}, not a number above 0")
    return number


def _T_color_depth(color: Mapping[str, Any]) -> Pose:
    if "T_color_depth" in color:
        return matrix4(color["T_color_depth"])
    T = np.eye(4)
    T[0, 3] = float(color.get("t_x_m", 0.0))
    return T
