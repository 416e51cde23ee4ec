"""Scans on disk as scenes: names, samples, boxes, and what is refused."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from pcdbench.cloud import PointCloud
from pcdbench.datasets import scans
from pcdbench.datasets.clouds import Clouds
from pcdbench.errors import CloudError, PcdbenchError
from pcdbench.formats import CloudWarning, write_cloud

REAL = Path(os.environ.get("PCDBENCH_REAL_DATA", Path(__file__).parents[3] / "shared/data/real"))


def room(count=600, offset=(0, 0, 0), seed=0):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 4, (count, 3))
    points[np.arange(count), rng.integers(0, 3, count)] = 0  # a floor and two walls
    return PointCloud(points + np.array(offset), rng.uniform(0, 1, (count, 3)).astype(np.float32))


def opened(path, **options):
    return Clouds(path, Clouds.Options(**options))


def test_one_file_is_one_scene(tmp_path):
    room().write(tmp_path / "my room (1).ply")
    dataset = opened(tmp_path / "my room (1).ply", complete_points=200)
    assert dataset.splits() == ("all",) and dataset.default_split == "all" and dataset.draws("all") == 1
    assert dataset.scene_names("all") == ("my_room_1_",)
    scene = dataset.scene("my_room_1_")
    assert (len(scene.dense), len(scene.complete)) == (600, 200)
    np.testing.assert_array_equal(scene.dense.points[scene.complete_index], scene.complete.points)
    np.testing.assert_array_equal(scene.dense.colors[scene.complete_index], scene.complete.colors)
    assert scene.source == str(tmp_path / "my room (1).ply")


def test_small_clouds_are_complete_as_they_are(tmp_path):
    room(50).write(tmp_path / "a.ply")
    scene = opened(tmp_path).scene("a")
    np.testing.assert_array_equal(scene.complete_index, np.arange(50))


def test_complete_cloud_is_spaced_evenly(tmp_path):
    room(5000).write(tmp_path / "a.ply")
    complete = opened(tmp_path, complete_points=500).scene("a").complete.points
    at_random = room(5000).points[np.random.default_rng(1).choice(5000, 500, replace=False)]
    smallest = [cKDTree(points).query(points, k=2)[0][:, 1].min() for points in (complete, at_random)]
    assert smallest[0] > 5 * smallest[1]


def test_scene_is_decided_by_the_files_content(tmp_path):
    room().write(tmp_path / "a/one.ply")
    room(seed=1).write(tmp_path / "b/one.ply")
    (tmp_path / "c").mkdir()
    shutil.copy(tmp_path / "a/one.ply", tmp_path / "c/one.ply")
    first, other, same = (opened(tmp_path / folder, complete_points=100) for folder in "abc")
    np.testing.assert_array_equal(first.scene("one").complete_index, same.scene("one").complete_index)
    assert first.digest("one") == same.digest("one") != other.digest("one")


def test_digest_follows_the_cloud_its_name_and_its_boxes(tmp_path):
    room().write(tmp_path / "a.ply")
    shutil.copy(tmp_path / "a.ply", tmp_path / "b.ply")
    dataset = opened(tmp_path)
    digests = {dataset.digest("a"), dataset.digest("b")}
    (tmp_path / "a.boxes.json").write_text("[]")
    digests.add(dataset.digest("a"))
    room(seed=3).write(tmp_path / "a.ply")
    digests.add(dataset.digest("a"))
    assert len(digests) == 4


def test_folder_lists_all_formats_in_subfolders_and_nothing_else(tmp_path):
    for name in ("b.ply", "sub/c.las", "sub/deep/d.npz", "e.xyz", "f.txt", "g.PCD"):
        room(20).write(tmp_path / name)
    (tmp_path / "notes.txt").write_text("Scanned on Monday.\nThe door was 2 m wide.\n")
    (tmp_path / "poses.csv").write_text("frame,seconds\n1,2\n")
    (tmp_path / "image.png").write_bytes(b"x")
    room(20).write(tmp_path / ".hidden.ply")
    room(20).write(tmp_path / ".trash/old.ply")
    (tmp_path / "boxes.json").write_text("{}")
    assert opened(tmp_path).scene_names("all") == ("b", "e", "f", "g", "sub-c", "sub-deep-d")


def test_linked_folders_are_followed_once(tmp_path):
    for name in ("scans/b/one.ply", "elsewhere/two.ply", "elsewhere/sub/three.ply", "scans/.old/four.ply"):
        room(20).write(tmp_path / name)
    links = {
        "scans/link": "elsewhere",
        "scans/a": "scans/b",
        "scans/round": "scans",
        "scans/b/up": ".",
        "elsewhere/back": "scans/b",
    }
    for link, target in links.items():
        (tmp_path / link).symlink_to(tmp_path / target, target_is_directory=True)
    assert opened(tmp_path / "scans").scene_names("all") == ("b-one", "link-sub-three", "link-two")
    assert opened(tmp_path / "scans/link").scene_names("all") == ("back-one", "sub-three", "two")


def test_names_along_a_path_are_those_that_were_given(tmp_path, monkeypatch):
    (tmp_path / "far/Area_1").mkdir(parents=True)
    (tmp_path / "near").mkdir()
    (tmp_path / "near/Area_2").symlink_to(tmp_path / "far/Area_1")
    monkeypatch.chdir(tmp_path / "near")
    for path, meant in {".": "near", "Area_2": "near/Area_2", "..": "", "Area_2/../Area_1": "far/Area_1"}.items():
        assert scans.absolute_root("s3dis", Path(path)) == tmp_path / meant
    with pytest.raises(PcdbenchError, match=r"^clouds:~nobody-at-all/a: no home folder is known for ~nobody-at-all; "):
        opened(Path("~nobody-at-all/a")).scene_names("all")


def test_clashing_names_are_told_apart(tmp_path):
    for name in ("a.ply", "a.xyz", "b c.ply", "b_c.ply", "d/e.ply", "d-e.ply"):
        room(20).write(tmp_path / name)
    names = opened(tmp_path).scene_names("all")
    assert len({name.lower() for name in names}) == 6 and {"a.ply", "a.xyz"} <= set(names)
    assert sorted(len(opened(tmp_path).scene(name).dense) for name in names) == [20] * 6


@given(st.lists(st.text("aA .-_/éß(", min_size=1, max_size=6), min_size=1, max_size=12))
def test_names_are_safe_and_unique(texts):
    for longer in (None, [f"{text}.ply" for text in texts]):
        names = scans.scene_names(texts, longer)
        assert len({name.lower() for name in names}) == len(names) == len(texts)
        assert all(name and set(name) <= set("aA.-_plycoud0123456789éß") and name[0] != "." for name in names)


def test_letters_stay_however_a_system_spells_them():
    texts = ["küche", "ku\u0308che 2", "房间(1)", "..", "/"]
    assert scans.scene_names(texts) == ["küche", "küche_2", "房间_1_", "cloud", "_"]


def test_map_coordinates_stay(tmp_path):
    room(300, offset=(1.2e6, 7.6e6, 500)).write(tmp_path / "far.ply")
    scene = opened(tmp_path, complete_points=100).scene("far")
    expected = room(300, offset=(1.2e6, 7.6e6, 500)).points
    np.testing.assert_allclose(scene.dense.points, expected, rtol=0, atol=5e-5)
    assert len(np.unique(scene.complete.points, axis=0)) == 100


def test_what_a_completion_added_is_not_measured_against(tmp_path):
    cloud = room()
    added = np.arange(len(cloud)) >= 500
    write_cloud(cloud, tmp_path / "done.ply", {"added": added, "confidence": np.ones(len(cloud), np.float32)})
    with pytest.warns(CloudWarning, match="a completion added 100 of its points"):
        scene = opened(tmp_path / "done.ply").scene("done")
    np.testing.assert_allclose(scene.dense.points, cloud.points[:500], atol=1e-6)


def test_repeated_points_count_once(tmp_path):
    cloud = room(100)
    PointCloud.concatenate([cloud, cloud]).write(tmp_path / "twice.ply")
    dense = opened(tmp_path).scene("twice").dense
    np.testing.assert_allclose(dense.points, cloud.points, atol=1e-6)


@given(count=st.integers(10, 200), cells=st.integers(1, 6), seed=st.integers(0, 999))
def test_the_first_of_equal_points_stays(count, cells, seed):
    points = np.random.default_rng(seed).integers(-cells, cells, (count, 3)) * 0.25
    points[::3] *= -1  # -0.0 equals 0.0
    seen, first = set(), []
    for row, point in enumerate(points.tolist()):
        if tuple(point) not in seen:
            seen.add(tuple(point))
            first.append(row)
    np.testing.assert_array_equal(scans.without_duplicates(PointCloud(points)).points, points[first])


def test_huge_clouds_are_thinned_before_sampling(tmp_path, monkeypatch):
    room(3000).write(tmp_path / "huge.ply")
    monkeypatch.setattr(scans, "_MOST_TO_SAMPLE", 1000)
    scene = opened(tmp_path, complete_points=300).scene("huge")
    assert (len(scene.dense), len(scene.complete), len(set(scene.complete_index))) == (3000, 300, 300)
    np.testing.assert_array_equal(scene.dense.points[scene.complete_index], scene.complete.points)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((500, 3)), "has 1 distinct points; at least 10 are needed"),
        (np.random.default_rng(0).uniform(0, 4, (9, 3)), "has 9 distinct points"),
        (np.linspace(0, 5, 500)[:, None] * [1.0, 2.0, 0.5], "lie on one line"),
        (np.linspace(0, 5, 500)[:, None] * [1.0, 2.0, 0.5] + [1e6, 5e6, 100], "lie on one line"),
        (np.round(np.linspace(0, 5, 500)[:, None] * [1.0, 2.0, 0.5], 3), "lie on one line"),
        (np.vstack([np.linspace(0, 5, 500)[:, None] * [1.0, 2.0, 0.5], [1e8] * 3]), "lie on one line"),
        (np.vstack([np.random.default_rng(0).uniform(0, 4, (500, 3)), [1e8] * 3]), "1 point lies far from all others"),
        (
            np.concatenate([np.random.default_rng(n).uniform(0, 4, (500, 3)) + 5e6 * n for n in (0, 1)]),
            r"its points lie in two parts, 500 and 500 points, 4,999,99\d m apart; bring them into one frame",
        ),
    ],
)
def test_clouds_too_small_to_measure_are_refused(tmp_path, points, message):
    PointCloud(points).write(tmp_path / "small.npz")
    with pytest.raises(CloudError, match=rf"small\.npz.*{message}"):
        opened(tmp_path).scene("small")


def test_one_wall_is_enough(tmp_path):
    wall = np.random.default_rng(0).uniform(0, 4, (10, 3)) * [1, 0, 1]
    PointCloud(wall).write(tmp_path / "wall.npz")
    assert len(opened(tmp_path).scene("wall").complete) == 10


@pytest.mark.parametrize(
    ("factor", "length", "guess"),
    [(1000, r"\d,\d{3}", "millimetres"), (5000, r"\d\d,\d{3}", "millimetres"), (0.001, r"0\.00\d+", "kilometres")],
)
def test_odd_scales_are_asked_about_and_left(tmp_path, factor, length, guess):
    PointCloud(room().points * factor).write(tmp_path / "odd.npz")
    with pytest.warns(CloudWarning, match=rf"odd\.npz: its longest side is {length} m, .* {guess}"):
        scene = opened(tmp_path).scene("odd")
    np.testing.assert_allclose(scene.dense.points, room().points * factor)


def test_one_broken_file_costs_its_scene_alone(tmp_path):
    room().write(tmp_path / "good.ply")
    (tmp_path / "broken.ply").write_bytes((tmp_path / "good.ply").read_bytes()[:-50])
    dataset = opened(tmp_path)
    assert dataset.scene_names("all") == ("broken", "good")
    assert len(dataset.digest("broken")) == 64
    with pytest.raises(CloudError, match=r"broken\.ply is cut off"):
        dataset.scene("broken")
    assert len(dataset.scene("good").dense) == 600


@pytest.mark.timeout(20)
def test_a_pipe_is_no_cloud_and_is_not_waited_for(tmp_path):
    room().write(tmp_path / "good.ply")
    os.mkfifo(tmp_path / "pipe.ply")
    os.mkfifo(tmp_path / "notes.txt")
    dataset = opened(tmp_path)
    assert list(dataset.scene_names("all")) == ["good", "pipe"]
    for look in (dataset.digest, dataset.scene):
        with pytest.raises(CloudError, match=r"pipe\.ply"):
            look("pipe")


def test_wrong_paths_are_named(tmp_path):
    with pytest.raises(PcdbenchError, match="needs a file or folder: --dataset clouds:PATH"):
        opened(None).scene_names("all")
    with pytest.raises(PcdbenchError, match="nowhere: there is no such file or folder"):
        opened(tmp_path / "nowhere").scene_names("all")
    with pytest.raises(PcdbenchError, match=rf"{tmp_path} holds no cloud; .* \.ply \.pcd"):
        opened(tmp_path).scene_names("all")
    room().write(tmp_path / "a.ply")
    with pytest.raises(PcdbenchError, match="one split, all"):
        opened(tmp_path).scene_names("test")
    with pytest.raises(PcdbenchError, match="has no scene 'b'"):
        opened(tmp_path).scene("b")


def test_vanished_files_are_named(tmp_path):
    room().write(tmp_path / "a.ply")
    dataset = opened(tmp_path)
    dataset.scene_names("all")
    (tmp_path / "a.ply").unlink()
    for use in (dataset.scene, dataset.digest):
        with pytest.raises(CloudError, match=r"a\.ply"):
            use("a")


CHAIR = {"label": "chair", "min": [0, 1, 0], "max": [1, 3, 0.5], "points": 7}
DESK = {"label": "desk", "center": [1, 2, 3], "size": [2, 1, 1], "yaw_rad": 0.5}


def assert_chair_and_desk(objects):
    assert [item.label for item in objects] == ["chair", "desk"]
    np.testing.assert_allclose(objects[0].box.center, [0.5, 2, 0.25])
    np.testing.assert_allclose(objects[0].box.size, [1, 2, 0.5])
    assert objects[0].box.yaw_rad == 0 and objects[1].box.yaw_rad == 0.5


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("a.boxes.json", [CHAIR, DESK]),
        ("a.boxes.json", {"instances": [CHAIR, DESK]}),
        ("boxes.json", {"a.ply": [CHAIR, DESK], "b.ply": []}),
        ("boxes.json", {"a": {"instances": [CHAIR, DESK]}}),
    ],
)
def test_boxes_beside_a_cloud(tmp_path, file, content):
    for name in "ab":
        room(20).write(tmp_path / f"{name}.ply")
    (tmp_path / file).write_text(json.dumps(content))
    assert_chair_and_desk(opened(tmp_path).scene("a").objects)
    assert opened(tmp_path).scene("b").objects == ()


def test_boxes_may_begin_with_a_byte_order_mark(tmp_path):
    room().write(tmp_path / "a.ply")
    (tmp_path / "a.boxes.json").write_text(json.dumps([CHAIR, DESK]), encoding="utf-8-sig")
    assert_chair_and_desk(opened(tmp_path).scene("a").objects)


def test_boxes_that_name_no_cloud_belong_to_the_only_one(tmp_path):
    room(20).write(tmp_path / "a.ply")
    (tmp_path / "boxes.json").write_text(json.dumps({"classes": [], "instances": [CHAIR, DESK]}))
    assert_chair_and_desk(opened(tmp_path).scene("a").objects)
    room(20).write(tmp_path / "b.ply")
    with pytest.raises(CloudError, match=r"boxes\.json does not say which cloud"):
        opened(tmp_path).scene("a")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ('{"a": 5}', "the boxes of a.ply must be a list"),
        ("[3]", "box 1 of a.ply must look like"),
        (json.dumps([CHAIR, {**CHAIR, "label": ""}]), "box 2 of a.ply has no label"),
        (json.dumps([{"label": "chair"}]), "needs min and max, or center and size"),
        (json.dumps([{**CHAIR, "min": [0, 0]}]), "min must be three numbers"),
        (json.dumps([{**CHAIR, "min": [0, "1", 0]}]), "holds '1', which is not a finite number"),
        (json.dumps([{**CHAIR, "max": [0, float("nan"), 1]}]), "holds nan, which is not a finite number"),
        (json.dumps([{**CHAIR, "max": [-1, 3, 1]}]), "negative size"),
        (json.dumps([{**DESK, "yaw_rad": True}]), "yaw_rad holds True"),
        (json.dumps([{**DESK, "size": [1600, 800, 750]}]), "is 1,600 m long, the cloud .* m; give the box in metres"),
    ],
)
def test_malformed_boxes_are_named(tmp_path, content, message):
    room(20).write(tmp_path / "a.ply")
    (tmp_path / "a.boxes.json").write_text(content)
    with pytest.raises(CloudError, match=message) as caught:
        opened(tmp_path).scene("a")
    assert "a.boxes.json" in str(caught.value) and "\n" not in str(caught.value)


def test_real_office_with_its_instances(tmp_path):
    if not (REAL / "s3dis_office").exists():
        pytest.skip("the real scans are not here (PCDBENCH_REAL_DATA)")
    shutil.copy(REAL / "s3dis_office/room.ply", tmp_path / "room.ply")
    shutil.copy(REAL / "s3dis_office/instances.json", tmp_path / "boxes.json")
    scene = opened(tmp_path).scene("room")
    assert len(scene.objects) == 90 and len(scene.complete) == 20_000
    low, high = scene.dense.points.min(axis=0), scene.dense.points.max(axis=0)
    assert all(((item.box.center >= low) & (item.box.center <= high)).all() for item in scene.objects)
    largest = sorted(scene.objects, key=lambda item: item.box.size.prod())[-5:]
    assert all(item.box.contains(scene.complete.points, margin_m=0.01).any() for item in largest)


def test_real_rooms_are_scenes():
    if not (REAL / "offices/rooms").exists():
        pytest.skip("the real scans are not here (PCDBENCH_REAL_DATA)")
    dataset = opened(REAL / "offices/rooms")
    names = dataset.scene_names("all")
    assert len(names) == 12
    for name in names:
        scene = dataset.scene(name)
        assert scene.complete.colors is not None
        assert len(scene.complete) == min(20_000, len(scene.dense)) >= 4000
