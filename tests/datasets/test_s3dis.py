"""S3DIS as people have it: a small tree in the original format, its known defects included."""

from pathlib import Path

import numpy as np
import pytest

from pcdbench.datasets.s3dis import S3DIS
from pcdbench.datasets.s3dis.text import read_rows
from pcdbench.errors import CacheWarning, PcdbenchError


def part(low, high, count, seed=0):
    rng = np.random.default_rng(seed)
    points = np.round(rng.uniform(low, high, (count, 3)), 3)
    return np.hstack([points, rng.integers(0, 256, (count, 3))])


def text(rows):
    return "".join("{:.3f} {:.3f} {:.3f} {:.0f} {:.0f} {:.0f}\n".format(*row) for row in rows)


def write_room(area: Path, room: str, parts: dict[str, np.ndarray]) -> Path:
    folder = area / room
    (folder / "Annotations").mkdir(parents=True)
    for name, rows in parts.items():
        (folder / "Annotations" / f"{name}.txt").write_text(text(rows))
    (folder / f"{room}.txt").write_text(text(np.concatenate(list(parts.values()))))
    return folder


OFFICE = {
    "floor_1": part([0, 0, 0], [4, 3, 0.01], 300, 1),
    "wall_1": part([0, 0, 0], [4, 0.01, 2.5], 300, 2),
    "chair_1": part([1, 1, 0], [1.5, 1.6, 0.9], 120, 3),
    "table_2": part([2, 1, 0], [3.2, 2, 0.75], 120, 4),
}


@pytest.fixture
def tree(tmp_path) -> Path:
    root = tmp_path / "Stanford3dDataset_v1.2"
    write_room(root / "Area_1", "office_1", OFFICE)
    write_room(root / "Area_1", "hallway_2", OFFICE)
    write_room(root / "Area_6", "copyRoom_1", OFFICE)
    (root / "Area_1" / "Area_1_alignmentAngle.txt").write_text("## Global alignment\noffice_1 90\n")
    (root / "Area_1" / ".DS_Store").write_bytes(b"\0\0\0\1Bud1")
    (root / ".git").mkdir()
    return root


def opened(root, **options):
    return S3DIS(root, S3DIS.Options(complete_points=200, **options))


def problems(dataset, name):
    return [str(finding) for finding in dataset.check(name)]


def test_areas_are_splits_and_rooms_are_scenes(tree):
    dataset = opened(tree)
    assert dataset.splits() == ("all", "area1", "area6") and dataset.default_split == "all"
    assert dataset.scene_names("area1") == ["area1-hallway_2", "area1-office_1"]
    assert dataset.scene_names("all") == ["area1-hallway_2", "area1-office_1", "area6-copyRoom_1"]
    assert opened(tree.parent).scene_names("all") == dataset.scene_names("all")
    assert opened(tree / "Area_6").splits() == ("all", "area6")
    assert opened(tree, draws=10).draws("all") == 10


def test_a_room_has_its_points_colours_and_boxes(tree):
    scene = opened(tree).scene("area1-office_1")
    expected = np.concatenate(list(OFFICE.values()))
    np.testing.assert_allclose(scene.dense.points, expected[:, :3], atol=1e-6)
    np.testing.assert_allclose(scene.dense.colors, expected[:, 3:] / 255, atol=1e-6)
    assert len(scene.complete) == 200
    assert [tagged.label for tagged in scene.objects] == ["chair", "table"]
    for tagged, name in zip(scene.objects, ("chair_1", "table_2"), strict=True):
        least, most = OFFICE[name][:, :3].min(axis=0), OFFICE[name][:, :3].max(axis=0)
        np.testing.assert_allclose(tagged.box.center, (least + most) / 2)
        np.testing.assert_allclose(tagged.box.size, most - least)
        assert tagged.box.contains(OFFICE[name][:, :3], margin_m=1e-9).all()
    assert problems(opened(tree), "area1-office_1") == []


def test_structure_is_tagged_on_demand(tree):
    scene = opened(tree, structure=True).scene("area1-office_1")
    assert [tagged.label for tagged in scene.objects] == ["chair", "floor", "table", "wall"]


def test_stray_bytes_are_taken_out_of_numbers(tree):
    """The three that the release is known for: a byte in a colour, one in a coordinate, one in a blank's place."""
    path = tree / "Area_1/office_1/Annotations/chair_1.txt"
    lines = path.read_bytes().split(b"\n")
    lines[9] = b"1.100 1.200 0.500 100 101 103.0\x100000"
    lines[10] = b"1.1\x160 1.200 0.500 100 101 102"
    lines[11] = b"1.100 1.200 0.500 146 185\x00187"
    path.write_bytes(b"\n".join(lines))
    rows, findings = read_rows(path, "chair_1.txt")
    np.testing.assert_allclose(rows[9:12, 3:], [[100, 101, 103], [100, 101, 102], [146, 185, 187]])
    np.testing.assert_allclose(rows[9:12, :3], [[1.1, 1.2, 0.5]] * 3)
    assert len(rows) == 120
    assert [finding.where for finding in findings] == ["chair_1.txt:10", "chair_1.txt:11", "chair_1.txt:12"]
    assert str(findings[0]).endswith("a stray byte in '1.100 1.200 0.500 100 101 103.0\\x100000'; taken out")
    scene = opened(tree).scene("area1-office_1")
    assert scene.objects[0].label == "chair"
    assert problems(opened(tree), "area1-office_1")[0].startswith("Area_1/office_1/Annotations/chair_1.txt:10: a stray")


