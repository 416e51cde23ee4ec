"""The folder layouts of posed RGB-D that people have, each read into the same values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pcdbench.datasets.rgbd.sequence import Camera, Frame, Sequence, calibrated
from pcdbench.errors import CloudError
from pcdbench.geometry.poses import Pose, inverse

IMAGES = (".jpg", ".jpeg", ".png")
# Images and poses whose times differ by more were not taken together.
_MOST_APART_S = 0.02
_KINECT = Camera(585.0, 585.0, 320.0, 240.0, 640, 480)
# Sturm et al. (2012), calibrations of the colour cameras that TUM's depth images are registered to.
_TUM = {
    "freiburg1": Camera(517.3, 516.5, 318.6, 255.3, 640, 480),
    "freiburg2": Camera(520.9, 521.0, 325.1, 249.7, 640, 480),
    "freiburg3": Camera(535.4, 539.2, 320.1, 247.6, 640, 480),
}
_TUM_DEFAULT = Camera(525.0, 525.0, 319.5, 239.5, 640, 480)


def layout_of(folder: Path) -> str | None:
    """The name of a folder's layout, or None where it is no sequence."""
    return next((name for name, (is_one, _) in LAYOUTS.items() if is_one(folder)), None)


def read_sequence(folder: Path) -> Sequence:
    """The sequence in a folder, with its calibration file where there is one.

    Raises:
        CloudError: where the folder has none of the layouts or one of its text files cannot be read.
    """
    name = layout_of(folder)
    if name is None:
        raise CloudError(f"{folder} has none of the layouts {', '.join(LAYOUTS)}; see docs/data.md")
    return calibrated(LAYOUTS[name][1](folder))


def _is_seven_scenes(folder: Path) -> bool:
    return any(folder.glob("frame-*.pose.txt"))


def _seven_scenes(folder: Path) -> Sequence:
    """7-Scenes (Shotton et al. 2013): `frame-000000.{color.png,depth.png,pose.txt}`."""
    frames = []
    lost: Counter[str] = Counter()
    for pose in sorted(folder.glob("frame-*.pose.txt")):
        stem = pose.name.removesuffix(".pose.txt")
        depth = folder / f"{stem}.depth.png"
        if not depth.is_file():
            lost["no depth image"] += 1
            continue
        frames.append(Frame(stem.removeprefix("frame-"), depth, _image(folder, f"{stem}.color"), _pose(pose)))
    intrinsics = folder / "camera-intrinsics.txt"
    camera = _camera(intrinsics, 640, 480) if intrinsics.is_file() else _KINECT
    files = (*sorted(folder.glob("frame-*.pose.txt")), *([intrinsics] if intrinsics.is_file() else []))
    return Sequence(folder, tuple(frames), camera, unusable=lost, files=files)


def _is_tum(folder: Path) -> bool:
    return all((folder / name).is_file() for name in ("rgb.txt", "depth.txt", "groundtruth.txt"))


def _tum(folder: Path) -> Sequence:
    """TUM RGB-D (Sturm et al. 2012): images and poses by time; depth is registered to colour, 5000 a metre."""
    depth_s, depth = _timed_images(folder / "depth.txt")
    color_s, color = _timed_images(folder / "rgb.txt")
    table = _table(folder / "groundtruth.txt")
    if table.shape[1] != 8:
        raise CloudError(f"{folder / 'groundtruth.txt'}: its rows must be time tx ty tz qx qy qz qw")
    frames = []
    lost: Counter[str] = Counter()
    for seconds, path in zip(depth_s, depth, strict=True):
        at, color_at = _nearest(table[:, 0], seconds), _nearest(color_s, seconds)
        if at is None:
            lost["no pose of its time"] += 1
        elif color_at is None:
            lost["no colour image of its time"] += 1
        else:
            frames.append(Frame(path.stem, path, color[color_at], quaternion_pose(table[at, 1:])))
    # A linked sequence may be called otherwise than where it lies.
    called = (folder.name.lower(), folder.resolve().name.lower())
    camera = next((camera for its in called for name, camera in _TUM.items() if name in its), _TUM_DEFAULT)
    files = tuple(folder / name for name in ("rgb.txt", "depth.txt", "groundtruth.txt"))
    return Sequence(
        folder,
        tuple(frames),
        camera,
        depth_scale=5000.0,
        unusable=lost,
        files=files,
        is_camera_by_name=True,
    )


def _is_scannet(folder: Path) -> bool:
    return all((folder / name).is_dir() for name in ("depth", "pose", "intrinsic"))


