"""Self-tests of the dependencies: each does on tiny data what pcdbench does with it, and tells what came out.

Run as a program it answers for the checks that it is given by name, one line of JSON each, so that one that kills
its process costs itself alone (see `examination`).
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# A self-test raises where something is wrong.
Check = Callable[[], str]


def _cache() -> str:
    from pcdbench.paths import cache_dir

    folder = cache_dir()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=folder) as stream:
        stream.write(b"pcdbench doctor")
        stream.flush()
        os.fsync(stream.fileno())
    return f"{folder} can be written and synced"


def _numpy() -> str:
    import numpy as np

    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(50, 50))
    _require(np.allclose(matrix @ np.linalg.inv(matrix), np.eye(50)), "a matrix times its inverse is not 1")
    return "a matrix times its inverse is 1"


def _scipy() -> str:
    import numpy as np
    from scipy.spatial import cKDTree

    points = np.random.default_rng(0).random((500, 3))
    found, _ = cKDTree(points[1:]).query(points[0])
    _require(np.isclose(found, np.linalg.norm(points[1:] - points[0], axis=1).min()), "the nearest point is another")
    return "a tree finds the nearest point"


def _open3d() -> str:
    import numpy as np

    from pcdbench.open3d_loader import load_open3d

    open3d = load_open3d()
    points = np.random.default_rng(0).random((400, 3))
    source, target = (
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(its))
        for its in (points, points + np.array([0.01, -0.01, 0]))
    )
    T = open3d.pipelines.registration.registration_icp(source, target, 0.05).transformation
    _require(np.allclose(T[:3, 3], [0.01, -0.01, 0], atol=1e-6), f"ICP moves a pair by {T[:3, 3].round(4).tolist()}")
    return "ICP registers a pair"


def _small_gicp() -> str:
    import numpy as np
    import small_gicp

    moved = _corner() + np.array([0.02, 0.01, -0.02])
    T = small_gicp.align(moved, _corner(), downsampling_resolution=0.05, num_threads=1).T_target_source
    _require(
        np.allclose(T[:3, 3], [0.02, 0.01, -0.02], atol=5e-3), f"GICP moves a pair by {T[:3, 3].round(4).tolist()}"
    )
    return "GICP registers a pair"


def _kiss_icp() -> str:
    import numpy as np
    from kiss_icp.config import load_config
    from kiss_icp.kiss_icp import KissICP

    config = load_config(None)
    config.data.max_range, config.data.min_range, config.data.deskew = 10.0, 0.1, False
    config.mapping.voxel_size = 0.05
    config.registration.max_num_threads = 1
    odometry = KissICP(config)
    for points in (_corner(), _corner() - np.array([0.02, 0.0, 0.0])):
        odometry.register_frame(points, np.zeros(len(points)))
    moved = odometry.last_pose[:3, 3]
    _require(np.allclose(moved, [0.02, 0, 0], atol=0.01), f"odometry moves by {moved.round(4).tolist()}")
    return "odometry follows two scans"


def _scikit_image() -> str:
    import numpy as np
    from skimage.metrics import structural_similarity

    rng = np.random.default_rng(0)
    image = rng.random((32, 32))
    same, other = (structural_similarity(image, its, data_range=1.0) for its in (image, rng.random((32, 32))))
    _require(np.isclose(same, 1) and other < 0.5, f"SSIM of an image with itself is {same:.3f}, with noise {other:.3f}")
    return "SSIM tells an image from noise"


def _torch() -> str:
    import numpy as np
    import torch

    from pcdbench.threads import thread_count

    torch.set_num_threads(thread_count())
    rng = np.random.default_rng(0)
    left, right = rng.normal(size=(64, 64)), rng.normal(size=(64, 64))
    image, kernel = rng.normal(size=(1, 1, 8, 8, 8)), rng.normal(size=(1, 1, 3, 3, 3))
    windows = np.lib.stride_tricks.sliding_window_view(image[0, 0], (3, 3, 3))
    convolved = (windows * kernel[0, 0]).sum(axis=(3, 4, 5))
    devices = ["cpu", *(f"cuda:{index}" for index in range(torch.cuda.device_count()))]
    for device in devices:
        tensors = [torch.tensor(its, dtype=torch.float32, device=device) for its in (left, right, image, kernel)]
        product = torch.matmul(tensors[0], tensors[1]).cpu().numpy()
        filtered = torch.nn.functional.conv3d(tensors[2], tensors[3]).cpu().numpy()
        _require(np.allclose(product, left @ right, atol=0.1), f"a matrix product is wrong on {device}")
        _require(np.allclose(filtered[0, 0], convolved, atol=0.1), f"a convolution is wrong on {device}")
    return f"matrix products and convolutions are right on {', '.join(devices)}"


def _laspy() -> str:
    return _round_trip(".laz")


def _pye57() -> str:
    return _round_trip(".e57")


def _pandas() -> str:
    import pandas

    table = pandas.DataFrame({"name": ["a", "b", "a"], "value": [1.0, 5.0, 3.0]})
    medians = table.groupby("name")["value"].median().to_dict()
    _require(medians == {"a": 2.0, "b": 5.0}, f"medians of groups are {medians}")
    return "medians of groups are right"


def _matplotlib() -> str:
    import io

    from matplotlib.figure import Figure

    figure = Figure(figsize=(2, 2))
    figure.subplots().plot([0, 1], [1, 0])
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    _require(stream.getvalue().startswith(b"\x89PNG"), "a figure is no PNG")
    return "a figure is drawn"


def _filelock() -> str:
    from filelock import FileLock, Timeout

    with tempfile.TemporaryDirectory() as folder:
        with FileLock(Path(folder, "lock")):
            try:
                FileLock(Path(folder, "lock")).acquire(timeout=0)
            except Timeout:
                return "a lock is held once"
        raise ValueError("a lock can be held twice")


def _pebble() -> str:
    import multiprocessing

    from pebble import ProcessPool

    with ProcessPool(1, context=multiprocessing.get_context("spawn")) as pool:
        _require(pool.schedule(pow, args=(2, 10)).result(timeout=60) == 1024, "a worker process miscounts")
    return "a worker process answers"


def _safetensors() -> str:
    import numpy as np
    from safetensors.numpy import load, save

    tensors = {"weight": np.arange(6, dtype=np.float32).reshape(2, 3)}
    _require(np.array_equal(load(save(tensors))["weight"], tensors["weight"]), "weights come back as others")
    return "weights come back as they were"


def _round_trip(extension: str) -> str:
    """A coloured cloud in map coordinates is written and read again."""
    import numpy as np

    from pcdbench.cloud import PointCloud

    rng = np.random.default_rng(0)
    points = rng.random((200, 3)) + np.array([4e5, 5e6, 100.0])
    colors = (rng.integers(0, 256, (200, 3)) / 255).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"cloud{extension}")
        PointCloud(points, colors).write(path)
        read = PointCloud.read(path)
    _require(np.allclose(read.points, points, rtol=0, atol=1e-4), "points come back elsewhere")
    _require(read.colors is not None and np.abs(read.colors - colors).max() < 1e-3, "colours come back as others")
    return f"a cloud survives {extension[1:].upper()}"


def _corner() -> NDArray[np.float64]:
    """(N, 3) points of three faces of a box, on a grid."""
    import numpy as np

    steps = np.arange(0.0, 2.0, 0.05)
    first, second = (its.ravel() for its in np.meshgrid(steps, steps))
    flat = np.zeros_like(first)
    faces = [(first, second, flat), (first, flat, second), (flat, first, second)]
    return np.concatenate([np.stack(face, axis=1) for face in faces]) + 0.5


def _require(holds: bool, problem: str) -> None:
    if not holds:
        raise ValueError(problem)


CHECKS: dict[str, Check] = {
    "cache folder": _cache,
    "numpy": _numpy,
    "scipy": _scipy,
    "pandas": _pandas,
    "matplotlib": _matplotlib,
    "scikit-image": _scikit_image,
    "laspy": _laspy,
    "pye57": _pye57,
    "filelock": _filelock,
    "pebble": _pebble,
    "small-gicp": _small_gicp,
    "kiss-icp": _kiss_icp,
    "safetensors": _safetensors,
    "open3d": _open3d,
    "torch": _torch,
}


def outcome(name: str) -> dict[str, str | bool]:
    """How a check ended: a self-test of that name, else the import of the distribution's modules."""
    try:
        return {"name": name, "ok": True, "message": CHECKS[name]() if name in CHECKS else _imported(name)}
    except BaseException as error:
        # Whatever a broken installation raises, the exit of its process included.
        reason = " ".join(str(error).split())[:300] or type(error).__name__
        return {"name": name, "ok": False, "message": reason}


def _imported(distribution: str) -> str:
    from pcdbench.doctor.installation import modules_of

    for module in modules_of(distribution):
        importlib.import_module(module)
    return "can be imported"


def main() -> None:
    """Answer for the checks named in the arguments, on what was standard output; libraries' own prints go elsewhere."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for name in sys.argv[1:]:
        answers.write(json.dumps(outcome(name)) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