@pytest.mark.parametrize(
    "line",
    ["1.0 2.0 3.0 4 5", "nan 1.0 1.0 1 2 3", "1.0 inf 1.0 1 2 3", "1e999 1.0 1.0 1 2 3", "1 2 3 4 5 6 7 8", "??"],
)
def test_lines_that_cannot_be_mended_are_dropped_and_told(tree, line):
    path = tree / "Area_1/office_1/office_1.txt"
    path.write_text(path.read_text() + line + "\n\n")
    rows, findings = read_rows(path, "office_1.txt")
    assert len(rows) == 840
    assert [str(its) for its in findings] == [f"office_1.txt:841: no 6 finite numbers in {line!r}; the line is dropped"]
    assert len(opened(tree).scene("area1-office_1").dense) == 840


@pytest.mark.parametrize(
    ("line", "row"),
    [
        (b"4,938 4.000 0.021 136 128 120", [4.938, 4, 0.021, 136, 128, 120]),
        (b"4.938,4.000 0.021 136 128 120", [4.938, 4, 0.021, 136, 128, 120]),
        (b"4,938 4.0\x1000 0.021 136 128 120", [4.938, 4, 0.021, 136, 128, 120]),
    ],
)
def test_a_comma_makes_no_thousand_metres_of_one(tmp_path, line, row):
    path = tmp_path / "room.txt"
    path.write_bytes(b"1.0 2.0 0.5 1 2 3\n" + line + b"\n")
    rows, findings = read_rows(path, "room.txt")
    np.testing.assert_array_equal(rows, [[1, 2, 0.5, 1, 2, 3], row])
    assert len(findings) == 1 and str(findings[0]).startswith("room.txt:2: a comma in ")