def _scannet(folder: Path) -> Sequence:
    """ScanNet as its exporter writes it: `color/0.jpg depth/0.png pose/0.txt intrinsic/*.txt`."""
    frames = []
    lost: Counter[str] = Counter()
    poses = sorted((folder / "pose").glob("*.txt"), key=_in_order)
    for pose in poses:
        depth = folder / "depth" / f"{pose.stem}.png"
        if not depth.is_file():
            lost["no depth image"] += 1
            continue
        frames.append(Frame(pose.stem, depth, _image(folder / "color", pose.stem), _pose(pose)))
    intrinsic = folder / "intrinsic"
    camera = _camera(intrinsic / "intrinsic_depth.txt", None, None)
    color = intrinsic / "intrinsic_color.txt"
    extrinsics = [intrinsic / f"extrinsic_{which}.txt" for which in ("color", "depth")]
    T_color_depth = np.eye(4)
    if all(path.is_file() for path in extrinsics):
        # Each takes its camera's points into the common frame that the poses are of.
        T_common_color, T_common_depth = (_pose(path) for path in extrinsics)
        T_color_depth = inverse(T_common_color) @ T_common_depth
    files = (*poses, *sorted(intrinsic.glob("*.txt")))
    color_camera = _camera(color, None, None) if color.is_file() else None
    return Sequence(folder, tuple(frames), camera, color_camera, T_color_depth, unusable=lost, files=files)


def _is_rtabmap(folder: Path) -> bool:
    return _rtabmap_poses(folder) is not None and all(_part(folder, name) for name in ("depth", "calib"))


def _rtabmap(folder: Path) -> Sequence:
    """RTAB-Map's export: folders of images and of OpenCV calibrations, named by time or number, and one pose file.

    Poses are of the robot's base; each calibration's `local_transform` leads from there to the camera. In a file
    whose name holds `camera` they are of the camera itself.
    """
    poses_path = _rtabmap_poses(folder)
    depth_folder, calibrations, color_folder = (_part(folder, name) for name in ("depth", "calib", "rgb"))
    assert poses_path is not None and depth_folder is not None and calibrations is not None
    images = sorted((path for path in depth_folder.iterdir() if path.suffix.lower() == ".png"), key=_in_order)
    poses = _rtabmap_rows(poses_path, np.array([_number(path) for path in images]))
    of_camera = "camera" in poses_path.stem
    frames = []
    lost: Counter[str] = Counter()
    used: list[Path] = []
    for depth, pose in zip(images, poses, strict=True):
        calibration = next(
            (its for its in (calibrations / f"{depth.stem}{end}.yaml" for end in ("", "_0")) if its.is_file()), None
        )
        if pose is None:
            lost["no pose"] += 1
        elif calibration is None:
            lost["no calibration"] += 1
        else:
            camera, T_base_camera = _opencv_calibration(calibration)
            color = None if color_folder is None else _image(color_folder, depth.stem)
            T_world_camera = pose if of_camera else pose @ T_base_camera
            frames.append(Frame(depth.stem, depth, color, T_world_camera, camera))
            used.append(calibration)
    camera = frames[0].camera if frames and frames[0].camera else _KINECT
    return Sequence(folder, tuple(frames), camera, unusable=lost, files=(poses_path, *used))


LAYOUTS: dict[str, tuple[Callable[[Path], bool], Callable[[Path], Sequence]]] = {
    "7-Scenes": (_is_seven_scenes, _seven_scenes),
    "TUM RGB-D": (_is_tum, _tum),
    "ScanNet": (_is_scannet, _scannet),
    "RTAB-Map": (_is_rtabmap, _rtabmap),
}


def quaternion_pose(values: NDArray[np.float64]) -> Pose:
    """(4, 4) of tx ty tz qx qy qz qw; not finite where the quaternion is zero or not finite."""
    T = np.eye(4)
    if not np.isfinite(values).all() or not np.linalg.norm(values[3:]) > 1e-9:
        return np.full((4, 4), np.nan)
    T[:3, :3] = Rotation.from_quat(values[3:]).as_matrix()
    T[:3, 3] = values[:3]
    return T


def _rtabmap_poses(folder: Path) -> Path | None:
    """`poses.txt`, `<name>_poses.txt` or `<name>_camera_poses.txt`, the base's own before the camera's."""
    return next(iter(sorted(folder.glob("*poses*.txt"), key=lambda path: ("camera" in path.stem, path.name))), None)


def _rtabmap_rows(path: Path, numbers: NDArray[np.float64]) -> list[Pose | None]:
    """The pose of each image: by its id or time, and by its place where the file has neither (3 x 4 matrices).

    Args:
        numbers: (N,) what the images are named: ids or times; infinite where a name is neither.
    """
    table = _table(path)
    if table.shape[1] == 12 and not np.isfinite(numbers).all():
        raise CloudError(
            f"{path} has poses without times, and not all images are named by number: which belong together cannot be "
            "told; name the images by number in the order of the poses"
        )
    if table.shape[1] == 12 and len(table) == len(numbers):
        bottom = np.tile([0.0, 0.0, 0.0, 1.0], (len(table), 1))
        return list(np.hstack([table, bottom]).reshape(-1, 4, 4))
    if table.shape[1] == 12:
        raise CloudError(
            f"{path} has {len(table)} poses without times for {len(numbers)} images; export them with times "
            "(rtabmap-export --poses --poses_format 11)"
        )
    if table.shape[1] not in (8, 9):
        raise CloudError(f"{path}: its rows must be time x y z qx qy qz qw, maybe with an id, or a 3 x 4 matrix")
    found: list[Pose | None] = []
    for number in numbers:
        by_id = np.flatnonzero(table[:, 8] == number) if table.shape[1] == 9 else np.empty(0, np.int64)
        row = int(by_id[0]) if len(by_id) else _nearest(table[:, 0], number)
        found.append(None if row is None else quaternion_pose(table[row, 1:8]))
    return found


