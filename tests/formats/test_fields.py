"""Further fields of each point, and coordinates kept to the last bit."""

import numpy as np
import pytest

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats import EXTENSIONS, carries_fields, read_cloud, read_fields, write_cloud

WITH_FIELDS = [extension for extension in EXTENSIONS if extension != ".e57"]


def marked(count=200, offset=0.0, color=True):
    rng = np.random.default_rng(3)
    points = np.float32(rng.uniform(-4, 4, (count, 3))).astype(np.float64) + offset
    colors = np.float32(rng.integers(0, 256, (count, 3)) / np.float32(255)) if color else None
    fields = {"added": rng.random(count) < 0.3, "confidence": np.float32(rng.integers(0, 10_000, count) / 1e4)}
    return PointCloud(points, colors), fields


@pytest.mark.parametrize("color", [True, False])
@pytest.mark.parametrize("extension", WITH_FIELDS)
def test_fields_come_back(tmp_path, extension, color):
    cloud, fields = marked(color=color)
    write_cloud(cloud, tmp_path / f"a{extension}", fields)
    back = read_fields(tmp_path / f"a{extension}")
    assert set(back) == {"added", "confidence"}
    np.testing.assert_array_equal(back["added"], fields["added"])
    np.testing.assert_allclose(back["confidence"], fields["confidence"], atol=1e-6)
    again = read_cloud(tmp_path / f"a{extension}")
    np.testing.assert_allclose(again.points, cloud.points, atol=1e-4)
    assert (again.colors is not None) == color
    if color:
        np.testing.assert_allclose(again.colors, cloud.colors, atol=1e-6)


@pytest.mark.parametrize("extension", WITH_FIELDS)
def test_files_without_fields_have_none(tmp_path, extension):
    cloud, _ = marked()
    write_cloud(cloud, tmp_path / f"a{extension}")
    assert read_fields(tmp_path / f"a{extension}") == {}


def test_e57_says_that_it_has_no_fields(tmp_path):
    cloud, fields = marked()
    assert not carries_fields(tmp_path / "a.E57") and carries_fields(tmp_path / "a.laz")
    with pytest.raises(CloudError, match=r"a\.e57: \.e57 files cannot hold added, confidence; write PLY"):
        write_cloud(cloud, tmp_path / "a.e57", fields)
    assert not list(tmp_path.iterdir())
    write_cloud(cloud, tmp_path / "a.e57")
    with pytest.raises(CloudError, match="coordinates and colours alone"):
        read_fields(tmp_path / "a.e57")


def test_other_programs_fields_are_read(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float nx\nproperty float y\n"
        "property float z\nproperty uchar label\nend_header\n1 0.5 2 3 7\n4 -0.5 5 6 8\n"
    )
    fields = read_fields(tmp_path / "a.ply")
    assert fields["nx"].tolist() == [0.5, -0.5] and fields["label"].tolist() == [7, 8] and len(fields) == 2
    (tmp_path / "a.csv").write_text("x;y;z;Scalar\n1;2;3;0.25\n")
    assert read_fields(tmp_path / "a.csv")["Scalar"].tolist() == [0.25]


@pytest.mark.parametrize("offset", [0.0, 1_234_567.125])
@pytest.mark.parametrize("extension", [".ply", ".pcd", ".npz"])
def test_exact_means_to_the_last_bit(tmp_path, extension, offset):
    rng = np.random.default_rng(0)
    cloud = PointCloud(rng.uniform(-4, 4, (300, 3)) + offset)
    write_cloud(cloud, tmp_path / f"a{extension}", exact=True)
    np.testing.assert_array_equal(read_cloud(tmp_path / f"a{extension}").points, cloud.points)


@pytest.mark.parametrize(("extension", "decimals"), [(".xyz", 9), (".csv", 9), (".las", 6), (".laz", 4)])
def test_exact_keeps_decimals(tmp_path, extension, decimals):
    cloud = PointCloud(np.round(np.random.default_rng(0).uniform(-4, 4, (300, 3)), decimals))
    write_cloud(cloud, tmp_path / f"a{extension}", exact=True)
    np.testing.assert_allclose(read_cloud(tmp_path / f"a{extension}").points, cloud.points, atol=1e-12)


def test_exact_float_input_stays_float(tmp_path):
    cloud, _ = marked()
    write_cloud(cloud, tmp_path / "a.ply", exact=True)
    assert b"property float x" in (tmp_path / "a.ply").read_bytes()[:200]
