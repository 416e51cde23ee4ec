"""Every format keeps what it is given: millimetres at map coordinates, 8-bit colours exactly."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats import EXTENSIONS, CloudWarning, read_cloud, write_cloud

REAL = Path(os.environ.get("PCDBENCH_REAL_DATA", Path(__file__).parents[3] / "shared/data/real"))


def made_cloud(count=300, offset=(0.0, 0.0, 0.0), color=True, seed=0):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-3, 3, (count, 3)) + np.array(offset)
    colors = rng.integers(0, 256, (count, 3)).astype(np.uint8)
    colors[0] = (0, 128, 255)
    return PointCloud(points, colors.astype(np.float32) / np.float32(255) if color else None)


def assert_same(cloud, again, tolerance_m=6e-5):
    np.testing.assert_allclose(again.points, cloud.points, rtol=0, atol=tolerance_m)
    if cloud.colors is None:
        assert again.colors is None
    else:
        np.testing.assert_array_equal(again.colors, cloud.colors)


@pytest.mark.parametrize("extension", EXTENSIONS)
@pytest.mark.parametrize("color", [True, False])
@pytest.mark.parametrize("offset", [(0, 0, 0), (1.2e6, 7.6e6, 512.0), (-4e6, 10.0, -2.0)])
def test_round_trip(tmp_path, extension, color, offset):
    cloud = made_cloud(offset=offset, color=color)
    write_cloud(cloud, tmp_path / f"room{extension}")
    assert_same(cloud, read_cloud(tmp_path / f"room{extension}"))
    assert [path.name for path in tmp_path.iterdir()] == [f"room{extension}"]


@settings(max_examples=15, deadline=None)
@given(
    extension=st.sampled_from(EXTENSIONS),
    count=st.integers(1, 40),
    offset=st.tuples(*[st.floats(-9e6, 9e6)] * 3),
    color=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_round_trip_of_any_cloud(tmp_path_factory, extension, count, offset, color, seed):
    path = tmp_path_factory.mktemp("any") / f"any{extension}"
    cloud = made_cloud(count, offset, color, seed)
    cloud.write(path)
    assert_same(cloud, PointCloud.read(path))


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_every_8_bit_color_survives(tmp_path, extension):
    colors = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1) / np.float32(255)
    cloud = PointCloud(np.arange(768.0).reshape(256, 3), colors)
    write_cloud(cloud, tmp_path / f"gray{extension}")
    np.testing.assert_array_equal(read_cloud(tmp_path / f"gray{extension}").colors, cloud.colors)


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_one_point(tmp_path, extension):
    cloud = PointCloud([[1.5, 2.5, 3.5]], [[0.0, 1.0, 0.2]])
    write_cloud(cloud, tmp_path / f"one{extension}")
    assert_same(cloud, read_cloud(tmp_path / f"one{extension}"))


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_real_scan_to_every_format_and_back(tmp_path, extension):
    source = REAL / "offices/rooms/office_a_room01.ply"
    if not source.exists():
        pytest.skip("the real scans are not here (PCDBENCH_REAL_DATA)")
    cloud = read_cloud(source)
    assert cloud.colors is not None and len(cloud) > 10_000
    write_cloud(cloud, tmp_path / f"room{extension}")
    assert_same(cloud, read_cloud(tmp_path / f"room{extension}"))


def test_every_real_ply_agrees_with_open3d():
    files = sorted(REAL.rglob("*.ply"))
    if not files:
        pytest.skip("the real scans are not here (PCDBENCH_REAL_DATA)")
    from pcdbench.open3d_loader import load_open3d

    open3d = load_open3d()
    for path in files:
        ours, theirs = read_cloud(path), open3d.io.read_point_cloud(str(path))
        np.testing.assert_array_equal(ours.points, np.asarray(theirs.points))
        if ours.colors is None:
            assert not theirs.has_colors()
        else:
            np.testing.assert_allclose(ours.colors, np.asarray(theirs.colors), atol=1e-6)


@pytest.mark.parametrize("extension", [".ply", ".pcd"])
def test_open3d_reads_what_is_written(tmp_path, extension):
    from pcdbench.open3d_loader import load_open3d

    cloud = made_cloud()
    write_cloud(cloud, tmp_path / f"room{extension}")
    theirs = load_open3d().io.read_point_cloud(str(tmp_path / f"room{extension}"))
    np.testing.assert_allclose(np.asarray(theirs.points), cloud.points, atol=1e-6)
    np.testing.assert_allclose(np.asarray(theirs.colors), cloud.colors, atol=1e-6)


@pytest.mark.parametrize("extension", [".ply", ".pcd"])
def test_double_only_where_single_precision_would_lose(tmp_path, extension):
    write_cloud(made_cloud(1000, color=False), tmp_path / f"near{extension}")
    write_cloud(made_cloud(1000, (1e6, 0, 0), color=False), tmp_path / f"far{extension}")
    near, far = ((tmp_path / f"{name}{extension}").stat().st_size for name in ("near", "far"))
    assert near < 12_500 and far > 24_000


@pytest.mark.parametrize("extension", [".ply", ".pcd", ".xyz", ".npz", ".las", ".e57"])
def test_invalid_rows_are_dropped_and_counted(tmp_path, extension):
    path = tmp_path / f"scan{extension}"
    write_with_invalid_rows(path)
    with pytest.warns(CloudWarning, match="3 of 10 points are not valid") as caught:
        cloud = read_cloud(path)
    assert len(caught) == 1 and "\n" not in str(caught[0].message) and str(path) in str(caught[0].message)
    np.testing.assert_allclose(cloud.points[:, 0], [1, 2, 4, 5, 6, 8, 9], atol=1e-4)
    assert cloud.colors is None


def write_with_invalid_rows(path):
    points = np.repeat(np.arange(10.0)[:, None], 3, axis=1)
    points[0, 0], points[3, 1], points[7, 2] = np.nan, np.inf, 1e30
    text = "\n".join(" ".join(map(repr, row)) for row in points.tolist()) + "\n"
    header = b"element vertex 10\nproperty double x\nproperty double y\nproperty double z\nend_header\n"
    match path.suffix:
        case ".ply":
            path.write_bytes(b"ply\nformat binary_little_endian 1.0\n" + header + points.tobytes())
        case ".pcd":
            path.write_text("FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 10\nHEIGHT 1\nPOINTS 10\nDATA ascii\n" + text)
        case ".xyz":
            path.write_text(text)
        case ".npz":
            np.savez(path, points=points)
        case ".las":
            import laspy

            # LAS has whole numbers and no NaN: one axis' scale blown up makes some of its points absurd.
            header = laspy.LasHeader(version="1.2", point_format=0)
            header.scales = [1e-3, 1e-3, 1e3]
            las = laspy.LasData(header)
            las.X, las.Y = [np.arange(10) * 1000] * 2
            las.Z = np.where(np.isin(np.arange(10), (0, 3, 7)), 2**30, 0)
            las.write(path)
        case ".e57":
            import pye57

            file = pye57.E57(str(path), mode="w")
            x = np.arange(10.0)
            state = np.isin(x, (0, 3, 7)).astype(np.int8)
            file.write_scan_raw({"cartesianX": x, "cartesianY": x, "cartesianZ": x, "cartesianInvalidState": state})
            file.close()


def test_all_invalid_is_refused(tmp_path):
    (tmp_path / "nan.xyz").write_text("nan nan nan\nnan 1 2\n")
    with pytest.raises(CloudError, match=r"nan\.xyz: none of its 2 points"):
        read_cloud(tmp_path / "nan.xyz")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing.ply", "no such file"),
        ("folder.ply", "is a folder"),
        ("room.docx", r"\.docx is not a format; use one of \.ply"),
        ("room", "without an extension"),
        ("room.obj", "is for meshes"),
        ("empty.ply", r"is empty \(0 bytes\)"),
        ("a" * 300 + ".ply", "cannot be read: File name too long; check the path"),
    ],
)
def test_wrong_places_are_named(tmp_path, name, message):
    (tmp_path / "folder.ply").mkdir()
    (tmp_path / "empty.ply").touch()
    with pytest.raises(CloudError, match=message) as caught:
        read_cloud(tmp_path / name)
    assert name in str(caught.value) and "\n" not in str(caught.value)


def test_uppercase_extensions_are_known(tmp_path):
    write_cloud(made_cloud(), tmp_path / "ROOM.PLY")
    assert len(read_cloud(tmp_path / "ROOM.PLY")) == 300


def test_writing_makes_the_folder_and_replaces_the_file(tmp_path):
    path = tmp_path / "a/b/room.ply"
    write_cloud(made_cloud(10), path)
    write_cloud(made_cloud(20), path)
    assert len(read_cloud(path)) == 20


def test_failed_writing_leaves_the_old_file(tmp_path, monkeypatch):
    from pcdbench.formats import ply

    path = tmp_path / "room.ply"
    write_cloud(made_cloud(10), path)

    def break_down(cloud, path, fields, exact, like):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(ply, "write", break_down)
    with pytest.raises(CloudError, match=r"room\.ply cannot be written: No space left on device"):
        write_cloud(made_cloud(20), path)
    assert len(read_cloud(path)) == 10
    assert [found.name for found in tmp_path.iterdir()] == ["room.ply"]


@pytest.mark.parametrize("name", ["room.ply", "room.pcd"])
def test_a_disk_that_fills_while_a_cloud_is_written_is_named(tmp_path, name):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, limits[1]))
    try:
        with pytest.raises(CloudError, match=rf"{name} cannot be written: File too large"):
            write_cloud(made_cloud(6000), tmp_path / name)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


def test_unwritable_places_are_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(CloudError, match="cannot be written"):
        write_cloud(made_cloud(), tmp_path / "file" / "room.ply")
    with pytest.raises(CloudError, match=r"a\.ply cannot be written: File name too long"):
        write_cloud(made_cloud(), tmp_path / ("a" * 300 + ".ply"))
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(CloudError, match="is a folder"):
        write_cloud(made_cloud(), tmp_path / "folder.ply")
    with pytest.raises(CloudError, match="no points"):
        write_cloud(PointCloud(np.empty((0, 3))), tmp_path / "none.ply")


def test_importing_costs_no_heavy_library():
    code = (
        "import sys, pcdbench.formats, pcdbench.formats.las, pcdbench.formats.e57, pcdbench.datasets.clouds;"
        "print({'open3d', 'laspy', 'pye57', 'torch', 'pandas'} & set(sys.modules))"
    )
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "set()"