def _opencv_calibration(path: Path) -> tuple[Camera, Pose]:
    """The camera of an OpenCV YAML file, and its `T_base_camera` (`local_transform`)."""
    text = path.read_text(encoding="utf-8", errors="replace")

    def data(name: str) -> NDArray[np.float64] | None:
        found = re.search(rf"^\s*{name}\s*:.*?data\s*:\s*\[(.*?)\]", text, re.DOTALL | re.MULTILINE)
        try:
            return None if found is None else np.array(re.split(r"[,\s]+", found[1].strip()), np.float64)
        except ValueError:
            raise CloudError(f"{path}: its {name} are not numbers; export the images again") from None

    def whole(name: str) -> int | None:
        found = re.search(rf"^\s*{name}\s*:\s*(\d+)", text, re.MULTILINE)
        return None if found is None else int(found[1])

    matrix, local = data("camera_matrix"), data("local_transform")
    if matrix is None or matrix.size != 9:
        raise CloudError(f"{path} has no camera_matrix of nine numbers; export the images again")
    T_base_camera = np.eye(4)
    if local is not None and local.size == 12:
        T_base_camera[:3] = local.reshape(3, 4)
    fx, _, cx, _, fy, cy, *_ = matrix
    # A size of 0 is one that was not known.
    return Camera(fx, fy, cx, cy, whole("image_width") or None, whole("image_height") or None), T_base_camera


def _part(folder: Path, name: str) -> Path | None:
    """The subfolder `name`, or `<something>_name` as rtabmap-export calls it."""
    candidates = [folder / name, *sorted(folder.glob(f"*_{name}"))]
    return next((path for path in candidates if path.is_dir()), None)


def _image(folder: Path, stem: str) -> Path | None:
    return next((path for path in (folder / f"{stem}{extension}" for extension in IMAGES) if path.is_file()), None)


def _in_order(path: Path) -> tuple[float, str]:
    """What files are sorted by: their number, then their name."""
    return _number(path), path.name


def _number(path: Path) -> float:
    """The number that a file is named by: 10 comes after 9, a time is a time; infinite where its name is none."""
    try:
        number = float(path.stem)
    except ValueError:
        return float("inf")
    return number if np.isfinite(number) else float("inf")


def _pose(path: Path) -> Pose:
    """(4, 4) of a text file; not finite where it holds no sixteen numbers."""
    try:
        values = np.array(path.read_text(encoding="utf-8", errors="replace").split(), np.float64)
        return values.reshape(4, 4)
    except (OSError, ValueError):
        return np.full((4, 4), np.nan)


def _camera(path: Path, width: int | None, height: int | None) -> Camera:
    try:
        values = np.array(path.read_text(encoding="utf-8").split(), np.float64)
        matrix = values.reshape((3, 3) if values.size == 9 else (4, 4))
    except (OSError, ValueError) as error:
        raise CloudError(f"{path} is no camera matrix of 3 x 3 or 4 x 4 numbers ({error}); copy it again") from error
    return Camera(matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], width, height)


def _table(path: Path) -> NDArray[np.float64]:
    """(R, C) numbers of a text file; `nan` and `inf` are numbers."""
    try:
        return np.loadtxt(path, ndmin=2, comments="#")
    except (OSError, ValueError) as error:
        raise CloudError(f"{path} is no table of numbers ({error}); copy it again") from error


def _timed_images(path: Path) -> tuple[NDArray[np.float64], list[Path]]:
    """Times and images of `rgb.txt` or `depth.txt`, by time."""
    rows = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split()
        if len(words) == 2 and not line.startswith("#"):
            try:
                rows.append((float(words[0]), path.parent / words[1]))
            except ValueError as error:
                raise CloudError(f"{path}: {line!r} is no time and file; copy it again") from error
    rows.sort()
    return np.array([seconds for seconds, _ in rows]), [image for _, image in rows]


def _nearest(times: NDArray[np.float64], seconds: float) -> int | None:
    if not len(times):
        return None
    at = int(np.argmin(np.abs(times - seconds)))
    return at if abs(times[at] - seconds) <= _MOST_APART_S else None
