"""LAS, E57 and NPZ as other programs write them."""

import io
import warnings
import zipfile

import numpy as np
import pytest

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats import CloudWarning, read_cloud, read_cloud_and_fields, read_observed, write_cloud

POINTS = np.array([[1.5, -2.25, 3.0], [10.0, 2.5, -1.0], [0.125, 0.0, 9.0]])
BYTES = np.array([[255, 0, 51], [1, 2, 3], [128, 64, 32]])
COLORS = BYTES.astype(np.float32) / np.float32(255)


@pytest.mark.parametrize("extension", [".las", ".laz"])
@pytest.mark.parametrize("point_format", [2, 3, 7])
@pytest.mark.parametrize("factor", [1, 257])
def test_las_colors_of_8_and_16_bits(tmp_path, extension, point_format, factor):
    import laspy

    header = laspy.LasHeader(version="1.4" if point_format == 7 else "1.2", point_format=point_format)
    header.scales, header.offsets = [0.001] * 3, [1e6, 7e6, 0]
    las = laspy.LasData(header)
    las.x, las.y, las.z = (POINTS + header.offsets).T
    las.red, las.green, las.blue = (BYTES * factor).astype(np.uint16).T
    las.write(tmp_path / f"a{extension}")
    cloud = read_cloud(tmp_path / f"a{extension}")
    np.testing.assert_allclose(cloud.points, POINTS + header.offsets, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(cloud.colors, COLORS)


def test_las_colors_that_nobody_filled_are_none(tmp_path):
    import laspy

    las = laspy.LasData(laspy.LasHeader(version="1.2", point_format=2))
    las.x, las.y, las.z = POINTS.T
    las.write(tmp_path / "a.las")
    assert read_cloud(tmp_path / "a.las").colors is None


def test_las_with_more_points_promised_than_there(tmp_path):
    import laspy

    las = laspy.LasData(laspy.LasHeader(version="1.2", point_format=0))
    las.x, las.y, las.z = np.zeros((3, 100))
    las.write(tmp_path / "a.las")
    data = (tmp_path / "a.las").read_bytes()
    (tmp_path / "a.las").write_bytes(data[:-21])
    with pytest.raises(CloudError, match="cut off: its header promises 100 points"):
        read_cloud(tmp_path / "a.las")


def test_e57_scans_come_together_by_their_poses(tmp_path):
    import pye57

    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    names = ("cartesianX", "cartesianY", "cartesianZ", "colorRed", "colorGreen", "colorBlue")
    data = dict(zip(names, [*POINTS.T, *BYTES.T.astype(np.uint8)], strict=True))
    quarter_turn_about_z = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    file.write_scan_raw(data, rotation=np.array([1.0, 0, 0, 0]), translation=np.array([1e6, 2e6, 3.0]))
    file.write_scan_raw(data, rotation=quarter_turn_about_z, translation=np.array([-1e6, 0.0, 0.0]))
    file.close()
    cloud = read_cloud(tmp_path / "a.e57")
    turned = np.stack([-POINTS[:, 1], POINTS[:, 0], POINTS[:, 2]], axis=1)
    expected = np.concatenate([POINTS + np.array([1e6, 2e6, 3]), turned + np.array([-1e6, 0, 0])])
    np.testing.assert_allclose(cloud.points, expected, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(cloud.colors, np.tile(COLORS, (2, 1)))


def test_e57_scans_without_color_beside_colored_ones_give_no_color(tmp_path):
    import pye57

    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    data = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), POINTS.T, strict=True))
    colors = dict(zip(("colorRed", "colorGreen", "colorBlue"), BYTES.T.astype(np.uint8), strict=True))
    file.write_scan_raw(data | colors)
    file.write_scan_raw(data)
    file.close()
    with pytest.warns(CloudWarning, match=r"a\.e57: only some of its 2 scans have colours: left out"):
        cloud = read_cloud(tmp_path / "a.e57")
    assert len(cloud) == 6 and cloud.colors is None


def test_e57_scans_without_points_take_no_colors_from_others(tmp_path):
    import pye57
    from pye57 import libe57

    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    image = file.image_file
    scan, prototype = libe57.StructureNode(image), libe57.StructureNode(image)
    columns = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), POINTS.T, strict=True))
    buffers = libe57.VectorSourceDestBuffer()
    for name in columns:
        prototype.set(name, libe57.FloatNode(image, 0.0))
        buffers.append(libe57.SourceDestBuffer(image, name, np.zeros(1), 1, True, True))
    scan.set("guid", libe57.StringNode(image, "{a}"))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    scan.set("points", points)
    file.data3d.append(scan)
    points.writer(buffers).close()
    colors = dict(zip(("colorRed", "colorGreen", "colorBlue"), BYTES.T.astype(np.uint8), strict=True))
    file.write_scan_raw(columns | colors | {"intensity": np.arange(3.0)})
    file.close()
    cloud, fields = read_cloud_and_fields(tmp_path / "a.e57")
    np.testing.assert_array_equal(cloud.colors, COLORS)
    assert fields["intensity"].tolist() == [0, 1, 2]


