"""Text files as people have them: separators, headers, comments, more columns, colours of either range."""

import numpy as np
import pytest

from pcdbench.errors import CloudError
from pcdbench.formats import CloudWarning, read_cloud, read_cloud_and_fields

EXPECTED = np.array([[1.5, 2.0, 3.25], [4.0, -5.5, 6.0]])


@pytest.mark.parametrize(
    "text",
    [
        "1.5 2 3.25\n4 -5.5 6\n",
        "1.5\t2\t3.25\r\n4\t-5.5\t6\r\n",
        "  1.5   2   3.25  \n\n  4 -5.5 6",
        "1.5,2,3.25\n4,-5.5,6\n",
        "1.5; 2; 3.25\n4; -5.5; 6\n",
        "1.5, 2, 3.25\n4, -5.5, 6\n",
        "\ufeffx,y,z\n1.5,2,3.25\n4,-5.5,6\n",
        "//X Y Z\n1.5 2 3.25\n4 -5.5 6\n",
        "# exported\n# from somewhere\n1.5 2 3.25 # first\n# between\n4 -5.5 6\n",
        "2\n1.5 2 3.25\n4 -5.5 6\n",
        "Easting;Northing;Height\n1.5;2;3.25\n4;-5.5;6\n",
        "Northing;Easting;Elevation\n2;1.5;3.25\n-5.5;4;6\n",
        "Point_ID,X_m,Y_m,Z_m\n1,1.5,2,3.25\n2,4,-5.5,6\n",
        "//id X[m] Y[m] Z[m]\n1 1.5 2 3.25\n2 4 -5.5 6\n",
        "x,y,X (m),Y (m),Z (m)\n7,8,1.5,2,3.25\n9,9,4,-5.5,6\n",
        '"intensity","laser_id","Points:0","Points:1","Points:2"\n12,3,1.5,2,3.25\n13,4,4,-5.5,6\n',
        "# scanned by hand\n1.5 2 3.25\n4 -5.5 6\n",
        "1.5e0 2 3.25 17\n4 -5.5 6 18\n",
        "1.5 2 3.25 0 0 -1\n4 -5.5 6 0.6 0.8 0\n",
        "z intensity x y\n3.25 9 1.5 2\n6 9 4 -5.5\n",
        "1.5,2,3.25,\n4,-5.5,6,\n",
        "1.5; 2; 3.25;\n4; -5.5; 6;\n",
        "x,y,z,\n1.5,2,3.25,\n4,-5.5,6,\n",
        '"x","y","z"\n"1.5","2","3.25"\n"4","-5.5","6"\n',
        "id;room;x;y;z\n7;kitchen;1.5;2;3.25\n8;;4;-5.5;6\n",
        "x,y,z,label\n1.5,2,3.25,\n4,-5.5,6,chair\n",
        'x,y,z,label\n1.5,2,3.25,"wide\n4,-5.5,6,"\n',
        'label,x,y,z\n"chair, red; desk",1.5,2,3.25\nchair,4,-5.5,6\n',
    ],
)
def test_points_without_color(tmp_path, text, recwarn):
    (tmp_path / "a.txt").write_text(text, newline="")
    cloud = read_cloud(tmp_path / "a.txt")
    np.testing.assert_array_equal(cloud.points, EXPECTED)
    assert cloud.colors is None and not recwarn.list


@pytest.mark.parametrize(
    "text",
    [
        "1.5 2 3.25 255 0 51\n4 -5.5 6 0 51 255\n",
        "1.5 2 3.25 1.0 0 0.2\n4 -5.5 6 0 0.2 1\n",
        "1.5,2,3.25,65535,0,13107\n4,-5.5,6,0,13107,65535\n",
        "1.5 2 3.25 255 0 51 99 98\n4 -5.5 6 0 51 255 97 96\n",
        '"X","Y","Z","Intensity","R","G","B"\n1.5,2,3.25,7,255,0,51\n4,-5.5,6,7,0,51,255\n',
        "x,y,z,r,g,b,label\n1.5,2,3.25,255,0,51,chair\n4,-5.5,6,0,51,255,desk\n",
        "//X Y Z Rf Gf Bf\n1.5 2 3.25 1 0 0.2\n4 -5.5 6 0 0.2 1\n",
        '"RGB:0","RGB:1","RGB:2","Points:0","Points:1","Points:2"\n255,0,51,1.5,2,3.25\n0,51,255,4,-5.5,6\n',
        "//X Y Z Intensity red green blue\n1.5 2 3.25 7 255 0 51\n4 -5.5 6 7 0 51 255\n",
    ],
)
def test_points_with_color(tmp_path, text):
    (tmp_path / "a.csv").write_text(text)
    cloud = read_cloud(tmp_path / "a.csv")
    np.testing.assert_array_equal(cloud.points, EXPECTED)
    np.testing.assert_allclose(cloud.colors, [[1, 0, 0.2], [0, 0.2, 1]], atol=1e-7)


