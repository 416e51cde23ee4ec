"""Further fields of each point, and coordinates kept to the last bit."""

import numpy as np
import pytest

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats import (
    EXTENSIONS,
    CloudWarning,
    carries_fields,
    read_cloud,
    read_cloud_and_fields,
    read_observed,
    text,
    write_cloud,
)

WITH_FIELDS = [extension for extension in EXTENSIONS if extension not in (".e57", ".pts")]


def fields_of(path):
    return read_cloud_and_fields(path)[1]


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
    back = fields_of(tmp_path / f"a{extension}")
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
    assert fields_of(tmp_path / f"a{extension}") == {}


def test_e57_says_that_it_has_no_fields(tmp_path):
    cloud, fields = marked()
    assert not carries_fields(tmp_path / "a.E57") and carries_fields(tmp_path / "a.laz")
    with pytest.raises(CloudError, match=r"a\.e57: \.e57 files cannot hold added, confidence; write PLY"):
        write_cloud(cloud, tmp_path / "a.e57", fields)
    assert not list(tmp_path.iterdir())


def test_other_programs_fields_are_read(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float nx\nproperty float y\n"
        "property float z\nproperty uchar label\nend_header\n1 0.5 2 3 7\n4 -0.5 5 6 8\n"
    )
    fields = fields_of(tmp_path / "a.ply")
    assert fields["nx"].tolist() == [0.5, -0.5] and fields["label"].tolist() == [7, 8] and len(fields) == 2
    (tmp_path / "a.csv").write_text("x;y;z;Scalar\n1;2;3;0.25\n")
    assert fields_of(tmp_path / "a.csv")["Scalar"].tolist() == [0.25]


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


NUMBERS = {
    "label": np.int32,
    "ring": np.uint16,
    "time": np.float64,
    "reflectance": np.float32,
    "small": np.int8,
    "id": np.int64,
}


def measured(count=200):
    rng = np.random.default_rng(5)
    fields = {name: rng.uniform(-100, 100, count).astype(kind) for name, kind in NUMBERS.items()}
    fields["ring"] = rng.integers(0, 60_000, count).astype(np.uint16)
    fields["time"] = 1.7e9 + np.round(rng.uniform(0, 1e4, count), 6)
    return fields


@pytest.mark.parametrize("extension", WITH_FIELDS)
def test_fields_keep_their_numbers_and_types(tmp_path, extension):
    path, fields = tmp_path / f"a{extension}", measured()
    write_cloud(marked()[0], path, fields)
    back = fields_of(path)
    assert list(back) == list(fields)
    for name, values in fields.items():
        np.testing.assert_array_equal(back[name].astype(values.dtype), values, err_msg=name)
        if extension not in (".xyz", ".txt", ".csv", ".asc") and (extension, name) != (".ply", "id"):
            assert back[name].dtype == values.dtype, name


@pytest.mark.parametrize("extension", [extension for extension in WITH_FIELDS if extension != ".ply"])
def test_whole_numbers_beyond_double_precision_keep_their_digits(tmp_path, extension):
    stamps = 1_700_000_000_123_456_789 + np.arange(200)
    hashes = np.arange(200, dtype=np.uint64) + np.uint64(2**64 - 1000)
    fields = {"label": np.arange(200), "stamp_ns": stamps, "hash": hashes, "large": 1e17 + 16.0 * np.arange(200)}
    write_cloud(marked()[0], tmp_path / f"a{extension}", fields)
    back = fields_of(tmp_path / f"a{extension}")
    np.testing.assert_array_equal(back["stamp_ns"], stamps)
    np.testing.assert_array_equal(back["hash"], hashes)
    np.testing.assert_array_equal(back["large"], fields["large"])
    np.testing.assert_array_equal(back["label"], np.arange(200))


def test_ply_says_that_it_has_no_such_numbers(tmp_path):
    with pytest.warns(CloudWarning, match=r"/a\.ply: PLY has no whole numbers as large as those of stamp_ns"):
        write_cloud(marked()[0], tmp_path / "a.ply", {"stamp_ns": 2**60 + np.arange(200), "label": np.arange(200)})
    assert fields_of(tmp_path / "a.ply")["stamp_ns"].astype(np.int64)[0] == 2**60