def test_e57_spherical_coordinates_and_16_bit_colors(tmp_path):
    import pye57
    from pye57 import libe57

    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    image = file.image_file
    scan, prototype = libe57.StructureNode(image), libe57.StructureNode(image)
    columns = {
        "sphericalRange": np.array([2.0, 2.0, 3.0]),
        "sphericalAzimuth": np.array([0.0, np.pi / 2, 1.0]),
        "sphericalElevation": np.array([0.0, 0.0, np.pi / 2]),
    }
    for name in columns:
        prototype.set(name, libe57.FloatNode(image, 0.0, libe57.E57_DOUBLE, -10.0, 10.0))
    for name, column in zip(("colorRed", "colorGreen", "colorBlue"), (BYTES * 257).T, strict=True):
        prototype.set(name, libe57.IntegerNode(image, 0, 0, 65535))
        columns[name] = column.astype(np.float64)
    scan.set("guid", libe57.StringNode(image, "{a}"))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    scan.set("points", points)
    file.data3d.append(scan)
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(image, name, column, 3, True, True))
    writer = points.writer(buffers)
    writer.write(3)
    writer.close()
    file.close()
    cloud = read_cloud(tmp_path / "a.e57")
    np.testing.assert_allclose(cloud.points, [[2, 0, 0], [0, 2, 0], [0, 0, 3]], atol=1e-12)
    np.testing.assert_array_equal(cloud.colors, COLORS)


@pytest.mark.filterwarnings("error")
def test_a_stray_point_costs_the_others_no_digits_in_an_e57(tmp_path):
    points = np.vstack([POINTS / 10 + np.array([4e5, 5.4e6, 0.0]), np.zeros((1, 3))])
    PointCloud(points).write(tmp_path / "a.e57")
    np.testing.assert_allclose(read_cloud(tmp_path / "a.e57").points, points, rtol=0, atol=1e-6)


def test_an_e57_too_wide_for_single_precision_is_told(tmp_path):
    with pytest.warns(CloudWarning, match=r"/a\.e57: E57 is written in single .* up to 0\.00028 m; write PLY"):
        PointCloud([[0, 0, 0], [20000.0007, 0, 0]]).write(tmp_path / "a.e57")


@pytest.mark.parametrize(("exact", "extension"), [(False, ".las"), (True, ".laz")])
def test_a_las_with_a_stray_far_off_is_written_in_coarser_steps(tmp_path, exact, extension):
    points = np.random.default_rng(0).uniform(0, 4, (50, 3))
    points[7, 0] = -3e7
    path = tmp_path / f"a{extension}"
    with pytest.warns(CloudWarning, match=r"in steps of 0\.01 m, which moves them by up to half of that; leave out"):
        write_cloud(PointCloud(points), path, exact=exact)
    np.testing.assert_allclose(read_cloud(path).points, points, atol=0.00501)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_cloud(PointCloud(points.clip(-4e5, 4)), path, exact=exact)


def test_e57_without_scans(tmp_path):
    import pye57

    pye57.E57(str(tmp_path / "a.e57"), mode="w").close()
    with pytest.raises(CloudError, match=r"a\.e57 has no scans"):
        read_cloud(tmp_path / "a.e57")


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32, np.float64, np.int64])
def test_npz_of_any_kind_of_numbers(tmp_path, kind):
    factor = {np.uint16: 257, np.float32: 1 / 255, np.float64: 1 / 255}.get(kind, 1)
    np.savez_compressed(tmp_path / "a.npz", points=POINTS.astype(np.float32), colors=(BYTES * factor).astype(kind))
    cloud = read_cloud(tmp_path / "a.npz")
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_allclose(cloud.colors, BYTES / 255, atol=1e-7)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"xyz": POINTS}, "no array 'points'"),
        ({"points": POINTS[:, :2]}, r"points must hold numbers of shape \(N, 3\), not float64 of shape \(3, 2\)"),
        ({"points": np.array([[object()] * 3])}, "points must hold numbers"),
        ({"points": POINTS, "colors": BYTES[:2]}, r"colors has shape \(2, 3\), points \(3, 3\)"),
        ({"points": POINTS, "colors": BYTES - 10.5}, "its colours run from -10.5"),
        ({"points": np.empty((0, 3))}, "has no points"),
    ],
)
def test_npz_that_holds_something_else(tmp_path, arrays, message):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(CloudError, match=rf"a\.npz.*{message}"):
        read_cloud(tmp_path / "a.npz")


def test_npz_that_promises_more_than_it_holds(tmp_path):
    buffer = io.BytesIO()
    np.save(buffer, POINTS)
    lie = buffer.getvalue().replace(b"(3, 3), }        ", b"(3000000000, 3)} ")
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("points.npy", lie)
    with pytest.raises(CloudError, match=r"a\.npz is cut off: its header promises 3,000,000,000 points"):
        read_cloud(tmp_path / "a.npz")


def test_what_libe57_says_of_its_source_lines_is_left_out(tmp_path):
    (tmp_path / "cut.e57").write_bytes(b"ASTM-E57" + bytes(52))
    with pytest.raises(CloudError, match=r"cut\.e57 cannot be read as E57 \([^*]*\); export it again$"):
        read_cloud(tmp_path / "cut.e57")


def test_npz_of_many_fields_that_hardly_change_is_read_again(tmp_path):
    """Twelve of them are more numbers than the file has bytes."""
    rng = np.random.default_rng(0)
    points = np.round(rng.random((1_050_000, 3)) * [10, 8, 2], 2)
    fields = {f"f{number}": np.ones(len(points), np.uint8) for number in range(12)}
    np.savez_compressed(tmp_path / "a.npz", points=points, **fields)
    assert (tmp_path / "a.npz").stat().st_size < 12 * len(points)
    _, found = read_cloud_and_fields(tmp_path / "a.npz")
    assert found.keys() == fields.keys()


def test_a_field_named_added_of_two_columns_marks_nothing(tmp_path):
    twice = np.zeros((len(POINTS), 2))
    np.savez(tmp_path / "a.npz", points=POINTS, added=twice, confidence=np.ones(len(POINTS)))
    cloud, fields = read_observed(tmp_path / "a.npz", with_fields=True)
    assert len(cloud) == len(POINTS) and fields["added"].shape == twice.shape
