"""Confidence falls where completion errs, and the report names what to scan again."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from completion_cases import Floor, hall, without
from scipy.spatial import cKDTree
from scipy.stats import spearmanr

import pcdbench
from pcdbench import Completer, PointCloud
from pcdbench.completion import CompletionWarning, completing
from pcdbench.completion.confidence import factors
from pcdbench.completion.evidence import evidence
from pcdbench.completion.gaps import _union, open_gaps
from pcdbench.completion.regions import regions_to_scan
from pcdbench.completion.report import _free_places, _plan, write_report
from pcdbench.completion.surface import local_planes
from pcdbench.completion.tiles import typical_spacing
from pcdbench.datasets.synthetic import Indoor
from pcdbench.geometry.frames import Frame
from pcdbench.geometry.sampling import poisson_disk_indices
from pcdbench.open3d_loader import load_open3d


def distance_to_surface(scene, points):
    o3d = load_open3d()
    casting = o3d.t.geometry.RaycastingScene()
    casting.add_triangles(
        o3d.core.Tensor(scene.surface.vertices.astype(np.float32)),
        o3d.core.Tensor(scene.surface.triangles.astype(np.uint32)),
    )
    return casting.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def with_holes(cloud, level, seed):
    rng = np.random.default_rng(seed)
    tree, kept = cKDTree(cloud.points), np.ones(len(cloud), bool)
    while kept.mean() > 1 - level:
        _, near = tree.query(cloud.points[rng.integers(len(cloud))], k=int(0.03 * len(cloud)))
        kept[near] = False
    return cloud.select(kept)


@pytest.mark.parametrize(("completer", "strength"), [("plane_fitting", -0.2), ("hole_filling", -0.4)])
def test_errors_fall_with_confidence(completer, strength):
    # Rooms that the formula was not chosen on; one draw of holes in one room says little of either.
    found = []
    for name in Indoor().scene_names("smoke"):
        scene = Indoor().scene(name)
        thin = scene.complete.select(poisson_disk_indices(scene.complete.points, 9000, np.random.default_rng(0)))
        for seed in (1, 2, 3):
            done = pcdbench.complete(with_holes(thin, 0.4, seed), completer)
            error, trust = distance_to_surface(scene, done.added_cloud.points), done.confidence[done.added]
            order, third = np.argsort(trust), len(trust) // 3
            thirds = error[order[-third:]].mean() / error[order[:third]].mean()
            found.append((spearmanr(trust, error)[0], thirds))
    correlation, thirds = np.mean(found, axis=0)
    assert correlation < strength
    assert thirds < 0.5


def plane(spacing_m=0.05, size_m=4.0, height_m=0.0):
    steps = np.arange(0, size_m, spacing_m)
    return np.stack(np.meshgrid(steps, steps, [height_m]), axis=-1).reshape(-1, 3)


def test_factors_are_what_the_formula_says():
    observed = plane()
    observed = observed[np.linalg.norm(observed - [2, 2, 0], axis=1) > 0.5]
    up = np.tile([0.0, 0.0, 1.0], (len(observed), 1))
    asked = np.array([[2.0, 2.0, 0.0], [2.0, 2.0, 0.1], [5.0, 2.0, 0.0]])
    found = evidence(asked, up[:3], observed, up, 0.05, np.random.default_rng(0))
    nearest, _ = cKDTree(observed).query(asked)
    np.testing.assert_allclose(found[:, 0], np.exp(-nearest / 2))
    np.testing.assert_allclose(found[:, 1], [1.0, np.exp(-2.0), 1.0], atol=1e-9)
    assert found[0, 2] == 1.0, "the middle of the hole is enclosed on all sides"
    assert 0.5 < found[2, 2] <= 0.75, "beyond the edge it is not"
    assert evidence(asked[:0], up[:0], observed, up, 0.05, np.random.default_rng(0)).shape == (0, 3)
    whole = factors(found, np.array([0, 1, 2]), np.array([0, 1, 5]), np.array([0.2, 1.0, 0.9]))
    np.testing.assert_allclose(whole[:, 3:], [[1.0, 0.2], [1.0, 1.0], [0.5, 0.9]])
    np.testing.assert_array_equal(whole[:, :3], found)


class Sure(Completer):
    """Lays a floor, and is sure of its left half alone; what it says can be replaced."""

    def __init__(self, says=None):
        super().__init__()
        self.says = says

    def complete(self, cloud, rng):
        return self.complete_with_confidence(cloud, rng)[0]

    def complete_with_confidence(self, cloud, rng):
        floor = Floor(0.08).complete(cloud, rng)
        left = floor.points[:, 0] < (cloud.points[:, 0].min() + cloud.points[:, 0].max()) / 2
        return floor, np.where(left, 1.0, 0.25) if self.says is None else self.says(len(floor))


def test_what_the_completer_says_of_itself_lowers_the_confidence():
    scan = without(hall(0.1, (6.0, 5.0), color=False), (3.0, 2.5, 0.0), 1.2)
    middle = scan.points.min(axis=0)[0] + np.ptp(scan.points[:, 0]) / 2
    unsure, silent = (pcdbench.complete(scan, completer, tile_m=20.0) for completer in (Sure(), Floor(0.08)))
    np.testing.assert_array_equal(unsure.cloud.points, silent.cloud.points)
    x = unsure.added_cloud.points[:, 0]
    ratio = unsure.confidence[unsure.added] / silent.confidence[silent.added]
    left, right = x < middle - 0.3, x > middle + 0.3
    assert left.sum() > 100 and right.sum() > 100
    np.testing.assert_allclose(ratio[left], 1.0, rtol=1e-5)
    np.testing.assert_allclose(ratio[right], 0.25, rtol=1e-5)
    reasons = {region.reason for region in regions_to_scan(unsure)} - {
        region.reason for region in regions_to_scan(silent)
    }
    assert reasons == {"the completer itself is unsure of it"}


@pytest.mark.parametrize(
    ("says", "message"),
    [
        (lambda count: np.ones(count - 1), r"its confidence has shape \(\d+,\); one number a point"),
        (lambda count: ["high"] * count, r"its confidence is not numbers .*; one a point is wanted"),
        (lambda count: np.full(count, 1.01), r"must lie in \[0, 1\]"),
        (lambda count: np.full(count, np.nan), r"must lie in \[0, 1\]"),
    ],
)
def test_a_confidence_that_is_none_is_refused(says, message):
    with pytest.warns(CompletionWarning), pytest.raises(pcdbench.PcdbenchError, match=message):
        pcdbench.complete(hall(0.3, (4, 4), color=False), Sure(says))


class Fickle(Completer):
    """Puts a patch on the floor's hole, and another somewhere else on every run."""

    def complete(self, cloud, rng):
        patch = plane(0.06, 1.6) - [0.8, 0.8, 0]
        hole = patch + np.array([6.0 - CENTER[0], 4.0 - CENTER[1], cloud.points[:, 2].min()])
        loose = patch + rng.uniform(-1, 1, 3) * [2, 2, 0.6]
        return PointCloud(np.concatenate([cloud.points, hole, loose]))


