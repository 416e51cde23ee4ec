"""Mutations of valid files of every format: a CloudError that names the file, or a valid cloud, and nothing else."""

import warnings

import numpy as np
import pytest

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats import EXTENSIONS, read_cloud, write_cloud

# Native parsers are in here too (LAZ by lazrs, E57 by libe57): a crash of theirs would end this test run.
MUTATIONS = 120


def valid_bytes(path, variant):
    rng = np.random.default_rng(5)
    cloud = PointCloud(rng.uniform(0, 5, (150, 3)), rng.integers(0, 256, (150, 3)) / np.float32(255))
    if variant == "ascii" and path.suffix == ".ply":
        rows = "".join(f"{x} {y} {z}\n" for x, y, z in cloud.points[:60])
        header = "element vertex 60\n" + "".join(f"property float {name}\n" for name in "xyz")
        path.write_text(f"ply\nformat ascii 1.0\n{header}end_header\n{rows}")
    elif variant == "ascii" and path.suffix == ".pcd":
        rows = "".join(f"{x} {y} {z}\n" for x, y, z in cloud.points[:60])
        path.write_text(f"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nPOINTS 60\nDATA ascii\n{rows}")
    elif variant == "compressed":
        from pcdbench.open3d_loader import load_open3d

        open3d = load_open3d()
        theirs = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.round(cloud.points, 1)))
        open3d.io.write_point_cloud(str(path), theirs, compressed=True)
    elif variant == "lists":
        header = "element face 5\nproperty list uchar int vertex_indices\nelement vertex 30\n"
        header += "".join(f"property double {name}\n" for name in "xyz")
        body = (b"\3" + bytes(12)) * 5 + cloud.points[:30].astype(">f8").tobytes()
        path.write_bytes(f"ply\nformat binary_big_endian 1.0\n{header}end_header\n".encode() + body)
    else:
        write_cloud(cloud, path)
    assert len(read_cloud(path)) >= 30
    return path.read_bytes()


def mutated(data, rng):
    kind = rng.integers(5)
    changed = bytearray(data)
    start = int(rng.integers(len(data)))
    # Headers decide most: every second change hits the first 400 bytes.
    place = int(rng.integers(min(400, len(data)))) if rng.random() < 0.5 else start
    match kind:
        case 0:
            return data[:start]
        case 1:
            changed[place] ^= 1 << int(rng.integers(8))
        case 2:
            for offset in range(int(rng.integers(1, 9))):
                changed[(place + offset) % len(data)] = int(rng.integers(256))
        case 3:
            del changed[place : place + int(rng.integers(1, 40))]
        case _:
            changed[place : place + 4] = bytes([int(rng.choice([0, 255, 127, 128, ord("9"), ord("-")]))]) * 4
    return bytes(changed)


@pytest.mark.parametrize(
    ("extension", "variant"),
    [
        *[(extension, "as written") for extension in EXTENSIONS],
        (".ply", "ascii"),
        (".ply", "lists"),
        (".pcd", "ascii"),
        (".pcd", "compressed"),
    ],
)
def test_mutated_files(tmp_path, extension, variant):
    path = tmp_path / f"scan{extension}"
    data = valid_bytes(path, variant)
    rng = np.random.default_rng(list(f"{extension} {variant}".encode()))
    refused = 0
    for _ in range(MUTATIONS):
        path.write_bytes(mutated(data, rng))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                cloud = read_cloud(path)
            assert len(cloud) and np.isfinite(cloud.points).all()
        except CloudError as error:
            assert path.name in str(error) and "\n" not in str(error)
            refused += 1
        # pye57 deletes files that it fails to write; a file that was read must stay.
        assert path.exists()
    assert refused >= MUTATIONS // 10


@pytest.mark.parametrize("extension", EXTENSIONS)
@pytest.mark.parametrize("seed", range(3))
def test_garbage(tmp_path, extension, seed):
    path = tmp_path / f"garbage{extension}"
    path.write_bytes(np.random.default_rng(seed).bytes(5000))
    with pytest.raises(CloudError, match=rf"garbage\{extension}"):
        read_cloud(path)


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_every_prefix_of_a_header(tmp_path, extension):
    path = tmp_path / f"scan{extension}"
    data = valid_bytes(path, "as written")
    for length in range(1, 500, 7):
        path.write_bytes(data[:length])
        try:
            assert len(read_cloud(path))
            assert extension in (".xyz", ".txt", ".csv", ".asc", ".pts")
        except CloudError as error:
            assert path.name in str(error)
