"""Valid files to mutate: of every format, in every variant that its reader knows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pcdbench.cloud import PointCloud
from pcdbench.formats import write_cloud

_COUNT = 150


def valid_clouds(folder: Path) -> list[Path]:
    """Clouds of every format and variant, written into a folder."""
    rng = np.random.default_rng(5)
    points = rng.uniform(0, 5, (_COUNT, 3)).round(2)
    cloud = PointCloud(points, rng.integers(0, 256, (_COUNT, 3)) / np.float32(255))
    fields = {"added": rng.random(_COUNT) < 0.5, "confidence": rng.random(_COUNT).astype(np.float32)}
    for extension in (".ply", ".pcd", ".xyz", ".csv", ".las", ".laz", ".npz"):
        write_cloud(cloud, folder / f"fields{extension}", fields)
    for extension in (".ply", ".pcd", ".txt", ".asc", ".las", ".laz", ".e57", ".npz"):
        write_cloud(PointCloud(points), folder / f"plain{extension}")
    write_cloud(cloud, folder / "colored.e57")
    _write_texts(folder, points)
    _write_lists(folder, points)
    _write_packed_pcd(folder, points)
    _write_layered_laz(folder, points)
    _write_spherical_e57(folder, points)
    return sorted(folder.iterdir())


def _write_texts(folder: Path, points: np.ndarray) -> None:
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in points[:40])
    header = "element vertex 40\n" + "".join(f"property float {name}\n" for name in "xyz")
    (folder / "ascii.ply").write_text(f"ply\nformat ascii 1.0\ncomment one\n{header}end_header\n{rows}")
    header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nPOINTS 40\nDATA ascii\n"
    (folder / "ascii.pcd").write_text(header + rows)
    (folder / "counted.xyz").write_text("40\n" + rows)
    (folder / "named.csv").write_text("// x;y;z;note\n" + rows.replace("\n", " 1\n").replace(" ", ";"))


def _write_lists(folder: Path, points: np.ndarray) -> None:
    header = "element face 5\nproperty list uchar int vertex_indices\nelement vertex 30\n"
    header += "".join(f"property double {name}\n" for name in "xyz") + "property list int uchar seen\n"
    body = (b"\3" + bytes(12)) * 5
    body += b"".join(point.astype(">f8").tobytes() + b"\0\0\0\2ab" for point in points[:30])
    (folder / "lists.ply").write_bytes(f"ply\nformat binary_big_endian 1.0\n{header}end_header\n".encode() + body)


def _write_packed_pcd(folder: Path, points: np.ndarray) -> None:
    """LZF of literal runs and of one long reference: PCL's binary_compressed."""
    data = points[:30].astype("<f4").T.tobytes() + bytes(120)
    literal = data[:-119]
    packed = b"".join(bytes([len(part) - 1]) + part for part in _parts(literal, 32)) + bytes([7 << 5, 119 - 9, 0])
    header = "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 30\nHEIGHT 1\nPOINTS 30\n"
    sizes = np.array([len(packed), len(data)], "<u4").tobytes()
    (folder / "packed.pcd").write_bytes(f"{header}DATA binary_compressed\n".encode() + sizes + packed)


def _parts(data: bytes, length: int) -> list[bytes]:
    return [data[start : start + length] for start in range(0, len(data), length)]


def _write_layered_laz(folder: Path, points: np.ndarray) -> None:
    """LAS 1.4 with colours and an extra dimension, as it is and compressed in layers."""
    import laspy

    header = laspy.LasHeader(version="1.4", point_format=7)
    header.scales, header.offsets = np.full(3, 0.001), np.zeros(3)
    header.add_extra_dim(laspy.ExtraBytesParams("height", np.float32))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.red = las.green = las.blue = np.arange(len(points), dtype=np.uint16) * 256
    las["height"] = points[:, 2].astype(np.float32)
    las.write(folder / "layered.las")
    las.write(folder / "layered.laz", laz_backend=laspy.LazBackend.Lazrs)


def _write_spherical_e57(folder: Path, points: np.ndarray) -> None:
    """Scaled whole numbers and spherical coordinates with marked points: what scanners write."""
    import pye57
    from pye57 import libe57

    image = pye57.E57(str(folder / "spherical.e57"), mode="w")
    file = image.image_file
    prototype = libe57.StructureNode(file)
    for name in ("sphericalRange", "sphericalAzimuth", "sphericalElevation"):
        prototype.set(name, libe57.ScaledIntegerNode(file, 0, -(2**20), 2**20, 1e-4, 0.0))
    prototype.set("sphericalInvalidState", libe57.IntegerNode(file, 0, 0, 2))
    scan = libe57.StructureNode(file)
    scan.set("guid", libe57.StringNode(file, "{0}"))
    vector = libe57.CompressedVectorNode(file, prototype, libe57.VectorNode(file, True))
    scan.set("points", vector)
    image.data3d.append(scan)
    columns = {
        "sphericalRange": points[:, 0].copy(),
        "sphericalAzimuth": points[:, 1].copy() / 2,
        "sphericalElevation": points[:, 2].copy() / 5,
        "sphericalInvalidState": (np.arange(len(points)) % 3).astype(np.int16),
    }
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(file, name, column, len(points), True, True))
    writer = vector.writer(buffers)
    writer.write(len(points))
    writer.close()
    image.close()


