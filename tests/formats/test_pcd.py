"""PCD as PCL writes it: three kinds of data, packed colours, fields of several types and counts."""

import struct

import numpy as np
import pytest

from pcdbench.errors import CloudError
from pcdbench.formats import read_cloud, read_cloud_and_fields, write_cloud
from pcdbench.open3d_loader import load_open3d

BYTES = np.array([[255, 0, 51], [1, 2, 3], [128, 64, 32]], dtype=np.uint8)
PACKED = (BYTES.astype(np.uint32) << [16, 8, 0]).sum(axis=1, dtype=np.uint32)


def header(fields, sizes, types, count, data, counts=None):
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {types}\n"
        + (f"COUNT {counts}\n" if counts else "")
        + f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {data}\n"
    ).encode()


@pytest.mark.parametrize("kind", ["F", "U"])
@pytest.mark.parametrize("alpha", [0, 0xFF000000])
def test_packed_colors_in_binary(tmp_path, kind, alpha):
    # With alpha set the bits spell NaN as a float; they are colours all the same.
    rows = np.zeros(3, dtype=[("p", "<f4", 3), ("rgb", "<u4")])
    rows["p"], rows["rgb"] = np.arange(9).reshape(3, 3), PACKED | alpha
    (tmp_path / "a.pcd").write_bytes(header("x y z rgb", "4 4 4 4", f"F F F {kind}", 3, "binary") + rows.tobytes())
    cloud = read_cloud(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.points, rows["p"])
    np.testing.assert_array_equal(cloud.colors, BYTES / np.float32(255))


def test_packed_colors_in_ascii(tmp_path):
    floats = PACKED.view(np.float32)
    text = "".join(f"{i} 1234567.8912 {i} {floats[i]:.9g}\n" for i in range(3))
    (tmp_path / "a.pcd").write_bytes(header("x y z rgb", "4 4 4 4", "F F F F", 3, "ascii") + text.encode())
    cloud = read_cloud(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.colors, BYTES / np.float32(255))
    assert (cloud.points[:, 1] == 1234567.8912).all()