CENTER = np.array([10.0, 10.0])


def test_runs_that_disagree_lower_the_confidence():
    scan = without(hall(0.1, color=False), (6.0, 4.0, 0.0), 0.8)
    done = pcdbench.complete(scan, Fickle(), runs=3, tile_m=20.0)
    added, trust = done.added_cloud.points, done.confidence[done.added]
    agreed = np.linalg.norm(added - [6.0, 4.0, 0.0], axis=1) < 0.7
    loose = np.abs(added[:, 2]) > 0.15
    assert agreed.sum() > 100 and loose.sum() > 100
    assert np.median(trust[agreed]) > 0.7 > 0.4 > np.median(trust[loose])
    regions = regions_to_scan(done)
    assert any(region.confidence is not None and region.center_m[2] > 0.1 for region in regions)


def turned(points, degrees):
    """The points turned upright about x, so that their plane is a wall's, and then about z."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points[:, [0, 2, 1]] @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])


@pytest.mark.parametrize("radius_m", [0.4, 0.6, 1.0])
def test_gaps_are_measured_and_edges_are_none(radius_m):
    points = plane()
    points = points[np.linalg.norm(points - [2, 2, 0], axis=1) > radius_m]
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    places, areas = open_gaps(points, up, np.full(len(points), 0.05), points)
    assert areas.sum() == pytest.approx(np.pi * radius_m**2, rel=0.2)
    assert np.linalg.norm(places - [2, 2, 0], axis=1).max() < radius_m, "not the edge of the plane"
    np.testing.assert_allclose(np.ptp(places, axis=0), [2 * radius_m, 2 * radius_m, 0], atol=0.1)


def test_gaps_of_irregular_samples_are_neither_counted_twice_nor_slit():
    rng = np.random.default_rng(0)
    drawn = rng.random((32_000, 3)) * [4, 4, 0] + rng.normal(0, 0.004, (32_000, 3))
    points = drawn[poisson_disk_indices(drawn, 6400, rng)]
    points = points[np.linalg.norm(points - [2, 2, 0], axis=1) > 0.8]
    _, areas = open_gaps(points, local_planes(points)[0], np.full(len(points), 0.05), points)
    assert 0.75 < areas.sum() / (np.pi * 0.8**2) < 1.1


def test_a_strip_alone_is_no_gap():
    steps = np.arange(0, 1.5, 0.0125)
    strip = np.stack(np.meshgrid(steps, steps[:4], [0.0]), axis=-1).reshape(-1, 3)
    beside = np.concatenate([strip + np.array([0, 0.1 * number, 0]) for number in range(5)])
    areas = [_union(samples, np.tile([0.0, 0.0, 1.0], (len(samples), 1)), 0.05)[2] for samples in (strip, beside)]
    assert areas[0].sum() == 0
    # Slits between strips are filled.
    assert areas[1].sum() == pytest.approx(1.5 * 0.45, rel=0.1)


@pytest.mark.parametrize(("beneath_m", "is_gap"), [(None, True), (0.7, False), (0.1, True), (2.0, True)])
def test_the_floor_seen_between_two_tables_tells_that_they_are_two(beneath_m, is_gap):
    tables = plane(height_m=0.7)
    tables = tables[np.abs(tables[:, 0] - 2) > 0.5]
    up = np.tile([0.0, 0.0, 1.0], (len(tables), 1))
    beneath = np.empty((0, 3)) if beneath_m is None else plane(height_m=0.7 - beneath_m)
    between = np.abs(beneath[:, 0] - 2) <= 0.5
    _, areas = open_gaps(tables, up, np.full(len(tables), 0.05), np.concatenate([tables, beneath[between]]))
    assert areas.sum() == (pytest.approx(4 * 1.0, rel=0.15) if is_gap else 0.0)


@pytest.mark.parametrize("degrees", [0, 45])
def test_a_gap_in_a_wall_is_one_whatever_lies_beneath(degrees):
    wall = plane()
    wall = turned(wall[np.linalg.norm(wall - [2, 2, 0], axis=1) > 0.6], degrees)
    # Normals that are a little off must not make two grids of one wall.
    sideways = turned(np.tile([0.0, 0.0, 1.0], (len(wall), 1)), degrees)
    sideways = sideways + np.random.default_rng(0).normal(0, 0.03, wall.shape)
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    seen = np.concatenate([wall, plane() - [2, 2, 0]])
    places, areas = open_gaps(wall, sideways, np.full(len(wall), 0.05), seen)
    assert areas.sum() == pytest.approx(np.pi * 0.6**2, rel=0.2)
    assert np.ptp(places[:, 2]) == pytest.approx(1.2, abs=0.15)


class Idle(Completer):
    def complete(self, cloud, rng):
        return cloud


@pytest.fixture(scope="module")
def planted():
    """A hall with a hole of 1 m radius in its floor, at map coordinates, y up, which nobody filled."""
    scan = without(hall(size=(7.0, 6.0)), (4.0, 3.0, 0.0), 1.0)
    # y up: the hall's x, y, z become z, x, y.
    points = scan.points[:, [1, 2, 0]] + [5000.0, 100.0, -3000.0]
    return pcdbench.complete(PointCloud(points, scan.colors), Idle(), up="y")


def test_the_report_lists_a_planted_hole(planted, tmp_path):
    regions = write_report(planted, tmp_path / "a" / "report", "hall.ply", "idle")
    first = regions[0]
    # All in the scan's own frame, in which y is up.
    np.testing.assert_allclose(first.center_m, [5003.0, 100.0, -2996.0], atol=0.25)
    np.testing.assert_allclose(first.size_m, [2.0, 0.0, 2.0], atol=0.35)
    np.testing.assert_allclose(np.add(first.low_m, first.high_m) / 2, first.center_m, atol=0.02)
    np.testing.assert_allclose(np.subtract(first.high_m, first.low_m), first.size_m, atol=0.02)
    assert 0.7 * np.pi < first.area_m2 < 1.1 * np.pi and first.confidence is None
    assert "left open" in first.reason and [region.number for region in regions] == list(range(1, len(regions) + 1))
    assert all(a.area_m2 >= b.area_m2 for a, b in pairwise(regions))
    facts = json.loads((tmp_path / "a/report/report.json").read_text())
    assert facts["regions"][0]["center_m"] == list(first.center_m) and facts["added_points"] == 0
    assert facts["up"] == "y" and facts["frame"].startswith("the scan's own")
    assert facts["observed_m2"] == pytest.approx(7 * 6 + 13 * 2.5, rel=0.2)
    page = (tmp_path / "a/report/report.md").read_text()
    assert "| 1 | 5003." in page and "in the scan's own frame (y is up)" in page and "a gap in a surface" in page
    assert (tmp_path / "a/report/report.png").stat().st_size > 10_000


def test_large_clusters_are_cut_into_what_can_be_scanned_again(planted):
    steps = np.arange(0, 6.5, 0.05)
    gap = np.stack(np.meshgrid(steps, steps[:20], [0.0]), axis=-1).reshape(-1, 3)
    small = gap[(gap < 0.4).all(axis=1)] + [0, 3, 0]
    places = np.concatenate([gap, small])
    wide = replace(planted, gaps=places, gaps_m2=np.full(len(places), 0.05**2), frame=Frame.with_up("z"))
    regions = regions_to_scan(wide)
    assert len(regions) == 3 and all(max(region.size_m) <= 2.2 for region in regions)
    assert sum(region.area_m2 for region in regions) == pytest.approx(6.5, abs=0.05)
    assert sorted(round(region.center_m[0], 1) for region in regions) == pytest.approx([1.1, 3.2, 5.4], abs=0.1)


def test_labels_of_the_plan_keep_apart():
    wanted = np.repeat([[0.0, 0.0], [0.1, 0.0], [5.0, 5.0]], [20, 10, 1], axis=0)
    places = _free_places(wanted, 0.3)
    gap, _ = cKDTree(places).query(places, k=2)
    assert gap[:, 1].min() >= 0.3
    np.testing.assert_array_equal(places[[0, -1]], wanted[[0, -1]])
    assert np.linalg.norm(places - wanted, axis=1).max() < 3.0


def test_the_plan_is_no_finer_than_the_scan(planted):
    plan = _plan(planted, regions_to_scan(planted))
    spacing = typical_spacing(planted.cloud.points)
    assert plan.cell_m >= spacing
    floor = plan.grey[5:-5, 5:-5]
    assert plan.gaps.sum() * plan.cell_m**2 == pytest.approx(np.pi, rel=0.25)
    assert ((floor == 1) & ~plan.gaps[5:-5, 5:-5]).mean() < 0.05, "no checkerboard"
    np.testing.assert_allclose(plan.marks[0], planted.frame.upright(np.array([[5003.0, 100, -2996]]))[0, :2], atol=0.3)


def test_a_filled_hole_is_no_region(planted):
    hole = without(hall(size=(7.0, 6.0)), (4.0, 3.0, 0.0), 1.0)
    done = pcdbench.complete(hole, Floor())
    assert all(np.hypot(region.center_m[0] - 4, region.center_m[1] - 3) > 1 for region in regions_to_scan(done))
    assert regions_to_scan(planted), "and an open one is"


def test_the_page_is_plain_about_what_it_counts(planted, tmp_path):
    low = np.round(planted.gaps.min(axis=0), 2)
    here = replace(planted, gaps=planted.gaps - low - [0.0, 0.04, 0.0])
    write_report(here, tmp_path / "a", "hall.ply", "idle")
    page = (tmp_path / "a/report.md").read_text()
    assert "Of the added points 0 have a confidence below" in page and "| share of all surface |" in page
    assert "places under 0.5 m2 are left out" in page and ", 0.0, " in page and "-0.0" not in page


@pytest.mark.parametrize(("factor", "says"), [(1.0, "No place of 0.5 m2 or more needs"), (100.0, "cannot be told")])
def test_a_scan_that_shows_no_surface_is_not_called_complete(tmp_path, factor, says):
    scan = PointCloud(np.random.default_rng(0).random((3000, 3)) * [3, 3, 0] * factor)
    done = pcdbench.complete(scan, Idle())
    assert write_report(done, tmp_path, "scan.ply", "idle") == []
    page, facts = (tmp_path / "report.md").read_text(), json.loads((tmp_path / "report.json").read_text())
    assert says in page and (factor == 1.0) == ("needs to be scanned" in page)
    assert (facts["too_thin"] is None) == (factor == 1.0)


def test_the_folder_that_cannot_be_written_is_named(planted, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(pcdbench.PcdbenchError, match="file cannot be written: Not a directory"):
        write_report(planted, tmp_path / "file", "a", "b")


def test_open_gaps_and_surface_count_once_whatever_the_tiles():
    floor = plane(0.1, 8.0)
    floor = floor[(floor[:, 1] < 4) & (np.linalg.norm(floor - [4, 2, 0], axis=1) > 0.6)]
    one, two = (pcdbench.complete(PointCloud(floor), Idle(), tile_m=tile_m) for tile_m in (20.0, 4.0))
    assert (one.tiles, two.tiles) == (1, 2)
    assert two.gaps_m2.sum() == pytest.approx(one.gaps_m2.sum(), rel=0.05)
    assert two.surface_m2 == pytest.approx(one.surface_m2, rel=0.02) and one.surface_m2 == pytest.approx(31, rel=0.05)


class FailsAt(Idle):
    """Adds nothing, and raises at one of its calls."""

    def __init__(self, call):
        super().__init__()
        self.left = call

    def complete(self, cloud, rng):
        self.left -= 1
        if not self.left:
            raise RuntimeError("boom")
        return cloud


def floor_of_two_tiles():
    """9 m long along x; a hole of 0.6 m radius in the tile x 4.5 to 9."""
    drawn = np.random.default_rng(0).random((6000, 3)) * [9, 4, 0]
    return PointCloud(drawn[np.linalg.norm(drawn - [7, 2, 0], axis=1) > 0.6])


def test_the_report_counts_what_lies_in_a_tile_that_failed():
    scan = floor_of_two_tiles()
    whole = pcdbench.complete(scan, Idle(), tile_m=4.5)
    with pytest.warns(CompletionWarning, match="boom"):
        done = pcdbench.complete(scan, FailsAt(2), tile_m=4.5)
    assert len(done.failures) == 1 and done.tiles == whole.tiles == 2
    assert done.surface_m2 == pytest.approx(whole.surface_m2, rel=0.02)
    assert done.gaps_m2.sum() == pytest.approx(whole.gaps_m2.sum(), rel=0.05) and done.gaps_m2.sum() > 0.8
    (region,) = regions_to_scan(done)
    np.testing.assert_allclose(region.center_m, [7, 2, 0], atol=0.2)


def test_a_failed_tile_whose_area_is_not_known_is_said_to_be_left_out(tmp_path, monkeypatch):
    def fails(task):
        raise MemoryError

    monkeypatch.setattr(completing, "observed_alone", fails)
    with pytest.warns(CompletionWarning, match="boom"):
        done = pcdbench.complete(floor_of_two_tiles(), FailsAt(2), tile_m=4.5)
    assert write_report(done, tmp_path, "a", "b") == []
    page = (tmp_path / "report.md").read_text()
    assert "needs to be scanned" not in page and "boom (its area and its gaps are left out)\n" in page