def valid_boxes(folder: Path) -> list[Path]:
    """Tagged objects, as boxes beside `scan.ply`."""
    boxes = [
        {"label": "chair", "min": [0, 0, 0], "max": [1.5, 1, 1]},
        {"label": "table", "center": [1, 2, 3], "size": [1, 1, 1], "yaw_rad": 0.5},
    ]
    (folder / "list.boxes.json").write_text(json.dumps(boxes))
    (folder / "instances.boxes.json").write_text(json.dumps({"instances": boxes}))
    (folder / "named.boxes.json").write_text(json.dumps({"scan.ply": {"instances": boxes}}))
    return sorted(folder.iterdir())


def valid_run(folder: Path) -> list[Path]:
    """A run of two completers, one of which failed once."""
    described = {"name": "holes", "version": "1", "options": {}}
    rows = []
    for number, (completer, status) in enumerate([("incomplete", "ok"), ("mine", "ok"), ("mine", "failed")]):
        meaning = {"unit": "m", "direction": "lower", "summary": "mean", "main": True}
        row = {
            "schema_version": 1,
            "key": f"{number:064}",
            "cell": f"{number:064}",
            "scene": f"room_{number}",
            "draw": 0,
            "incompleteness": described,
            "level": 0.3,
            "completer": described | {"name": completer, "reference": completer == "incomplete"},
            "task": described | {"name": "chamfer"},
            "status": status,
            "error": None if status == "ok" else "it broke",
            "missing": 0.3,
            "metrics": {"chd": meaning | {"samples": [0.25, 1e-4]}} if status == "ok" else {},
            "trace": {},
            "completing": {"seconds": 1.5, "peak_memory_mb": 20.0} if status == "ok" else None,
        }
        rows.append(json.dumps(row) + "\n")
    (folder / "rows.jsonl").write_text("".join(rows))
    (folder / "run.json").write_text(json.dumps({"schema_version": 1, "configuration": {"seed": 0}}, indent=2))
    return sorted(folder.iterdir())


def valid_suite(folder: Path) -> list[Path]:
    """A suite that says everything that a suite can say, beside a scan."""
    points = np.random.default_rng(5).uniform(0, 5, (_COUNT, 3)).round(2)
    (folder / "scan.xyz").write_text("".join(f"{x} {y} {z}\n" for x, y, z in points))
    (folder / "suite.toml").write_text(
        """# all of it
dataset = { name = "clouds", path = "scan.xyz", options = { draws = 2 } }
split = "all"
incompletenesses = ["holes", { name = "short_scan" }]
levels = [0.1, 0.5]
seeds = [0, 7]
references = true
completers = ["plane_fitting", { name = "plane_fitting", options = { distance_m = 0.03 } }]
tasks = ["chamfer"]

[check]
scenes = ["scan"]
levels = [0.5]
completers = ["plane_fitting"]
"""
    )
    return [folder / "suite.toml"]


def valid_build(folder: Path) -> list[Path]:
    """A run that a board can be made of: two completers, one of them trained, on four scenes."""
    dataset = {"name": "rooms", "version": "1", "options": {"draws": 1}}
    trained = {"name": "mine", "version": "2", "options": {"grid": 5}, "weights": "0" * 64}
    completers = [{"name": "incomplete", "version": "1", "options": {}, "weights": None}, trained]
    meaning = {"unit": "m", "direction": "lower", "summary": "mean", "main": True}
    rows = []
    for number in range(8):
        completer = completers[number % 2]
        status = "failed" if number == 7 else "ok"
        row = {
            "schema_version": 1,
            "key": f"{number:064}",
            "cell": f"{number:064}",
            "dataset": dataset | {"digest": f"{number // 2:064}"},
            "scene": f"room_{number // 2}",
            "draw": 0,
            "incompleteness": {"name": "holes", "version": "1", "options": {}},
            "level": 0.3,
            "completer": completer | {"reference": completer["name"] == "incomplete"},
            "task": {"name": "chamfer", "version": "1", "options": {}},
            "status": status,
            "error": None if status == "ok" else "it broke",
            "missing": 0.3,
            "metrics": {"chd": meaning | {"samples": [0.25 / (number + 1), 1e-4]}} if status == "ok" else {},
            "trace": {},
            "completing": {"seconds": 1.5, "peak_memory_mb": 20.0} if status == "ok" else None,
            "host": "here",
            "time": "2026-01-01T00:00:00Z",
        }
        rows.append(json.dumps(row) + "\n")
    seen = [{"dataset": "rooms", "split": "train"}, {"dataset": "rooms", "scenes": ["room_1"]}]
    configuration = {
        "split": "test",
        "seed": 0,
        "dataset": dataset,
        "completers": [completers[0], trained | {"card": {"trained_on": seen}}],
    }
    facts = {
        "schema_version": 1,
        "configuration": configuration,
        "time": "2026-01-01T00:00:00Z",
        "calibration_seconds": 1.5,
        "machine": {"cpu": "a processor", "cores": 2},
        "git": {"commit": "0" * 40},
        "dataset_path": "/scans",
    }
    (folder / "rows.jsonl").write_text("".join(rows))
    (folder / "run.json").write_text(json.dumps(facts, indent=2))
    return sorted(folder.iterdir())