def test_a_header_without_coordinates_is_warned_of(tmp_path):
    (tmp_path / "a.csv").write_text("Rechtswert;Hochwert;Höhe\n1.5;2;3.25\n4;-5.5;6\n", encoding="utf-8")
    with pytest.warns(CloudWarning, match=r"a\.csv: its header \(Rechtswert, Hochwert, Höhe\) names no x, y and z"):
        cloud = read_cloud(tmp_path / "a.csv")
    np.testing.assert_array_equal(cloud.points, EXPECTED)


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("Point ID X Y Z\n1 1.5 2 3.25\n2 4 -5.5 6\n", "5 names for 4"),
        ("# Point ID X Y Z\n1 1.5 2 3.25\n2 4 -5.5 6\n", "5 names for 4"),
        ('"x" "y" "z"\n"1" 1.5 2 3.25\n"2" 4 -5.5 6\n', "3 names for 4"),
    ],
)
def test_a_header_that_does_not_fit_the_columns_is_warned_of(tmp_path, text, count):
    (tmp_path / "a.xyz").write_text(text)
    with pytest.warns(CloudWarning, match=rf"its header \(.*\) has {count} columns; the first three are taken for x"):
        read_cloud(tmp_path / "a.xyz")


@pytest.mark.parametrize("rows", ["1\t1.5\t2\t3.25\t\n2\t4\t-5.5\t6\tdoor\n", "1,1.5,2,3.25\n2,4,-5.5,6,7\n"])
def test_cells_may_be_missing_at_the_end_of_rows(tmp_path, rows):
    (tmp_path / "a.csv").write_text("id,X,Y,Z,name\n".replace(",", rows[1]) + rows)
    with pytest.warns(CloudWarning, match="name: not a number in every row, left out"):
        cloud, fields = read_cloud_and_fields(tmp_path / "a.csv")
    np.testing.assert_array_equal(cloud.points, EXPECTED)
    np.testing.assert_array_equal(fields["id"], [1, 2])


def test_a_header_of_another_unit_than_metres_is_warned_of(tmp_path):
    (tmp_path / "a.csv").write_text("X (ft),Y (ft),Z (ft)\n1.5,2,3.25\n4,-5.5,6\n")
    with pytest.warns(CloudWarning, match=r"its header gives x in ft; coordinates are taken as metres"):
        read_cloud(tmp_path / "a.csv")


def test_map_coordinates_keep_their_digits(tmp_path):
    (tmp_path / "a.xyz").write_text("1234567.8912 7654321.0987 512.3456\n")
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.xyz").points, [[1234567.8912, 7654321.0987, 512.3456]])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"1 2\n3 4\n", "has 2 columns where x y z are needed"),
        (b"1 2 3\n4 5\n", r"a\.xyz: line 2 \('4 5'\) has no 3 numbers as the first row has"),
        (b"# x\n\n1 2 3\n\n4 5 six\n", r"a\.xyz: line 5 \('4 5 six'\) has no 3 numbers"),
        (b"1,5;2,5;3,5\n", "a.xyz has decimal commas; save it with decimal points"),
        ("1 2 3\n".encode("utf-16"), "a.xyz is text in UTF-16; save it as UTF-8"),
        (b"Dear Sir,\nplease find enclosed\nthe scan\n", "a.xyz has no rows of numbers"),
        (b"# nothing but a comment\n", "a.xyz has no rows of numbers"),
        (bytes(range(256)) * 40, "is not text"),
        (b"1 2 3 -4 300 7\n", "its colours run from -4 to 300"),
        (b"1 2 3 0.5 1.5 0.7\n", "its colours run from 0.5 to 1.5"),
    ],
)
def test_broken_files_are_named(tmp_path, content, message):
    (tmp_path / "a.xyz").write_bytes(content)
    with pytest.raises(CloudError, match=message) as caught:
        read_cloud(tmp_path / "a.xyz")
    assert "a.xyz" in str(caught.value) and "\n" not in str(caught.value)


def test_columns_that_are_no_colours_are_to_be_named(tmp_path):
    rows = "0 1 1.5 2 3.25 -0.5 255 0\n7 8 4 -5.5 6 300.25 0 51\n"
    (tmp_path / "a.xyz").write_text(rows)
    with pytest.raises(
        CloudError, match=r"run from .*; or, if columns 4 to 6 are no colours, write a first line that names all 8"
    ):
        read_cloud(tmp_path / "a.xyz")
    (tmp_path / "a.xyz").write_text(f"row column x y z velocity a b\n{rows}")
    np.testing.assert_array_equal(read_cloud(tmp_path / "a.xyz").points, EXPECTED)
    (tmp_path / "a.xyz").write_text(f"x y z red green blue a b\n{rows}")
    with pytest.raises(CloudError, match=r"8-bit colours$"):
        read_cloud(tmp_path / "a.xyz")


