"""`pcdbench view` as a user runs it."""

import os
from html import escape
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from pcdbench import PointCloud, Scene
from pcdbench.cli import app
from pcdbench.formats import write_cloud


@pytest.fixture
def scans(room: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder, the current one, with `a.ply` and its completion `b.laz`."""
    monkeypatch.chdir(tmp_path)
    cloud = room.complete
    cloud.select(np.arange(len(cloud)) % 4 > 0).write("a.ply")
    cloud.write("b.laz")
    return tmp_path


def view(*arguments: str, code: int = 0) -> Result:
    ended = CliRunner().invoke(app, ["view", *arguments])
    assert ended.exit_code == code, (ended.output, ended.exception)
    return ended


def test_a_page_of_two_clouds_of_two_formats(scans: Path) -> None:
    ended = view("a.ply", "b.laz", "--reference", "b.laz", "-o", "pages/both.html")
    page = (scans / "pages" / "both.html").read_text()
    size = (scans / "pages" / "both.html").stat().st_size / 1e6
    assert ended.stdout == f"pages/both.html: 2 clouds, 7,000 points, {size:.1f} MB; open it in a browser\n"
    assert "4,000 points · 1,000 not in a.ply (25%)" in page and "to the reference: median 0.000 m" in page


def test_one_cloud_thinned(scans: Path) -> None:
    assert view("a.ply", "--points", "500").stdout.startswith("view.html: 1 cloud, 500 points, ")
    assert "3,000 points · thinned to 500" in (scans / "view.html").read_text()


@pytest.mark.parametrize("extension", ["ply", "pcd", "npz", "las", "txt"])
def test_the_field_added_of_a_file_says_what_was_added(scans: Path, room: Scene, extension: str) -> None:
    marks = np.zeros(len(room.complete), np.uint8)
    marks[:120] = 1
    write_cloud(room.complete, scans / f"done.{extension}", {"added": marks})
    view("a.ply", f"done.{extension}")
    assert "4,000 points · 120 added (3%)" in (scans / "view.html").read_text()


def test_the_field_confidence_of_a_file_is_shown_where_it_is_one(scans: Path, room: Scene) -> None:
    trust = np.linspace(0, 1, len(room.complete), dtype=np.float32)
    write_cloud(room.complete, scans / "done.ply", {"confidence": trust})
    assert view("done.ply").stderr == ""
    assert 'data-mode="confidence"' in (scans / "view.html").read_text()
    write_cloud(room.complete, scans / "phone.ply", {"confidence": 2 * trust})
    told = "pcdbench: phone.ply: its field confidence is not one number in [0, 1] of each point, and is not shown\n"
    assert view("phone.ply").stderr == told
    assert 'data-mode="confidence"' not in (scans / "view.html").read_text()


@pytest.mark.parametrize("marks", [np.linspace(1, 2, 4000), np.zeros((4000, 2))])
def test_a_field_added_that_marks_nothing_is_not_shown(scans: Path, room: Scene, marks: np.ndarray) -> None:
    write_cloud(room.complete, scans / "other.npz", {"added": marks, "confidence": np.ones((4000, 3))})
    first, second = view("other.npz").stderr.splitlines()
    assert first == "pcdbench: other.npz: its field added is not 0 or 1 of each point, and is not shown"
    assert "its field confidence is not one number in [0, 1]" in second
    assert "added (" not in (scans / "view.html").read_text()


def test_another_axis_may_be_up(scans: Path, room: Scene) -> None:
    turned = room.complete.points[:, [1, 2, 0]]  # its y axis is the room's z axis
    PointCloud(turned, room.complete.colors).write("turned.npz")
    room.complete.write("upright.npz")
    pages = []
    for arguments in (("upright.npz",), ("turned.npz", "--up", "y"), ("turned.npz",)):
        view(*arguments, "-o", "page.html")
        pages.append((scans / "page.html").read_text().replace("turned", "upright"))
    assert pages[0] == pages[1] != pages[2]


def test_dropped_rows_are_told_and_their_marks_dropped_with_them(scans: Path) -> None:
    rows = np.column_stack([np.random.default_rng(0).random((100, 3)), np.ones(100)])
    rows[3, 0], rows[4, 3] = np.nan, 0
    np.savetxt("c.txt", rows, header="x y z added")
    ended = view("c.txt")
    assert ended.stderr == "pcdbench: c.txt: 1 of 100 points are not valid (NaN, or marked so): dropped\n"
    assert "<span>99 points · no colour · 98 added (99%)</span>" in (scans / "view.html").read_text()


def test_files_of_one_name_are_told_apart_by_their_folders(scans: Path, cloud: PointCloud) -> None:
    cloud.write("x/room.ply")
    cloud.write("y/room.ply")
    view("x/room.ply", "y/room.ply")
    page = (scans / "view.html").read_text()
    assert "<strong>x/room.ply</strong>" in page and "<strong>y/room.ply</strong>" in page


@pytest.mark.parametrize("name", ["<script>alert(1)<&>\"'.ply", "ü\n.ply", os.fsdecode(b"caf\xe9.ply")])
def test_any_file_name_is_shown_as_it_is(scans: Path, cloud: PointCloud, name: str) -> None:
    cloud.write(name)
    view("a.ply", name)
    page = (scans / "view.html").read_text(encoding="utf-8")
    assert f"<strong>{escape(name.encode(errors='replace').decode())}</strong>" in page
    assert page.count("<script") == 2


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere.ply"], "nowhere.ply: there is no such file; check the path"),
        (["a.ply", "-o", "b.laz"], "b.laz is no name for a page; let it end in .html"),
        (["a.ply", "a.ply"], "a.ply is given twice; give each cloud once"),
        (["a.ply", "--up", "w"], "up axis 'w' is none of z y x -z -y -x; --up y suits most phone apps"),
        (["a.ply", "--points", "0"], "0 points cannot be viewed; show at least 1 of each cloud"),
        (["a.ply", "--reference", "no.ply"], "no.ply: there is no such file; check the path"),
        (["a.ply", "-o", "a.ply/x.html"], "a.ply/x.html cannot be written: File exists; choose another place"),
    ],
)
def test_mistakes_are_one_line_and_exit_2(scans: Path, arguments: list[str], says: str) -> None:
    ended = view(*arguments, code=2)
    assert ended.stderr == f"pcdbench: {says}\n" and ended.stdout == ""
    assert sorted(path.name for path in scans.iterdir()) == ["a.ply", "b.laz"]


def test_clouds_too_far_apart_to_be_told_apart_are_named(scans: Path, room: Scene) -> None:
    PointCloud(room.complete.points + np.array([5e6, 0, 0])).write("far.las")
    said = view("a.ply", "far.las").stderr
    assert said.startswith("pcdbench: a.ply, far.las: 5,000,0") and "in steps of 76 m, too coarse for a.ply" in said
    assert said.count("\n") == 1
    assert view("a.ply", "b.laz").stderr == ""
