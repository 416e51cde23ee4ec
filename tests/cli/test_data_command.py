"""`pcdbench data check`: what is there, what is wrong with it, how many scenes come out."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.cloud import PointCloud
from pcdbench.datasets.clouds import Clouds
from pcdbench.plugins import registry
from pcdbench.scene import Scene


def check(*arguments):
    return CliRunner().invoke(app, ["data", "check", *map(str, arguments)])


def room(count=600, seed=0, color=True):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 4, (count, 3))
    points[np.arange(count), rng.integers(0, 3, count)] = 0
    return PointCloud(points, rng.uniform(0, 1, (count, 3)).astype(np.float32) if color else None)


def write_s3dis(root):
    for area, name in ((1, "office_1"), (1, "office_2"), (3, "lobby_1")):
        folder = root / f"Area_{area}" / name
        (folder / "Annotations").mkdir(parents=True)
        rows = np.hstack([room().points, np.full((600, 3), 128)])
        np.savetxt(folder / f"{name}.txt", rows, "%.3f")
        np.savetxt(folder / "Annotations/wall_1.txt", rows[:400], "%.3f")
        np.savetxt(folder / "Annotations/chair_1.txt", rows[400:], "%.3f")
    return root


def test_a_folder_in_order_has_no_findings(tmp_path):
    room().write(tmp_path / "a.ply")
    room(seed=1).write(tmp_path / "b.ply")
    ended = check(f"clouds:{tmp_path}")
    assert ended.exit_code == 0, ended.stderr
    assert ended.stdout == f"clouds:{tmp_path}: 2 scenes, 2 come out, 0 findings\n"
    assert ended.stderr == ""


def test_everything_wrong_is_told_and_the_rest_comes_out(tmp_path):
    room().write(tmp_path / "good.ply")
    room(color=False).write(tmp_path / "grey.ply")
    PointCloud(room().points * 1000, room().colors).write(tmp_path / "millimetres.npz")
    points = room().points.copy()
    points[::6] = np.nan
    np.savez(tmp_path / "gaps.npz", points=points, colors=room().colors)
    (tmp_path / "cut.ply").write_bytes((tmp_path / "good.ply").read_bytes()[:-100])
    ended = check(f"clouds:{tmp_path}")
    assert ended.exit_code == 1
    told = ended.stdout.splitlines()
    assert any(line.startswith("cut: ") and "cut off" in line for line in told)
    assert "gaps" in told[1] and "100 of 600 points are not valid (NaN, or marked so): dropped" in told[1]
    assert "grey: it has no colour; what needs colour is skipped" in told
    assert any(
        "millimetres.npz: its longest side is" in line and "is its unit millimetres or centimetres?" in line
        for line in told
    )
    assert told[-2:] == [f"clouds:{tmp_path}: 5 scenes, 4 come out, 4 findings", "cannot be used: cut"]


def test_whatever_a_data_set_raises_is_a_finding_of_that_scene(tmp_path, monkeypatch):
    room().write(tmp_path / "a.ply")
    room(seed=1).write(tmp_path / "b.ply")

    def scene(self, name, real=Clouds.scene):
        return real(self, name) if name == "b" else Scene(name, rows=None)

    monkeypatch.setattr(Clouds, "scene", scene)
    ended = check(f"clouds:{tmp_path}")
    assert ended.exit_code == 1
    first, *rest = ended.stdout.splitlines()
    assert first.startswith("a: TypeError: ") and "'rows'" in first
    assert rest == [f"clouds:{tmp_path}: 2 scenes, 1 come out, 1 finding", "cannot be used: a"]


@pytest.mark.parametrize("rows", [np.arange(7), np.arange(600)[::-1], np.arange(600) + 1])
def test_rows_that_do_not_make_up_the_complete_cloud_are_told(tmp_path, monkeypatch, rows):
    room().write(tmp_path / "a.ply")

    def scene(self, name, real=Clouds.scene):
        return replace(real(self, name), complete_index=rows)

    monkeypatch.setattr(Clouds, "scene", scene)
    ended = check(f"clouds:{tmp_path}")
    assert ended.exit_code == 0
    assert ended.stdout.startswith("a: its complete_index does not name the rows of its dense cloud")


def test_s3dis_is_told_file_by_file_and_line_by_line(tmp_path):
    root = write_s3dis(tmp_path / "s3dis")
    path = root / "Area_1/office_1/Annotations/chair_1.txt"
    lines = path.read_bytes().split(b"\n")
    lines[4] = b"1.000 1.000 1.000 12\x108.000 128 128"
    path.write_bytes(b"\n".join(lines))
    ended = check(f"s3dis:{root}")
    assert ended.exit_code == 0, ended.stdout + ended.stderr
    first, *_, verdict, splits = ended.stdout.splitlines()
    assert first.startswith(
        "area1-office_1: Area_1/office_1/Annotations/chair_1.txt:5: a stray byte in '1.000 1.000 1.000 12\\x108.000"
    )
    assert verdict == f"s3dis:{root}: 3 scenes, 3 come out, 1 finding"
    assert splits == "splits: all (3), area1 (2), area3 (1)"
    assert check(f"s3dis:{root}", "--split", "area3").stdout == f"s3dis:{root}: 1 scene, 1 come out, 0 findings\n"


def test_json_holds_the_same(tmp_path):
    root = write_s3dis(tmp_path / "s3dis")
    (root / "Area_3/lobby_1/Annotations/chair_1.txt").write_text("")
    (root / "Area_3/empty_2").mkdir()
    ended = check(f"s3dis:{root}", "--format", "json", "--option", "s3dis.complete_points=100")
    assert ended.exit_code == 1
    content = json.loads(ended.stdout)
    assert content["usable"] == ["area1-office_1", "area1-office_2", "area3-lobby_1"]
    assert content["unusable"] == ["area3-empty_2"]
    assert content["splits"]["area3"] == ["area3-empty_2", "area3-lobby_1"]
    (empty, _) = content["scenes"]["area3-lobby_1"]
    assert empty["where"].endswith("chair_1.txt") and empty["problem"] == "it is empty"


def test_whatever_listing_scenes_raises_is_one_line(tiny_plugins, monkeypatch):
    cls = registry().get("dataset", "tiny").load()
    monkeypatch.setattr(cls, "scene_names", lambda self, split: sorted(self.path.iterdir()))
    result = check("tiny")
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert "data set 'tiny' cannot be used: AttributeError: 'NoneType' object has no attribute" in result.stderr


def test_posed_images_are_checked_too(tmp_path):
    np.savetxt(tmp_path / "frame-000000.pose.txt", np.eye(4))
    ended = check(f"rgbd:{tmp_path}")
    assert ended.exit_code == 1
    assert "none of its frames can be used (1 with no depth image)" in ended.stdout
    assert ended.stdout.splitlines()[-2] == f"rgbd:{tmp_path}: 1 scene, 0 come out, 1 finding"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cluods:x"], "did you mean clouds"),
        (["clouds:/nowhere"], "there is no such file or folder"),
        (["s3dis"], "needs the folder that holds Area_1"),
        (["clouds:/nowhere", "--option", "s3dis.draws=2"], "'s3dis' is not the data set 'clouds'"),
    ],
)
def test_wrong_use_is_one_line(arguments, message):
    ended = check(*arguments)
    assert ended.exit_code == 2 and message in ended.stderr and ended.stderr.count("\n") == 1