def test_whole_numbers_in_ascii_keep_their_digits(tmp_path):
    head = header("x y t n z s", "4 4 8 8 4 8", "F F U I F U", 2, "ascii", "1 1 1 2 1 1")
    rows = "1 2 1700000000000000123 7 -1700000000000000123 3 1.7e18\n4 5 18446744073709551615 8 9 6 9\n"
    (tmp_path / "a.pcd").write_bytes(head + rows.encode())
    cloud, fields = read_cloud_and_fields(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
    assert fields["t"].dtype == np.uint64 and fields["t"].tolist() == [1700000000000000123, 2**64 - 1]
    assert fields["n"].dtype == np.int64 and fields["n"].tolist() == [[7, -1700000000000000123], [8, 9]]
    assert fields["s"].tolist() == [1700000000000000000, 9]


@pytest.mark.parametrize(
    ("said", "written"),
    [
        (b"VIEWPOINT 1.5 -2 0.1 0.5 0.5 0.5 0.5", b"VIEWPOINT 1.5 -2 0.1 0.5 0.5 0.5 0.5\n"),
        (b"VIEWPOINT 1.5 -2", b"VIEWPOINT 0 0 0 1 0 0 0\n"),
        (b"VIEWPOINT here and there 1 0 0 0", b"VIEWPOINT 0 0 0 1 0 0 0\n"),
        (b"#", b"VIEWPOINT 0 0 0 1 0 0 0\n"),
    ],
)
def test_viewpoint_of_another_file(tmp_path, said, written):
    head = header("x y z", "4 4 4", "F F F", 2, "ascii").replace(b"VIEWPOINT 0 0 0 1 0 0 0", said)
    (tmp_path / "a.pcd").write_bytes(head + b"1 2 3\n4 5 6\n")
    write_cloud(read_cloud(tmp_path / "a.pcd"), tmp_path / "b.pcd", like=tmp_path / "a.pcd")
    assert written in (tmp_path / "b.pcd").read_bytes()


def test_separate_colors_padding_and_counts(tmp_path):
    kinds = [("pad", "V4"), ("z", "<f8"), ("h", "<f4", 5), ("y", "<f8"), ("x", "<f8"), ("c", "u1", 3), ("more", "V2")]
    rows = np.zeros(3, dtype=kinds)
    for name in "xyz":
        rows[name] = np.arange(3) + ord(name) + 1e4
    rows["c"] = BYTES
    head = header("_ z h y x r g b _", "1 8 4 8 8 1 1 1 1", "U F F F F U U U U", 3, "binary", "4 1 5 1 1 1 1 1 2")
    (tmp_path / "a.pcd").write_bytes(head + rows.tobytes())
    cloud = read_cloud(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.points[0] - 1e4, [ord(c) for c in "xyz"])
    np.testing.assert_array_equal(cloud.colors, BYTES / np.float32(255))


def test_compressed_by_another_program(tmp_path):
    open3d = load_open3d()
    rng = np.random.default_rng(0)
    # Repeated values make long and overlapping back references.
    points = np.concatenate([np.repeat(rng.uniform(0, 5, (20, 3)), 400, axis=0), rng.uniform(0, 5, (2000, 3))])
    colors = np.repeat(rng.integers(0, 256, (100, 3)), 100, axis=0) / 255
    theirs = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    theirs.colors = open3d.utility.Vector3dVector(colors)
    assert open3d.io.write_point_cloud(str(tmp_path / "a.pcd"), theirs, compressed=True)
    assert b"binary_compressed" in (tmp_path / "a.pcd").read_bytes()[:300]
    cloud = read_cloud(tmp_path / "a.pcd")
    np.testing.assert_array_equal(cloud.points, points.astype(np.float32))
    np.testing.assert_allclose(cloud.colors, colors, atol=1e-6)


def test_compressed_doubles_of_literals_alone(tmp_path):
    points = np.random.default_rng(1).uniform(1e6, 2e6, (40, 3))
    plain = points.T.tobytes()
    packed = b"".join(bytes([len(plain[i : i + 32]) - 1]) + plain[i : i + 32] for i in range(0, len(plain), 32))
    head = header("x y z", "8 8 8", "F F F", 40, "binary_compressed") + struct.pack("<II", len(packed), len(plain))
    (tmp_path / "a.pcd").write_bytes(head + packed)
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.pcd").points, points)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (header("x y z", "4 4 4", "F F F", 10**9, "binary") + bytes(24), "cut off: its header promises 1,000,000,000"),
        (header("x y z", "4 4 4", "F F F", 10**9, "ascii") + b"1 2 3\n", "cut off: its header promises 1,000,000,000"),
        (header("x y z", "4 4 4", "F F F", 3, "ascii") + b"1 2 3\n4 5 6\n           ", "cut off"),
        (header("x y z", "4 4", "F F F", 3, "binary") + bytes(36), "do not fit together"),
        (header("x y z", "4 4 3", "F F F", 3, "binary") + bytes(36), "do not fit together"),
        (header("a b c", "4 4 4", "F F F", 3, "binary") + bytes(36), "no fields x, y and z"),
        (header("x y z", "4 4 4", "F F F", 3, "zipped") + bytes(36), "its data is 'zipped'"),
        (header("x y z", "4 4 4", "F F F", 0, "binary"), "has no points"),
        (
            header("x y z", "4 4 4", "F F F", 3, "binary_compressed") + struct.pack("<II", 5, 10**9) + bytes(5),
            "not fit",
        ),
        (
            header("x y z", "4 4 4", "F F F", 3, "binary_compressed") + struct.pack("<II", 4, 36) + b"\xff" * 4,
            "damaged",
        ),
        (header("x y z", "4 4 4", "F F F", 3, "binary_compressed") + b"\1", "cut off"),
        (b"VERSION 0.7\nFIELDS x y z\n", "not a PCD file, or cut off"),
    ],
)
def test_broken_files_are_named(tmp_path, data, message):
    (tmp_path / "a.pcd").write_bytes(data)
    with pytest.raises(CloudError, match=message) as caught:
        read_cloud(tmp_path / "a.pcd")
    assert "a.pcd" in str(caught.value) and "\n" not in str(caught.value)