def valid_board(folder: Path) -> list[Path]:
    """A board, beside a copy that no mutation reaches."""
    from pcdbench.leaderboard.board_file import write_board
    from pcdbench.leaderboard.building import board_of_runs

    run = folder / "run"
    run.mkdir()
    valid_build(run)
    for name in ("leaderboard.json", "sound.json"):
        write_board(board_of_runs("fuzzed", [run]), folder / name)
    return [folder / "leaderboard.json"]


def valid_sequences(folder: Path) -> list[Path]:
    """The text files of posed RGB-D in three layouts; the images themselves are empty, as nobody opens them here."""
    tum, rtabmap, scannet = (folder / name for name in ("tum", "rtabmap", "scannet"))
    for part in (
        tum,
        *(rtabmap / its for its in ("depth", "calib", "rgb")),
        *(scannet / its for its in ("depth", "pose")),
    ):
        part.mkdir(parents=True)
    (scannet / "intrinsic").mkdir()
    times = [f"{1.5 + 0.1 * number:.6f}" for number in range(5)]
    (tum / "rgb.txt").write_text("# time file\n" + "".join(f"{time} rgb/{time}.png\n" for time in times))
    (tum / "depth.txt").write_text("".join(f"{time} depth/{time}.png\n" for time in times))
    (tum / "groundtruth.txt").write_text("".join(f"{time} 0.1 0.2 0.3 0 0 0 1\n" for time in times))
    camera = {"fx": 500.0, "fy": 500.0, "cx": 320, "cy": 240, "width": 640, "height": 480}
    identity = np.eye(4).tolist()
    calibration = {
        "depth": camera | {"scale": 1000},
        "color": camera | {"T_color_depth": identity},
        "T_zup_world": identity,
    }
    (tum / "calibration.json").write_text(json.dumps(calibration))
    (rtabmap / "poses.txt").write_text("".join(f"{number} 0 0 {number} 0 0 0 1 {number}\n" for number in range(3)))
    for number in range(3):
        (rtabmap / "depth" / f"{number}.png").touch()
        (rtabmap / "calib" / f"{number}.yaml").write_text(
            "%YAML:1.0\nimage_width: 640\nimage_height: 480\ncamera_matrix:\n  rows: 3\n"
            "  data: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]\nlocal_transform:\n  rows: 3\n"
            "  data: [ 0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0 ]\n"
        )
        (scannet / "depth" / f"{number}.png").touch()
        (scannet / "pose" / f"{number}.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    (scannet / "intrinsic" / "intrinsic_depth.txt").write_text("500 0 320 0\n0 500 240 0\n0 0 1 0\n0 0 0 1\n")
    return sorted(path for path in folder.rglob("*") if path.suffix in (".txt", ".json", ".yaml"))


def valid_s3dis(folder: Path) -> list[Path]:
    """A room of S3DIS with the stray byte that the data set is known for."""
    rows = [f"{number / 10} 1.5 -2.25 {number} 20 255\n" for number in range(40)]
    (folder / "room.txt").write_bytes("".join(rows).replace("1.5", "1.\x105", 1).encode())
    return sorted(folder.iterdir())


def valid_weights(folder: Path) -> list[Path]:
    """Weights of a tiny network with their card."""
    import torch
    from safetensors.torch import save_file

    network = torch.nn.Linear(3, 2)
    save_file(network.state_dict(), folder / "net.safetensors")
    digest = hashlib.sha256((folder / "net.safetensors").read_bytes()).hexdigest()
    (folder / "net.card.json").write_text(json.dumps({"completer": "net", "sha256": digest}))
    save_file(network.state_dict(), folder / "alone.safetensors")
    return sorted(folder.iterdir())


def valid_checkpoint(folder: Path) -> list[Path]:
    """A checkpoint of a tiny network after one step."""
    import torch

    from pcdbench.training.checkpoint import save_checkpoint

    network = torch.nn.Linear(3, 2)
    optimizer = torch.optim.Adam(network.parameters())
    network(torch.ones(1, 3)).sum().backward()
    optimizer.step()
    average = {name: value.clone() for name, value in network.state_dict().items()}
    save_checkpoint(folder / "checkpoint.safetensors", network, average, optimizer, {"step": 1, "seconds": 2.5})
    return sorted(folder.iterdir())


# By target of fuzz_child: what writes valid files of it into a folder.
SEEDS: dict[str, Callable[[Path], list[Path]]] = {
    "cloud": valid_clouds,
    "boxes": valid_boxes,
    "run": valid_run,
    "suite": valid_suite,
    "board": valid_board,
    "build": valid_build,
    "sequence": valid_sequences,
    "s3dis": valid_s3dis,
    "weights": valid_weights,
    "checkpoint": valid_checkpoint,
}