def test_a_column_without_a_name_is_found_by_its_place(tmp_path):
    (tmp_path / "a.xyz").write_text("0 0 0 9 9 9 7 8 1700000000123456789\n1 1 1 9 9 9 7.5 8 1700000000123456790\n")
    columns = text.read(tmp_path / "a.xyz", {"column_9"})
    assert {name: values.tolist() for name, values in columns.fields.items()} == {
        "column_9": [1700000000123456789, 1700000000123456790]
    }


@pytest.mark.parametrize("extension", WITH_FIELDS)
def test_vectors_are_numbered_where_a_column_is_one_number(tmp_path, extension):
    normals = np.random.default_rng(0).normal(size=(200, 3)).astype(np.float32)
    write_cloud(marked()[0], tmp_path / f"a{extension}", {"normal of": normals})
    back = fields_of(tmp_path / f"a{extension}")
    if extension == ".npz":
        np.testing.assert_array_equal(back["normal of"], normals)
    else:
        assert list(back) == ["normal_of_0", "normal_of_1", "normal_of_2"]
        np.testing.assert_allclose(np.stack(list(back.values()), axis=1), normals, rtol=1e-6)


def test_fields_of_rows_that_are_dropped_are_dropped_with_them(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z,label\n0,0,0,1\nnan,0,0,2\n1,1,1,3\n")
    with pytest.warns(CloudWarning, match="1 of 3 points"):
        cloud, fields = read_cloud_and_fields(tmp_path / "a.csv")
    assert len(cloud) == 2 and fields["label"].tolist() == [1, 3]


def test_a_field_has_a_row_for_each_point(tmp_path):
    with pytest.raises(CloudError, match="field label must have a row for each of the 200 points"):
        write_cloud(marked()[0], tmp_path / "a.ply", {"label": np.zeros(199)})


def survey(path, point_format=7, version="1.4"):
    """A LAS file as surveyors hand it over: times, classes, an extra dimension, and a reference system in WKT."""
    import laspy

    rng = np.random.default_rng(1)
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.scales, header.offsets = [1e-3] * 3, [400_000, 5_000_000, 100]
    header.global_encoding.wkt, header.global_encoding.gps_time_type = True, laspy.header.GpsTimeType.STANDARD
    header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr("PROJCS[made up]"))
    header.vlrs.append(laspy.VLR("somebody", 7, "", b"else's"))
    header.add_extra_dim(laspy.ExtraBytesParams("range_m", np.float64))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (rng.uniform(0, 4, (300, 3)) + np.array([400_000, 5_000_000, 100])).T
    las.red, las.green, las.blue = rng.integers(0, 65536, (3, 300))
    las.intensity, las.classification = rng.integers(0, 60_000, 300), rng.integers(0, 100, 300)
    las.return_number, las.number_of_returns = np.full((2, 300), 9)
    las.gps_time, las.range_m = 3e8 + np.arange(300) / 7, rng.uniform(1, 9, 300)
    las.write(path)
    return las


@pytest.mark.parametrize("extension", [".las", ".laz"])
def test_las_keeps_its_own_dimensions_and_where_on_earth_it_is(tmp_path, extension):
    import laspy

    before = survey(tmp_path / "scan.las")
    cloud, fields = read_cloud_and_fields(tmp_path / "scan.las")
    write_cloud(cloud, tmp_path / f"again{extension}", fields, exact=True, like=tmp_path / "scan.las")
    after = laspy.read(tmp_path / f"again{extension}")
    assert after.header.point_format.id == 7 and after.header.version == "1.4"
    np.testing.assert_allclose(after.xyz, before.xyz, atol=1e-9)
    for name in ("red", "intensity", "classification", "return_number", "gps_time", "range_m"):
        np.testing.assert_array_equal(np.asarray(after[name]), np.asarray(before[name]), err_msg=name)
    assert [record.string for record in after.header.vlrs.get("WktCoordinateSystemVlr")] == ["PROJCS[made up]"]
    assert after.header.global_encoding.wkt and after.header.global_encoding.gps_time_type.value == 1
    assert b"else's" not in (tmp_path / f"again{extension}").read_bytes()