def test_seven_columns_without_names(tmp_path):
    path = tmp_path / "a.xyz"
    rgb = np.array([[255, 0, 51], [0, 51, 255]]) / 255
    for rows, intensity in (
        ("0 0 0 -812 255 0 51\n1 2 3 44 0 51 255\n", [-812, 44]),
        ("0 0 0 0.5 255 0 51\n1 2 3 1 0 51 255\n", [0.5, 1]),
        ("2\n0 0 0 7 255 0 51\n1 2 3 44 0 51 255\n", [7, 44]),
    ):
        path.write_text(rows)
        cloud, fields = read_cloud_and_fields(path)
        np.testing.assert_allclose(cloud.colors, rgb, atol=1e-7)
        assert list(fields) == ["intensity"] and fields["intensity"].tolist() == intensity
    path.write_text("0 0 0 255 0 51 7\n1 2 3 0 51 255 8\n")
    with pytest.warns(CloudWarning, match="4th to 6th are taken for red, green and blue"):
        cloud, fields = read_cloud_and_fields(path)
    np.testing.assert_allclose(cloud.colors, rgb, atol=1e-7)
    assert fields["column_7"].tolist() == [7, 8]


def test_pts_files_begin_with_the_number_of_points(tmp_path):
    rows = "1 2 3 -800 255 0 51\n4 5 6 12 0 51 255\n"
    (tmp_path / "a.pts").write_text(f"2\n{rows}")
    cloud, fields = read_cloud_and_fields(tmp_path / "a.pts")
    np.testing.assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
    assert fields["intensity"].tolist() == [-800, 12] and cloud.colors is not None
    cloud.write(tmp_path / "b.pts")
    assert (tmp_path / "b.pts").read_text().splitlines()[0] == "2"
    (tmp_path / "a.pts").write_text(f"3\n{rows}")
    with pytest.raises(CloudError, match=r"a\.pts is cut off: 2 of 3 points are there"):
        read_cloud(tmp_path / "a.pts")


def test_columns_without_names_are_fields_by_their_place(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text("0 0 0 9\n1 2 3 8\n")
    assert {name: values.tolist() for name, values in read_cloud_and_fields(path)[1].items()} == {"column_4": [9, 8]}
    path.write_text("0 0 0 0 0 -1 9\n1 2 3 0 -1 0 8\n")
    cloud, fields = read_cloud_and_fields(path)
    assert cloud.colors is None and list(fields) == ["nx", "ny", "nz", "column_7"]
    np.testing.assert_array_equal(fields["nz"], [-1, 0])


def test_normals_may_be_missing_of_some_points(tmp_path, recwarn):
    path = tmp_path / "a.xyz"
    path.write_text("0 0 0 -1 0 0\n1 2 3 nan nan nan\n4 5 6 0 1 0\n")
    cloud, fields = read_cloud_and_fields(path)
    assert len(cloud) == 3 and cloud.colors is None and not recwarn.list
    np.testing.assert_array_equal(fields["nx"], [-1, np.nan, 0])


def test_points_without_colour_are_points(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text("0 0 0 255 0 51\n1 2 3 nan nan nan\n")
    with pytest.warns(CloudWarning, match=r"1 of its points have no valid colour; the colours of all are left out"):
        cloud = read_cloud(path)
    assert len(cloud) == 2 and cloud.colors is None
    path.write_text("0 0 0 255 0 51\n" * 199 + "1 2 3 nan nan nan\n")
    with pytest.warns(CloudWarning, match=r"1 of its points have no valid colour; these are grey"):
        cloud = read_cloud(path)
    assert len(cloud) == 200 and cloud.colors is not None
    np.testing.assert_allclose(cloud.colors[[0, -1]], [[1, 0, 0.2], [0.5, 0.5, 0.5]], atol=1e-6)
    np.savez(tmp_path / "a.npz", points=cloud.points, colors=np.full((200, 3), np.nan, np.float32))
    with pytest.warns(CloudWarning, match="200 of its points have no valid colour") as told:
        assert read_cloud(tmp_path / "a.npz").colors is None
    assert len(told) == 1


def test_pts_files_may_hold_several_scans(tmp_path):
    path = tmp_path / "a.pts"
    block = "2\n0 0 0 -900 255 0 51\n1 2 3 -800 0 0 0\n"
    path.write_text(block + block.replace("2\n", "2\n", 1).replace("1 2 3", "4 5 6"))
    cloud, fields = read_cloud_and_fields(path)
    np.testing.assert_array_equal(cloud.points, [[0, 0, 0], [1, 2, 3], [0, 0, 0], [4, 5, 6]])
    np.testing.assert_array_equal(fields["intensity"], [-900, -800, -900, -800])
    path.write_text(block + "9\n" + block.partition("\n")[2])
    with pytest.raises(CloudError, match="is cut off: 4 of 11 points are there; copy it again"):
        read_cloud(path)
    path.write_text(block + "2\n0 0 x -900 255 0 51\n")
    with pytest.raises(CloudError, match=r"line 5 \('0 0 x -900 255 0 51'\) has no 7 numbers"):
        read_cloud(path)
