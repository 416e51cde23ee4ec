"""PLY as other programs write it: byte orders, types, names, extra properties and elements."""

import numpy as np
import pytest

from pcdbench.errors import CloudError
from pcdbench.formats import read_cloud, read_cloud_and_fields

POINTS = np.array([[1.5, -2.25, 3.0], [1e4, 2.5, -1.0], [0.125, 0.0, 9.0]])
BYTES = np.array([[255, 0, 51], [1, 2, 3], [128, 64, 32]])
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


def written(path, form, elements):
    """Write PLY from [(element, [(kind, numpy type, property)], rows)]; a row's list is a nested list."""
    header = ["ply", f"format {form} 1.0", "comment made by a test", "obj_info nothing"]
    body = b""
    for element, properties, rows in elements:
        header.append(f"element {element} {len(rows)}")
        header += [f"property {kind} {name}" for kind, _, name in properties]
        for row in rows:
            body += ascii_row(row) if form == "ascii" else binary_row(row, properties, ORDERS[form])
    path.write_bytes(("\n".join([*header, "end_header"]) + "\n").encode() + body)
    return path


def ascii_row(row):
    words = []
    for value in row:
        words += [len(value), *value] if isinstance(value, list) else [repr(value)]
    return (" ".join(map(str, words)) + "\n").encode()


def binary_row(row, properties, order):
    body = b""
    for value, (_, kind, _) in zip(row, properties, strict=True):
        if isinstance(value, list):
            body += np.uint8(len(value)).tobytes()
        body += np.asarray(value, dtype=order + kind).tobytes()
    return body


XYZ = [("double", "f8", "x"), ("double", "f8", "y"), ("double", "f8", "z")]
RGB = [("uchar", "u1", name) for name in ("red", "green", "blue")]
FACES = ("face", [("list uchar int", "i4", "vertex_indices")], [([0, 1, 2],), ([2, 1, 0, 1],)])


def rows_of(*columns):
    return [tuple(column[row].item() for column in columns) for row in range(3)]


@pytest.mark.parametrize("form", ["ascii", *ORDERS])
@pytest.mark.parametrize("faces_first", [False, True])
def test_colored_mesh_gives_its_vertices(tmp_path, form, faces_first):
    vertex = ("vertex", XYZ + RGB, rows_of(*POINTS.T, *BYTES.T))
    elements = [FACES, vertex] if faces_first else [vertex, FACES]
    cloud = read_cloud(written(tmp_path / "a.ply", form, elements))
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_array_equal(cloud.colors, (BYTES / 255).astype(np.float32))


@pytest.mark.parametrize("form", ["ascii", *ORDERS])
def test_any_order_any_type_and_extra_properties(tmp_path, form):
    properties = [
        ("uint8", "u1", "blue"), ("float64", "f8", "z"), ("short", "i2", "label"), ("float32", "f4", "x"),
        ("uint8", "u1", "green"), ("int32", "i4", "y"), ("uint8", "u1", "red"), ("float", "f4", "nx"),
    ]  # fmt: skip
    whole = np.array([3, -4, 5])
    columns = [BYTES[:, 2], POINTS[:, 2], whole, POINTS[:, 0], BYTES[:, 1], whole, BYTES[:, 0], POINTS[:, 1]]
    cloud = read_cloud(written(tmp_path / "a.ply", form, [("vertex", properties, rows_of(*columns))]))
    np.testing.assert_array_equal(cloud.points, np.stack([POINTS[:, 0], whole, POINTS[:, 2]], axis=1))
    np.testing.assert_array_equal(cloud.colors, (BYTES / 255).astype(np.float32))


@pytest.mark.parametrize("form", [*ORDERS])
def test_vertices_that_hold_lists(tmp_path, form):
    properties = [XYZ[0], ("list uchar int", "i4", "seen_from"), *XYZ[1:]]
    rows = [(x, list(range(length)), y, z) for length, (x, y, z) in enumerate(POINTS.tolist())]
    cloud = read_cloud(written(tmp_path / "a.ply", form, [("vertex", properties, rows)]))
    np.testing.assert_array_equal(cloud.points, POINTS)