def test_las_takes_the_smallest_point_format_that_holds_what_there_is(tmp_path):
    import laspy

    cloud, _ = marked()
    some = np.arange(200) % 7
    for fields, number in (
        ({}, 2),
        ({"intensity": some}, 2),
        ({"gps_time": some + 0.5}, 3),
        ({"intensity": some, "classification": some + 40}, 7),
        ({"scan_angle": some, "nir": some}, 8),
    ):
        write_cloud(cloud, tmp_path / "a.las", fields)
        las = laspy.read(tmp_path / "a.las")
        assert las.header.point_format.id == number, fields
        assert not list(las.point_format.extra_dimension_names)
        for name, values in fields.items():
            np.testing.assert_array_equal(las[name], values)


@pytest.mark.parametrize(
    "names",
    [
        ("intensity", "classification", "return_number"),
        ("Intensity", "Classification", "ReturnNumber"),
        ("scalar_Intensity", "scalar_Classification", "scalar_Return_Number"),
    ],
)
@pytest.mark.parametrize("kind", [np.float64, np.float32, np.uint16])
def test_las_has_its_own_dimensions_however_other_programs_spell_them(tmp_path, names, kind):
    import laspy

    some = np.arange(200) % 5
    write_cloud(marked()[0], tmp_path / "a.laz", {name: some.astype(kind) for name in names})
    las = laspy.read(tmp_path / "a.laz")
    assert not list(las.point_format.extra_dimension_names)
    for name in ("intensity", "classification", "return_number"):
        np.testing.assert_array_equal(las[name], some)


def test_of_two_spellings_one_is_the_dimension(tmp_path):
    some = np.arange(200) % 5
    write_cloud(marked()[0], tmp_path / "a.las", {"Intensity": some, "intensity": some + 1})
    back = fields_of(tmp_path / "a.las")
    np.testing.assert_array_equal(back["intensity"], some + 1)
    np.testing.assert_array_equal(back["Intensity_2"], some)