def test_many_bad_lines_are_summed_up(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text(text(part([0] * 3, [1] * 3, 20)) + "nan nan nan 0 0 0\n" * 30)
    rows, findings = read_rows(path, "a.txt")
    assert len(rows) == 20 and len(findings) == 6
    assert "25 more lines like these" in findings[-1].problem


def test_line_counts_that_differ_are_told(tree):
    path = tree / "Area_1/office_1/office_1.txt"
    path.write_text("\n".join(path.read_text().splitlines()[:-7]))
    (found,) = problems(opened(tree), "area1-office_1")
    assert found.startswith("Area_1/office_1/Annotations: its files hold 840 points, the room's own 833; ")
    assert len(opened(tree).scene("area1-office_1").dense) == 833


def test_files_of_other_programs_and_empty_ones_are_passed_over(tree):
    folder = tree / "Area_1/office_1/Annotations"
    for name in (".DS_Store", "Icon\r", "._chair_1.txt"):
        (folder / name).write_bytes(b"\0\1")
    (folder / "board_1.txt").write_text("")
    dataset = opened(tree)
    assert problems(dataset, "area1-office_1") == [
        "Area_1/office_1/Annotations: it holds files of other programs (.DS_Store, ._chair_1.txt, Icon); passed over",
        "Area_1/office_1/Annotations/board_1.txt: it is empty; the object is left out",
    ]
    assert len(dataset.scene("area1-office_1").objects) == 2


def test_labels_are_put_right_and_stairs_are_known(tree):
    folder = tree / "Area_1/office_1/Annotations"
    (folder / "chair_1.txt").rename(folder / "chiar_1.txt")
    (folder / "table_2.txt").rename(folder / "stairs_2.txt")
    dataset = opened(tree)
    assert [tagged.label for tagged in dataset.scene("area1-office_1").objects] == ["chair", "stairs"]
    (found,) = problems(dataset, "area1-office_1")
    assert found.endswith("chiar_1.txt: 'chiar' is no label of S3DIS; taken for chair")


def test_a_room_file_of_another_name_is_found(tree):
    """Area_6's copyRoom_1 comes with copy_Room_1.txt."""
    room = tree / "Area_6/copyRoom_1"
    (room / "copyRoom_1.txt").rename(room / "copy_Room_1.txt")
    (found,) = problems(opened(tree), "area6-copyRoom_1")
    assert found == "Area_6/copyRoom_1/copyRoom_1.txt: there is no such file; copy_Room_1.txt is taken for it"


def test_without_a_room_file_the_annotations_make_the_room(tree):
    (tree / "Area_1/office_1/office_1.txt").unlink()
    dataset = opened(tree)
    assert len(dataset.scene("area1-office_1").dense) == 840
    assert problems(dataset, "area1-office_1")[0].endswith("the annotations are taken together")


def test_annotations_in_another_unit_are_left_out(tree):
    path = tree / "Area_1/office_1/Annotations/chair_1.txt"
    path.write_text(text(OFFICE["chair_1"] * [1000, 1000, 1000, 1, 1, 1]))
    dataset = opened(tree)
    assert [tagged.label for tagged in dataset.scene("area1-office_1").objects] == ["table"]
    assert "lies outside its room (in another unit or frame?)" in problems(dataset, "area1-office_1")[-1]


def test_rooms_without_colour_come_out_without(tree):
    path = tree / "Area_1/office_1/office_1.txt"
    np.savetxt(path, np.concatenate(list(OFFICE.values()))[:, :3], "%.3f")
    dataset = opened(tree)
    assert dataset.scene("area1-office_1").dense.colors is None
    assert "it has no colour; what needs colour is skipped" in problems(dataset, "area1-office_1")[-1]


def test_empty_rooms_are_unusable_and_the_others_are_not(tree):
    (tree / "Area_1/lounge_1").mkdir()
    dataset = opened(tree)
    (found,) = dataset.check("area1-lounge_1")
    assert not found.usable and "has neither points nor annotations" in found.problem
    with pytest.raises(PcdbenchError, match="neither points nor annotations"):
        dataset.scene("area1-lounge_1")
    assert len(dataset.scene("area1-office_1").complete) == 200


def test_rooms_are_read_once(tree, monkeypatch):
    first = opened(tree).scene("area1-office_1")
    monkeypatch.setattr("pcdbench.datasets.s3dis.read_room", lambda folder: pytest.fail("read again"))
    again = opened(tree).scene("area1-office_1")
    np.testing.assert_array_equal(first.dense.points, again.dense.points)
    np.testing.assert_array_equal(first.complete_index, again.complete_index)
    assert [tagged.label for tagged in again.objects] == ["chair", "table"]


def test_map_coordinates_keep_their_millimetres(tmp_path):
    offset = np.array([455_000, 5_411_000, 250, 0, 0, 0])
    write_room(tmp_path / "Area_1", "office_1", {name: rows + offset for name, rows in OFFICE.items()})
    points = opened(tmp_path).scene("area1-office_1").dense.points
    expected = np.concatenate(list(OFFICE.values())) + offset
    np.testing.assert_allclose(points, expected[:, :3], rtol=0, atol=5e-5)


def test_rooms_near_the_origin_are_kept_as_they_are(tree):
    points = opened(tree).scene("area1-office_1").dense.points
    np.testing.assert_array_equal(points, np.concatenate(list(OFFICE.values()))[:, :3].astype(np.float32))


def test_an_area_is_known_by_its_folders_name_from_inside(tree, monkeypatch):
    monkeypatch.chdir(tree / "Area_6")
    assert opened(Path(".")).scene_names("all") == ["area6-copyRoom_1"]


def test_without_a_cache_a_room_is_the_same(tree, tmp_path, monkeypatch):
    kept = opened(tree).scene("area1-office_1")
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.warns(CacheWarning, match="what is made is not kept"):
        scene = opened(tree).scene("area1-office_1")
        told = problems(opened(tree), "area1-office_1")
    np.testing.assert_array_equal(scene.dense.points, kept.dense.points)
    np.testing.assert_array_equal(scene.dense.colors, kept.dense.colors)
    np.testing.assert_array_equal(scene.complete_index, kept.complete_index)
    assert len(told) == len(set(told)) == 2 and all("is not kept" in its for its in told)


def test_rooms_whose_names_clash_are_told_apart(tree):
    for room, rows in (("office 1", 120), ("OFFICE_1", 300)):
        write_room(tree / "Area_1", room, {"chair_1": OFFICE["chair_1"], "wall_1": part([0] * 3, [4] * 3, rows)})
    write_room(tree / "area_1", "lounge_1", OFFICE)
    dataset = opened(tree)
    names = dataset.scene_names("area1")
    assert len({name.lower() for name in names}) == 5 and "area1-lounge_1" in names
    assert sorted(len(dataset.scene(name).dense) for name in names) == [240, 420, 840, 840, 840]


def test_a_changed_file_is_another_scene(tree):
    before = opened(tree).digest("area1-office_1")
    assert opened(tree).digest("area1-office_1") == before != opened(tree).digest("area1-hallway_2")
    path = tree / "Area_1/office_1/Annotations/chair_1.txt"
    path.write_text(text(OFFICE["chair_1"][:-1]))
    assert opened(tree).digest("area1-office_1") != before
    assert "hold 839 points" in problems(opened(tree), "area1-office_1")[0]


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (None, "needs the folder that holds Area_1 to Area_6"),
        ("nowhere", "there is no such folder"),
        ("empty", "holds no Area_N folder"),
    ],
)
def test_wrong_paths_are_named(tmp_path, path, message):
    (tmp_path / "empty").mkdir()
    with pytest.raises(PcdbenchError, match=message):
        opened(None if path is None else tmp_path / path).splits()