@pytest.mark.parametrize("names", ["red green blue", "r g b", "diffuse_red diffuse_green diffuse_blue"])
@pytest.mark.parametrize(
    ("kind", "numpy_kind", "factor"),
    [("uchar", "u1", 1), ("ushort", "u2", 257), ("ushort", "u2", 1), ("float", "f4", 1 / 255), ("float", "f4", 1)],
)
def test_names_and_types_of_colors(tmp_path, names, kind, numpy_kind, factor):
    properties = XYZ + [(kind, numpy_kind, name) for name in names.split()]
    rows = rows_of(*POINTS.T, *(BYTES * factor).T)
    cloud = read_cloud(written(tmp_path / "a.ply", "binary_little_endian", [("vertex", properties, rows)]))
    np.testing.assert_allclose(cloud.colors, BYTES / 255, atol=1e-7)


@pytest.mark.parametrize("values", [[-0.5, 0.2, 0.3], [0.2, 1.5, 0.3], [12.5, 300.25, 1.0], [1e6, 2.0, 3.0]])
def test_colors_of_no_known_range_are_refused(tmp_path, values):
    properties = XYZ + [("float", "f4", name) for name in ("red", "green", "blue")]
    rows = [(*POINTS[0].tolist(), *values)]
    path = written(tmp_path / "odd.ply", "binary_little_endian", [("vertex", properties, rows)])
    with pytest.raises(CloudError, match=r"odd\.ply: its colours run from .* export them as 8-bit"):
        read_cloud(path)


def test_lists_before_the_coordinates_of_ascii_rows(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty list uchar int seen\nproperty float x\nproperty float y\n"
        "property list uchar float w\nproperty float z\nproperty uchar label\nend_header\n"
        "3 10 11 12 1 2 0 3 7\n0 4 5 1 0.5 6 8\n"
    )
    cloud, fields = read_cloud_and_fields(tmp_path / "a.ply")
    np.testing.assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
    assert {name: values.tolist() for name, values in fields.items()} == {"label": [7, 8]}
    text = (tmp_path / "a.ply").read_text()
    (tmp_path / "a.ply").write_text(text.replace("\n3 10", "\n-1 10"))
    with pytest.raises(CloudError, match="a list of vertex does not say how long it is"):
        read_cloud(tmp_path / "a.ply")


def test_windows_line_ends(tmp_path):
    text = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(f"property float {c}\n" for c in "xyz")
    (tmp_path / "a.ply").write_bytes((text + "end_header\n1 2 3\n").replace("\n", "\r\n").encode())
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.ply").points, [[1, 2, 3]])


HEADER = b"ply\nformat binary_little_endian 1.0\nelement vertex %d\n" + b"".join(
    b"property float %s\n" % name for name in (b"x", b"y", b"z")
)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (HEADER % 2_000_000_000 + b"end_header\n" + bytes(24), "cut off: its header promises 2,000,000,000 points"),
        (HEADER % 3 + b"end_header\n" + bytes(35), "cut off"),
        (HEADER % 3, "within its header"),
        (HEADER % 0 + b"end_header\n", "has no points"),
        (HEADER.replace(b"vertex", b"face") % 1 + b"end_header\n" + bytes(12), "no element vertex"),
        (HEADER.replace(b"float y", b"float q") % 1 + b"end_header\n" + bytes(12), "no x, y and z"),
        (HEADER.replace(b"float y", b"half y") % 1 + b"end_header\n" + bytes(12), "header line 'property half y'"),
        (HEADER.replace(b"float y", b"float x") % 1 + b"end_header\n" + bytes(12), "a.ply"),
        (b"solid mesh\n", "not a PLY file"),
        (HEADER.replace(b"binary_little_endian", b"ascii") % 3 + b"end_header\n1 2 3\n4 5 6\n        ", "cut off"),
        (HEADER.replace(b"binary_little_endian", b"ascii") % 2 + b"end_header\n1 2 3\n4 5\n", "a.ply"),
    ],
)
def test_broken_files_are_named(tmp_path, data, message):
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(CloudError, match=message) as caught:
        read_cloud(tmp_path / "a.ply")
    assert "a.ply" in str(caught.value) and "\n" not in str(caught.value)