def test_numbers_of_an_ascii_ply_keep_their_types(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    more = "property float intensity\nproperty double time\nproperty uchar label\nend_header\n"
    (tmp_path / "a.ply").write_text(header + more + "0 1 2 0.164 0.1 7\n3 4 5 0.5 0.2 8\n")
    assert {name: values.dtype for name, values in fields_of(tmp_path / "a.ply").items()} == {
        "intensity": np.float32,
        "time": np.float64,
        "label": np.uint8,
    }


def test_the_alpha_of_a_pcd_is_a_field_where_it_says_something(tmp_path):
    header = "VERSION .7\nFIELDS x y z rgba\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n"
    for second, expected in ((255 << 24, None), (9 << 24, [255, 9])):
        rows = f"0 0 0 {(255 << 24) + 0x0A141E}\n1 1 1 {second + 0x0A141E}\n"
        (tmp_path / "a.pcd").write_text(f"{header}DATA ascii\n{rows}")
        cloud, fields = read_cloud_and_fields(tmp_path / "a.pcd")
        np.testing.assert_allclose(cloud.colors, [[10 / 255, 20 / 255, 30 / 255]] * 2)
        assert (fields["alpha"].tolist() if "alpha" in fields else None) == expected


def test_what_las_has_a_name_but_no_place_for_stands_beside(tmp_path):
    intensity = np.linspace(0, 1, 200)
    write_cloud(
        marked()[0], tmp_path / "a.las", {"intensity": intensity, "gps_time": np.where(intensity > 0.5, np.nan, 4)}
    )
    back = fields_of(tmp_path / "a.las")
    np.testing.assert_array_equal(back["intensity_2"], intensity)
    assert "intensity" not in back and set(back["gps_time"]) == {0, 4}
    write_cloud(marked()[0], tmp_path / "a.las", {"gps_time": 2**60 + np.arange(200)})
    kept = fields_of(tmp_path / "a.las")["gps_time"].astype(np.int64)
    np.testing.assert_array_equal(kept, 2**60 + np.arange(200))


def test_withheld_points_are_deleted_ones(tmp_path):
    import laspy

    las = survey(tmp_path / "scan.las")
    las.withheld = np.arange(300) < 10
    las.write(tmp_path / "scan.las")
    with pytest.warns(CloudWarning, match="10 of 300 points are not valid"):
        cloud, fields = read_cloud_and_fields(tmp_path / "scan.las")
    np.testing.assert_array_equal(cloud.points[:, 0], np.asarray(las.x)[10:])
    assert len(fields["gps_time"]) == 290 and "withheld" not in fields
    assert "withheld" in laspy.read(tmp_path / "scan.las").point_format.dimension_names


def test_fields_of_all_scans_of_an_e57_are_read(tmp_path):
    import pye57

    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    x = np.arange(5.0)
    for more in ({"rowIndex": np.arange(5), "columnIndex": np.arange(5)}, {}):
        file.write_scan_raw({"cartesianX": x, "cartesianY": x, "cartesianZ": x, "intensity": x / 4, **more})
    file.close()
    with pytest.warns(CloudWarning, match="only some of its 2 scans have rowIndex, columnIndex: left out"):
        fields = fields_of(tmp_path / "a.e57")
    assert list(fields) == ["intensity"] and fields["intensity"].tolist() == [*(x / 4), *(x / 4)]


@pytest.mark.parametrize("extension", WITH_FIELDS)
def test_what_a_completion_added_is_no_observation(tmp_path, extension):
    path = tmp_path / f"done{extension}"
    cloud, fields = marked()
    write_cloud(cloud, path, {"label": np.arange(200), **fields})
    count = int(fields["added"].sum())
    with pytest.warns(CloudWarning, match=f"a completion added {count} of its points"):
        seen, others = read_observed(path, with_fields=True)
    np.testing.assert_allclose(seen.points, cloud.points[~fields["added"]], atol=1e-4)
    assert list(others) == ["label"] and others["label"].tolist() == np.flatnonzero(~fields["added"]).tolist()
    assert len(read_cloud(path)) == 200
    write_cloud(cloud, path, {"added": np.ones(200, bool), "confidence": fields["confidence"]})
    with pytest.raises(CloudError, match="added all of its points; name the scan"):
        read_observed(path)
    # Another's field of that name says nothing of completions.
    write_cloud(cloud, path, {"added": fields["added"]})
    assert len(read_observed(path)[0]) == 200


def test_marks_that_cloudcompare_saved_again_are_known(tmp_path):
    path = tmp_path / "a.ply"
    cloud, fields = marked()
    write_cloud(cloud, path, {f"scalar_{name}": np.asarray(values, np.float32) for name, values in fields.items()})
    back = read_cloud_and_fields(path)[1]
    assert list(back) == ["added", "confidence"]
    np.testing.assert_array_equal(back["added"], fields["added"])
    with pytest.warns(CloudWarning, match="a completion added"):
        assert len(read_observed(path)[0]) == (~fields["added"]).sum()
    write_cloud(cloud, path, {"scalar_confidence": fields["confidence"]})
    assert list(read_cloud_and_fields(path)[1]) == ["scalar_confidence"], "a phone's own, say"


def test_single_precision_far_from_the_origin_is_told(tmp_path):
    near = np.random.default_rng(0).uniform(-4, 4, (50, 3))
    for offset, told in ((5_000_000, "steps of 0.5 m"), (400_000, "steps of 0.031 m")):
        rows = (near + np.array([offset, 0, 0])).astype(np.float32)
        np.savez(tmp_path / "a.npz", points=rows)
        with pytest.warns(CloudWarning, match=told):
            read_cloud(tmp_path / "a.npz")
        np.savez(tmp_path / "a.npz", points=near + np.array([offset, 0, 0]))
        read_cloud(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", points=near.astype(np.float32))
    read_cloud(tmp_path / "a.npz")


CLASHING = (
    "x",
    "X",
    "red",
    "rgb",
    "points",
    "colors",
    "file",
    "a/points",
    "a b",
    "a_b",
    "",
    "größe",
    "grüße",
    "bit_fields",
)


@pytest.mark.parametrize("color", [True, False])
@pytest.mark.parametrize("extension", WITH_FIELDS)
def test_no_name_takes_the_place_of_another(tmp_path, extension, color):
    cloud, _ = marked(color=color)
    names = (*CLASHING, "n" * 40 + "1", "n" * 40 + "2")
    fields = {name: np.full(200, number + 0.5, np.float32) for number, name in enumerate(names)}
    write_cloud(cloud, tmp_path / f"a{extension}", fields)
    again, back = read_cloud_and_fields(tmp_path / f"a{extension}")
    np.testing.assert_allclose(again.points, cloud.points, atol=1e-4)
    assert (again.colors is not None) == color
    assert sorted(values[0] - 0.5 for values in back.values()) == list(range(len(names)))


def test_las_says_how_many_fields_it_holds(tmp_path):
    with pytest.raises(CloudError, match="LAS holds up to 341 further fields, not 400; write PLY"):
        write_cloud(marked()[0], tmp_path / "a.las", {"features": np.zeros((200, 400), np.float32)})


def test_a_reference_system_behind_the_points_is_kept(tmp_path):
    import laspy

    las = survey(tmp_path / "scan.las")
    las.evlrs = laspy.vlrs.vlrlist.VLRList([las.header.vlrs.pop(0)])
    las.write(tmp_path / "scan.las")
    write_cloud(marked()[0], tmp_path / "again.laz", like=tmp_path / "scan.las")
    header = laspy.read(tmp_path / "again.laz").header
    assert [record.string for record in header.vlrs.get("WktCoordinateSystemVlr")] == ["PROJCS[made up]"]
    assert header.global_encoding.wkt


def test_normals_of_an_e57_turn_with_their_scan():
    from pcdbench.formats.e57 import _turned_normals

    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # about z
    normals = {f"nor:normal{axis}": np.array([value]) for axis, value in zip("XYZ", (1.0, 0.0, 0.0), strict=True)}
    turned = _turned_normals({"intensity": np.array([7.0]), **normals}, quarter)
    assert {name: values.tolist() for name, values in turned.items()} == {
        "intensity": [7.0],
        "nor:normalX": [0.0],
        "nor:normalY": [1.0],
        "nor:normalZ": [0.0],
    }


def test_columns_that_are_not_all_numbers_are_left_out_and_told(tmp_path):
    (tmp_path / "a.csv").write_text('"x","y","z","intensity","label","x"\n0,0,0,5,1,9\n1,2,3,6,chair,8\n')
    with pytest.warns(CloudWarning, match=r"a\.csv: label: not a number in every row, left out"):
        cloud, fields = read_cloud_and_fields(tmp_path / "a.csv")
    found = {name: values.tolist() for name, values in fields.items()}
    assert len(cloud) == 2 and found == {"intensity": [5, 6], "x_2": [9, 8]}
    assert len(read_cloud(tmp_path / "a.csv")) == 2


def test_labels_may_be_words_where_a_header_names_the_rest(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("x,y,z,label,scan\n0,0,0,wall,5\n1,2,3,chair,6\n")
    with pytest.warns(CloudWarning, match=r"a\.csv: label: not a number in every row, left out"):
        cloud, fields = read_cloud_and_fields(path)
    assert cloud.points.tolist() == [[0, 0, 0], [1, 2, 3]] and list(fields) == ["scan"]
    path.write_text("label,x,y,z\nwall,0,0,zero\n")
    with pytest.raises(CloudError, match="no rows of numbers"):
        read_cloud(path)


def test_names_with_blanks_between_tabs(tmp_path):
    header = "x\ty\tz\tscan angle\tgps time\tintensity\n"
    (tmp_path / "a.txt").write_text(header + "0\t0\t0\t1\t2\t3\n1\t1\t1\t4\t5\t6\n")
    cloud, fields = read_cloud_and_fields(tmp_path / "a.txt")
    assert cloud.colors is None and list(fields) == ["scan angle", "gps time", "intensity"]
