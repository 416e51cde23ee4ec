"""`pcdbench complete` as a user runs it: every format, exactly what was observed, and one line for each mistake."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.cloud import PointCloud
from pcdbench.formats import EXTENSIONS, read_cloud_and_fields, write_cloud

OFFSET = np.array([1_000_000.0, 2_000_000.0, 100.0])


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A function that runs `pcdbench complete` in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments, code=0):
        monkeypatch.setattr(sys, "argv", ["pcdbench", "complete", *map(str, arguments)])
        ended = CliRunner().invoke(app, ["complete", *map(str, arguments)])
        assert ended.exit_code == code, (ended.stderr, ended.exception)
        return ended.stderr

    return command


def floor(color=True, offset=OFFSET):
    """A floor of 4 x 4 m, 9 cm spacing, with a hole of 0.7 m radius, on a grid of a tenth of a millimetre."""
    rng = np.random.default_rng(0)
    points = rng.random((2000, 3)) * [4, 4, 0]
    points = np.round(points[np.linalg.norm(points - [2.0, 2.0, 0], axis=1) > 0.7] + offset, 4)
    colors = np.float32(rng.integers(0, 256, points.shape) / np.float32(255)) if color else None
    return PointCloud(points, colors)


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_every_format_keeps_what_was_observed_and_marks_what_was_added(run, extension):
    path = Path(f"scan{extension}")
    floor().write(path)
    scan = PointCloud.read(path)
    said = run(path, "-o", f"out{extension}", "--completer", "plane_fitting")
    done = PointCloud.read(f"out{extension}")
    count = len(scan)
    assert len(done) - count > 100
    if extension in (".e57", ".pts"):
        np.testing.assert_allclose(done.points[:count], scan.points, atol=1e-6)
        assert f"pcdbench: {extension} cannot mark points: the last" in said
    else:
        if extension in (".las", ".laz"):
            # Whole steps from another offset: equal to the last digit of a double.
            np.testing.assert_allclose(done.points[:count], scan.points, rtol=0, atol=1e-9)
        else:
            np.testing.assert_array_equal(done.points[:count], scan.points)
        fields = read_cloud_and_fields(Path(f"out{extension}"))[1]
        np.testing.assert_array_equal(fields["added"], np.arange(len(done)) >= count)
        assert (fields["confidence"][:count] == 1).all() and fields["confidence"].min() >= 0
        assert (fields["confidence"][count:] < 1).any() and "cannot mark" not in said
    np.testing.assert_array_equal(done.colors[:count], scan.colors)
    middle = done.points[count:] - OFFSET - [2.0, 2.0, 0]
    assert (np.linalg.norm(middle, axis=1) < 0.75).mean() > 0.9


@pytest.mark.parametrize("extension", [".ply", ".pcd", ".csv", ".npz", ".laz"])
def test_further_fields_of_observed_points_are_kept(run, extension):
    scan = floor(offset=np.zeros(3))
    label, time_s = np.arange(len(scan)) % 7, np.arange(len(scan)) + 0.25
    write_cloud(scan, Path("scan.npz"), {"label": label.astype(np.int16), "gps_time": time_s})
    run("scan.npz", "-o", f"out{extension}", "--completer", "plane_fitting")
    fields = read_cloud_and_fields(Path(f"out{extension}"))[1]
    assert set(fields) == {"label", "gps_time", "added", "confidence"}
    seen = fields["added"] == 0
    np.testing.assert_array_equal(fields["label"][seen], label)
    np.testing.assert_array_equal(fields["gps_time"][seen], time_s)
    unknown = fields["gps_time"][~seen]
    assert len(unknown) and (unknown == 0 if extension == ".laz" else np.isnan(unknown)).all()
    assert not fields["label"][~seen].any()


def test_a_scans_own_confidence_is_kept_beside_and_added_points_are_opaque(run):
    scan = floor(offset=np.zeros(3))
    fields = {"confidence": np.full(len(scan), 0.5, np.float32), "alpha": np.full(len(scan), 200, np.uint8)}
    write_cloud(scan, Path("scan.ply"), fields)
    said = run("scan.ply", "-o", "out.ply", "--completer", "plane_fitting")
    assert "pcdbench: of the fields of scan.ply confidence is written as confidence_scan" in said
    found = read_cloud_and_fields(Path("out.ply"))[1]
    assert (found["confidence_scan"][: len(scan)] == 0.5).all() and (found["confidence"][: len(scan)] == 1).all()
    assert (found["alpha"] == 200).all() and (found["added"] == 1).any()
    write_cloud(scan, Path("scan.ply"), fields | {"confidence_scan": np.full(len(scan), 7, np.uint8)})
    said = run("scan.ply", "-o", "out.ply", "--completer", "plane_fitting")
    assert "pcdbench: of the fields of scan.ply confidence is written as confidence_scan_2" in said
    found = read_cloud_and_fields(Path("out.ply"))[1]
    assert (found["confidence_scan"][: len(scan)] == 7).all() and (found["confidence_scan_2"][: len(scan)] == 0.5).all()


def test_what_e57_cannot_hold_is_told(run):
    scan = floor(offset=np.zeros(3))
    write_cloud(scan, Path("scan.ply"), {"label": np.zeros(len(scan)), "time": np.zeros(len(scan))})
    said = run("scan.ply", "-o", "out.e57", "--completer", "plane_fitting")
    assert "pcdbench: .e57 cannot hold label, time of scan.ply: left out" in said


def test_completing_again_begins_from_what_was_observed(run):
    floor().write("scan.ply")
    first = run("scan.ply", "-o", "once.ply", "--completer", "plane_fitting")
    said = run("once.ply", "-o", "twice.ply", "--completer", "plane_fitting")
    assert "a completion added" in said and "a completion added" not in first
    assert Path("twice.ply").read_bytes() == Path("once.ply").read_bytes()


def test_formats_mix_and_single_precision_stays(run):
    scan = floor(color=False, offset=np.zeros(3))
    PointCloud(scan.points.astype(np.float32)).write("scan.pcd")
    run("scan.pcd", "-o", "new/out.ply", "--completer", "plane_fitting")
    header = Path("new/out.ply").read_bytes()[:300]
    assert b"property float x" in header and b"property uchar added" in header and b"red" not in header
    done = PointCloud.read("new/out.ply")
    np.testing.assert_array_equal(done.points[: len(scan)], PointCloud.read("scan.pcd").points)


def test_added_only_report_options_and_axes(run):
    scan = floor()
    turned = PointCloud((scan.points - OFFSET)[:, [1, 2, 0]], scan.colors)
    turned.write("scan.npz")
    said = run(
        *("scan.npz", "-o", "added.ply", "--completer", "plane_fitting", "--up", "y", "--added-only"),
        *(
            "--report",
            "again",
            "--option",
            "plane_fitting.min_points=50",
            "--tile-m",
            "8",
            "--seed",
            "3",
            "--runs",
            "2",
        ),
    )
    added = PointCloud.read("added.ply")
    assert 100 < len(added) < 1000 and (np.abs(added.points[:, 1]) < 0.05).all()
    assert (read_cloud_and_fields(Path("added.ply"))[1]["added"] == 1).all()
    assert "again/report.md: " in said
    assert f"added.ply: the {len(added):,} points that plane_fitting added to {len(scan):,} observed ones\n" in said
    assert "100 % of" in said
    assert json.loads(Path("again/report.json").read_text())["added_points"] == len(added)


def test_mistakes_are_one_line(run):
    floor(offset=np.zeros(3)).write("scan.ply")
    PointCloud(np.random.default_rng(0).random((20, 3))).write("few.ply")
    PointCloud(np.linspace(0, 5, 1000)[:, None] * [1.0, 2.0, 0.5]).write("line.ply")
    plane = ("--completer", "plane_fitting")
    endless = "a" * 300 + ".ply"
    for arguments, message in (
        (("missing.ply", "-o", "out.ply", *plane), "missing.ply: there is no such file"),
        (("scan.ply", "-o", "out.ply", "--completer", "plane_fiting"), "did you mean plane_fitting"),
        (("scan.ply", "-o", "out.docx", *plane), "out.docx: .docx is not a format; use one of .ply"),
        (("scan.ply", "-o", "scan.ply", *plane), "scan.ply is the scan itself"),
        (("scan.ply", "-o", "./scan.ply", *plane), "scan.ply is the scan itself"),
        (("few.ply", "-o", "out.ply", *plane), "the cloud has 20 points; at least 50"),
        (("scan.ply", "-o", "out.ply", *plane, "--up", "north"), "up axis 'north' is none of"),
        (("scan.ply", "-o", "out.ply", *plane, "--option", "plane_fitting.distanc_m=1"), "did you mean distance_m?"),
        (("scan.ply", "-o", "out.ply", *plane, "--option", "hole_filling.link=3"), "'hole_filling' is not in this run"),
        (("scan.ply", "-o", "out.ply", "--completer", "incomplete"), "a reference to measure against"),
        ((endless, "-o", "out.ply", *plane), f"{endless} cannot be read: File name too long"),
        (("scan.ply", "-o", endless, *plane), f"{endless}: File name too long; check the path"),
        (("scan.ply", "-o", "out.ply", "--report", endless, *plane), f"{endless} cannot be written: File name too"),
        (("line.ply", "-o", "out.ply", *plane), "line.ply: its 1,000 points lie on one line"),
    ):
        said = run(*arguments, code=2)
        assert message in said and said.count("\n") == 1 and said.startswith("pcdbench: "), said
    assert not Path("out.ply").exists()


def test_places_that_cannot_be_written_are_found_before_the_scan_is_read(run):
    Path("file").touch()
    Path("folder.ply").mkdir()
    Path("mine").mkdir()
    Path("mine/report.md").write_text("notes")
    Path("other").mkdir()
    Path("other/report.json").write_text("[1]")
    before = sorted(Path().rglob("*"))
    completed = ("missing.ply", "--completer", "plane_fitting", "-o")
    for arguments, message in (
        (("file/out.ply",), "file cannot be written: Not a directory; choose another place"),
        (("folder.ply",), "folder.ply is a folder; name a file in it"),
        (("out.ply", "--report", "file/again"), "file/again cannot be written: Not a directory"),
        (
            ("out.ply", "--report", "mine"),
            "mine holds a report.md that is no report of pcdbench; give --report another",
        ),
        (("out.ply", "--report", "other"), "other holds a report.json that is no report of pcdbench"),
        (("new/out.ply", "--report", "new/again"), "missing.ply: there is no such file"),
    ):
        said = run(*completed, *arguments, code=2)
        assert message in said and said.count("\n") == 1, said
    assert sorted(Path().rglob("*")) == before and Path("mine/report.md").read_text() == "notes"


def test_a_report_replaces_a_report(run):
    floor(offset=np.zeros(3)).write("scan.ply")
    for _ in range(2):
        run("scan.ply", "-o", "out.ply", "--completer", "hole_filling", "--report", "again")
    assert sorted(path.name for path in Path("again").iterdir()) == ["report.json", "report.md", "report.png"]


@pytest.mark.parametrize(
    ("factor", "points", "reason"),
    [(39.37, 2000, "are they too few, or is its unit not metres?"), (1.0, 60, "too few"), (1.0, 2000, "found no gap")],
)
def test_why_nothing_was_added_is_said(run, factor, points, reason):
    scan = floor(color=False, offset=np.zeros(3))
    if reason == "found no gap":
        scan = PointCloud(np.random.default_rng(0).random((points, 3)) * [4, 4, 0])
    PointCloud(scan.points[:points] * factor).write("scan.ply")
    option = ("--option", "plane_fitting.min_points=100")
    said = run("scan.ply", "-o", "out.ply", "--completer", "plane_fitting", *option)
    assert " 0 added" in said and said.count("pcdbench: plane_fitting added nothing: ") == 1 and reason in said


def test_units_are_asked_for(run):
    scan = floor(color=False, offset=np.zeros(3))
    PointCloud(scan.points * 1000).write("mm.ply")
    said = run("mm.ply", "-o", "out.ply", "--completer", "plane_fitting")
    assert "pcdbench: mm.ply: the longest side is 4,00" in said or "pcdbench: mm.ply: the longest side is 3,99" in said
    assert "is its unit millimetres or centimetres? Multiply its coordinates by 0.001" in said


def test_a_stray_point_is_not_a_wrong_unit(run):
    scan = floor(color=False)
    PointCloud(np.vstack([scan.points, [0, 0, 0]])).write("stray.npz")
    said = run("stray.npz", "-o", "out.npz", "--completer", "plane_fitting")
    assert "stray.npz: 1 point lies far from all others, at (0.0, 0.0, 0.0); delete it from the scan" in said
    assert "its unit" not in said
