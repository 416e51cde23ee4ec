"""`pcdbench.complete`: observed points are kept, added ones are where nothing was observed, as dense as around."""

import re
import subprocess
import sys

import numpy as np
import pytest
from completion_cases import Floor, Nothing, hall, without
from scipy.spatial import cKDTree

import pcdbench
from pcdbench import Completer, PcdbenchError, PointCloud
from pcdbench.completion import CompletionWarning
from pcdbench.completion.tiles import Tiling
from pcdbench.completion.workers import tile_outcomes
from pcdbench.errors import CloudError
from pcdbench.formats import read_cloud_and_fields
from pcdbench.geometry.frames import UPS, Frame

HOLE, RADIUS_M = (3.0, 2.6, 0.0), 1.0


def in_hole(points, radius_m=RADIUS_M, center=HOLE):
    return np.linalg.norm(points - np.array(center), axis=1) <= radius_m


@pytest.mark.parametrize("completer", ["plane_fitting", "hole_filling", Floor()])
def test_holes_are_filled_and_nothing_else_changes(completer):
    scan = without(hall(size=(5.5, 5.0)), HOLE, RADIUS_M)
    done = pcdbench.complete(scan, completer)
    count = len(scan)
    np.testing.assert_array_equal(done.cloud.points[:count], scan.points)
    np.testing.assert_array_equal(done.cloud.colors[:count], scan.colors)
    assert not done.added[:count].any() and done.added[count:].all() and (done.confidence[:count] == 1).all()
    added = done.added_cloud.points
    filled = in_hole(added)
    # The hole's area is 3.14 m2, so many points of spacing 8 cm; the rim takes some.
    assert 0.6 * 490 < filled.sum() < 1.1 * 490
    assert np.abs(added[filled, 2]).max() < 0.03
    gap, _ = cKDTree(scan.points).query(added)
    assert gap.min() > 0.4 * 0.08
    assert done.confidence[done.added].min() >= 0 and done.confidence.max() <= 1 and not done.failures


class KeepsAll(Completer):
    """Keeps its input, in these numbers, and adds a grid on the floor."""

    def __init__(self, kind):
        super().__init__()
        self.kind = kind

    def complete(self, cloud, rng):
        low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
        x, y = (np.arange(a, b, 0.08) for a, b in zip(low[:2], high[:2], strict=True))
        grid = np.stack(np.meshgrid(x, y, [low[2]]), axis=-1).reshape(-1, 3)
        points = np.concatenate([cloud.points, grid])
        return PointCloud(points.astype(self.kind).astype(np.float64))


def test_who_returns_its_input_in_float32_keeps_it_too():
    scan = without(hall(size=(5.5, 5.0), color=False, even=True), HOLE, RADIUS_M)
    exact, rounded = (pcdbench.complete(scan, KeepsAll(kind)).added.sum() for kind in (np.float64, np.float32))
    assert exact > 400 and abs(int(exact) - int(rounded)) <= 5


@pytest.mark.parametrize(("spacing_m", "even"), [(0.08, True), (0.03, True), (0.02, False)])
def test_added_points_are_as_dense_as_the_observed_around(spacing_m, even):
    scan = without(hall(spacing_m, (4.0, 3.6), color=False, even=even), (2.2, 2, 0), 0.9)
    done = pcdbench.complete(scan, Floor())
    added = done.added_cloud.points
    area = np.pi * 0.7**2
    density = in_hole(added, 0.7, (2.2, 2, 0)).sum() / area
    assert 0.75 / spacing_m**2 < density < 1.2 / spacing_m**2
    assert np.median(done.spacing_m) == pytest.approx(spacing_m, rel=0.15)
    outside = ~in_hole(added, 1.0, (2.2, 2, 0))
    assert outside.sum() < 0.01 * len(scan), "what the completer made anew where points were is not added"


def test_points_that_are_there_many_times_count_once(tmp_path):
    once = without(hall(0.15, (4.0, 3.6)), (2.2, 2, 0), 0.7)
    many = once.select(np.repeat(np.arange(len(once)), 13))
    done, same = (pcdbench.complete(scan, Floor()) for scan in (many, once))
    np.testing.assert_array_equal(done.cloud.points[: len(many)], many.points)
    assert len(same.added_cloud) > 30
    np.testing.assert_array_equal(done.added_cloud.points, same.added_cloud.points)
    done.write(tmp_path / "done.ply", fields={"number": np.arange(len(many))})
    numbers = read_cloud_and_fields(tmp_path / "done.ply")[1]["number"]
    np.testing.assert_array_equal(numbers[: len(many)], range(len(many)))


def test_density_follows_the_scan_from_dense_to_sparse():
    dense = hall(0.02, (3.4, 3.0), color=False)
    sparse = hall(0.06, (3.4, 3.0), color=False, seed=1)
    scan = PointCloud(np.concatenate([dense.points, sparse.points[:, :] * [-1, 1, 1] - [0.02, 0, 0]]))
    for x in (-1.7, 1.7):
        scan = without(scan, (x, 1.5, 0), 0.6)
    done = pcdbench.complete(scan, Floor(), tile_m=20.0)
    left, right = (in_hole(done.added_cloud.points, 0.6, (x, 1.5, 0)).sum() for x in (-1.7, 1.7))
    assert 5 < right / left < 13, "nine times as dense on the right"


@pytest.mark.parametrize(
    "holes",
    [
        [((4.0, 4.0, 0.0), 1.4)],
        [((4.0, 2.0, 0.0), 0.7), ((2.0, 4.0, 0.0), 0.7), ((4.2, 6.2, 0.0), 0.8)],
        [((4.6, 4.5, 0.0), 1.0), ((1.6, 4.2, 0.0), 1.0)],
    ],
    ids=["corner", "borders", "beside"],
)
def test_tiles_agree_with_one_piece(holes):
    # Four tiles whose borders cut all holes; the floor is at exactly z = 0, so planes lie a hair above or below it.
    scan = hall(0.1, (8.0, 8.0), color=False, seed=len(holes))
    for center, radius in holes:
        scan = without(scan, center, radius)
    whole = pcdbench.complete(scan, "plane_fitting", tile_m=40.0)
    tiled = pcdbench.complete(scan, "plane_fitting", tile_m=4.0)
    assert (whole.tiles, tiled.tiles) == (1, 4)
    for center, radius in holes:
        one, many = (in_hole(done.added_cloud.points, radius, center) for done in (whole, tiled))
        assert many.sum() == pytest.approx(one.sum(), rel=0.15)
        gap, _ = cKDTree(whole.added_cloud.points).query(tiled.added_cloud.points[many])
        assert np.percentile(gap, 95) < 0.15
    # No seam: added points keep apart across the borders of tiles.
    gap, _ = cKDTree(tiled.added_cloud.points).query(tiled.added_cloud.points, k=2)
    assert (gap[:, 1] > 0.3 * 0.1).all()


@pytest.fixture(scope="module")
def upright():
    """A scan in steps of a power of two, exact after adding and taking away an offset, and its added points."""
    scan = PointCloud(np.round(without(hall(0.12, (5.5, 5.0), color=False), HOLE, RADIUS_M).points * 2**12) / 2**12)
    return scan, pcdbench.complete(scan, "plane_fitting").added_cloud.points


@pytest.mark.parametrize("up", UPS)
def test_any_axis_may_be_up_and_any_offset(upright, up):
    scan, expected = upright
    frame, offset = Frame.with_up(up), np.array([1_048_576.0, -2_097_152.0, 512.0])
    turned = PointCloud(frame.back(scan.points) + offset)
    np.testing.assert_array_equal(frame.upright(frame.back(scan.points)), scan.points)
    done = pcdbench.complete(turned, "plane_fitting", up=up)
    np.testing.assert_array_equal(done.cloud.points[: len(scan)], turned.points)
    back = frame.upright(done.added_cloud.points - offset)
    assert len(back) == pytest.approx(len(expected), rel=0.02)
    gap, _ = cKDTree(expected).query(back)
    assert np.median(gap) < 1e-3
    assert in_hole(back).sum() > 100


@pytest.mark.parametrize("up", UPS)
def test_frames_are_rotations_with_the_axis_up(up):
    frame = Frame.with_up(up)
    rotation = frame.upright(np.eye(3)).T
    assert np.linalg.det(rotation) == 1.0
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up.startswith("-") else 1.0
    np.testing.assert_array_equal(rotation @ axis, [0, 0, 1])
    points = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_array_equal(frame.column(points, 2), frame.upright(points)[:, 2])
    assert frame.up == up


def test_the_result_depends_on_the_seed_and_not_on_the_workers(tmp_path):
    script = tmp_path / "jobs.py"
    script.write_text(
        "import sys, pcdbench\n"
        "if __name__ == '__main__':\n"
        "    done = pcdbench.complete(pcdbench.PointCloud.read(sys.argv[1]), 'plane_fitting', tile_m=3.2, jobs=2)\n"
        "    done.write(sys.argv[2])\n"
    )
    scan = without(hall(0.15, (6.0, 3.1)), (3.0, 1.5, 0.0), RADIUS_M)
    scan.write(tmp_path / "scan.npz")
    subprocess.run([sys.executable, script, tmp_path / "scan.npz", tmp_path / "two.npz"], check=True, timeout=120)
    one = pcdbench.complete(scan, "plane_fitting", tile_m=3.2)
    two = PointCloud.read(tmp_path / "two.npz")
    np.testing.assert_array_equal(one.cloud.points, two.points)
    np.testing.assert_array_equal(one.cloud.colors, two.colors)
    other = pcdbench.complete(scan, "plane_fitting", tile_m=3.2, seed=1)
    assert not np.array_equal(one.cloud.points, other.cloud.points)


def test_colors_come_from_the_completer_or_else_from_around():
    scan = without(hall(0.12, (5.5, 5.0)), HOLE, RADIUS_M)
    grey = pcdbench.complete(scan, Floor()).added_cloud
    np.testing.assert_allclose(grey.colors, 0.5, atol=1e-6)
    inside = pcdbench.complete(scan, Floor(color=False)).added_cloud
    np.testing.assert_allclose(
        inside.colors[in_hole(inside.points)], np.tile([0.8, 0.2, 0.2], (in_hole(inside.points).sum(), 1)), atol=1e-5
    )
    assert pcdbench.complete(scan.without_colors(), Floor()).cloud.colors is None


class WrongType(Completer):
    def complete(self, cloud, rng):
        return cloud.points


@pytest.mark.filterwarnings("ignore::pcdbench.completion.CompletionWarning")
def test_a_tile_that_fails_is_named_and_costs_itself_alone():
    scan = without(without(hall(0.1), (2.0, 4.0, 0.0), 0.8), (10.0, 7.0, 0.0), 0.8)

    class FailsWhereTheWallIs(Completer):
        def complete(self, cloud, rng):
            # Only the first column of tiles sees the wall x = 0: many points of one x.
            if (np.abs(cloud.points[:, 0] - cloud.points[:, 0].min()) < 1e-9).sum() > 50:
                raise ValueError("no\nmemory")
            return Floor().complete(cloud, rng)

    with pytest.warns(
        CompletionWarning, match=r"nothing was added in tile x 0\.0 to 6\.0 m, y 0\.0.*ValueError: no mem"
    ):
        done = pcdbench.complete(scan, FailsWhereTheWallIs(), tile_m=6.0)
    assert len(done.failures) == 2 and done.tiles == 4
    np.testing.assert_array_equal(done.cloud.points[: len(scan)], scan.points)
    assert in_hole(done.added_cloud.points, 0.8, (10.0, 7.0, 0.0)).sum() > 100
    assert not in_hole(done.added_cloud.points, 0.8, (2.0, 4.0, 0.0)).any()


def test_failing_everywhere_is_an_error():
    with (
        pytest.warns(CompletionWarning),
        pytest.raises(
            PcdbenchError, match=r"failed on all 1 tiles; the first: tile .* returned ndarray, not a PointCloud"
        ),
    ):
        pcdbench.complete(hall(0.2, (4, 4)), WrongType())


def test_a_completer_that_cannot_be_built_is_one_line(monkeypatch):
    def unbuilt(*_):
        raise RuntimeError("no\nGPU")

    monkeypatch.setattr("pcdbench_completers.plane_fitting.PlaneFitting.__init__", unbuilt)
    with pytest.raises(PcdbenchError, match="completer 'plane_fitting' cannot be built: RuntimeError: no GPU"):
        pcdbench.complete(hall(0.3, (4, 4)), "plane_fitting")


def test_a_completer_that_ends_its_process_costs_its_tile():
    class Ends(Completer):
        def complete(self, cloud, rng):
            sys.exit("good bye")

    with pytest.warns(CompletionWarning), pytest.raises(PcdbenchError, match="SystemExit: good bye"):
        pcdbench.complete(hall(0.3, (4, 4)), Ends())


def test_a_worker_that_dies_costs_its_tile(tmp_path):
    script = tmp_path / "dies.py"
    script.write_text(
        "import os, warnings, numpy as np, pcdbench\n"
        "class Dies(pcdbench.Completer):\n"
        "    def complete(self, cloud, rng):\n"
        "        if np.ptp(cloud.points[:, 0]) < 4: os._exit(7)\n"
        "        return cloud\n"
        "if __name__ == '__main__':\n"
        "    warnings.simplefilter('ignore')\n"
        "    rng = np.random.default_rng(0)\n"
        "    cloud = pcdbench.PointCloud(rng.random((4000, 3)) * [7, 4, 0.01])\n"
        "    done = pcdbench.complete(cloud, Dies(), tile_m=5.0, jobs=2)\n"
        "    print(len(done.cloud), len(done.failures), done.failures[0])\n"
    )
    ran = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.startswith("4000 1 tile x 5.0") and "exit code 7" in ran.stdout


def test_nothing_to_add_is_fine():
    scan = hall(0.15, (4, 4))
    done = pcdbench.complete(scan, Nothing())
    assert len(done.cloud) == len(scan) and not done.added.any() and len(done.added_cloud) == 0
    assert repr(done) == f"Completed({len(scan):,} observed and 0 added points)"


def test_wrong_use_is_one_line():
    scan = hall(0.2, (4, 4), color=False)
    for arguments, message in (
        ({"completer": "plane_fiting"}, "did you mean plane_fitting"),
        ({"completer": "ground_truth"}, "a reference to measure against"),
        ({"completer": "plane_fitting", "up": "w"}, "up axis 'w' is none of z y x"),
        ({"completer": "plane_fitting", "tile_m": 0.5}, "too small; take at least 3 m"),
        ({"completer": "plane_fitting", "tile_m": np.inf}, "tiles of inf m are no size; take at least 3 m"),
        ({"completer": "plane_fitting", "options": {"reach": 1}}, "no option 'reach'; did you mean reach_m"),
        ({"completer": Nothing(), "options": {"a": 1}}, "give them to Nothing"),
        ({"completer": "plane_fitting", "runs": 0}, "must be at least 1"),
    ):
        with pytest.raises(PcdbenchError, match=message) as caught:
            pcdbench.complete(scan, **arguments)
        assert "\n" not in str(caught.value)
    with pytest.raises(CloudError, match="the cloud has 20 points; at least 50"):
        pcdbench.complete(scan.select(np.arange(20)), "plane_fitting")

    class Colorful(Nothing):
        needs_color = True

    with pytest.raises(PcdbenchError, match="Colorful needs colours, and the cloud has none"):
        pcdbench.complete(scan, Colorful())


def test_odd_units_and_axes_are_warned_of():
    scan = hall(0.2, (4, 4), color=False)
    with pytest.warns(CompletionWarning, match="is its unit millimetres"):
        millimetres = pcdbench.complete(PointCloud(scan.points * 1000), Nothing())
    assert millimetres.tiles == 1
    with pytest.warns(CompletionWarning, match="14.0 m high and 9.0 m wide; is z really its up axis"):
        pcdbench.complete(PointCloud(hall(0.3, (9.0, 14.0), color=False).points[:, [2, 0, 1]]), Nothing())


@pytest.mark.parametrize(
    ("far", "message"),
    [
        ([[1e8, 1e8, 1e8]], r"^1 point lies far from all others, at \(100,000,000\.0, .*\); delete it from the scan$"),
        ([[1e300, 0, 0]], r"^1 point lies far from all others, at \(1e\+300, 0\.0, 0\.0\)"),
        ([[1e9, 0, 0], [0, 1e9, 1e9]], r"^2 points lie far from all others, the first at \(1e\+09, 0\.0, 0\.0\)"),
    ],
)
def test_points_too_far_away_for_tiles_are_named(far, message):
    scan = hall(0.2, (4, 4), color=False).points
    with pytest.raises(CloudError, match=message):
        pcdbench.complete(PointCloud(np.concatenate([scan, far])), Nothing())


def test_a_scan_in_two_parts_is_told_as_that_and_not_as_one_of_another_unit():
    scan = hall(0.2, (4, 4), color=False).points
    mapped = scan + np.array([4e5, 5.6e6, 300.0])
    nowhere = np.zeros((len(scan) // 10, 3))
    told = rf"^{len(nowhere):,} of its points lie at \(0, 0, 0\), 5,6.* m from all others; delete them$"
    with pytest.raises(CloudError, match=told):
        pcdbench.complete(PointCloud(np.concatenate([mapped, nowhere])), Nothing())
    with pytest.warns(CompletionWarning, match="lie in two parts, .* 99[0-9] m apart; bring them into one frame"):
        pcdbench.complete(PointCloud(np.concatenate([scan, scan + np.array([1000.0, 0, 0])])), Nothing())


def test_a_small_scan_is_one_tile_and_a_large_one_is_not():
    rng = np.random.default_rng(0)

    def furnished(size):
        faces = [[*size, 0], [size[0], 0, 3], [0, size[1], 3], [*size, 0]] * 2
        return np.concatenate([rng.random((round(np.prod([s for s in f if s]) * 100), 3)) * f for f in faces])

    small, large = furnished((3.5, 6.7)), furnished((3.5, 16.0))
    assert len(Tiling.of(small, Frame.with_up("z"), None).tiles) == 1
    assert len(Tiling.of(large, Frame.with_up("z"), None).tiles) > 1


def test_windows_hold_the_tile_and_its_halo_and_owners_are_unique():
    rng = np.random.default_rng(0)
    points = rng.random((20_000, 3)) * [18, 16, 14] + [5.0, -7.0, 100.0]
    tiling = Tiling.of(points, Frame.with_up("z"), 6.0)
    low = points.min(axis=0)
    owners = np.zeros(len(points), int)
    for tile in tiling.tiles:
        start = low + np.array(tile) * tiling.edges_m
        reach = (points >= start - tiling.halo_m + 1e-9) & (points <= start + tiling.edges_m + tiling.halo_m - 1e-9)
        np.testing.assert_array_equal(np.sort(tiling.window(tile)), np.flatnonzero(reach.all(axis=1)))
        own = tiling.owned(tile, points)
        assert own.sum() == tiling.count(tile)
        owners += own
    assert (owners == 1).all()
    assert len({tile[2] for tile in tiling.tiles}) == 3, "14 m are cut by storeys"


@pytest.mark.parametrize("up", UPS)
def test_a_tile_is_named_by_the_scans_own_axes(up):
    rng = np.random.default_rng(0)
    points = rng.random((8000, 3)) * [9, 13, 10] + [5.0, -7.0, 100.0]
    tiling = Tiling.of(points, Frame.with_up(up), 6.0)
    for tile in tiling.tiles:
        own = points[tiling.owned(tile, tiling.frame.upright(points))]
        sides = dict(re.findall(r"([xyz]) (.*?) m", tiling.name(tile)))
        assert set(sides) == set("xyz") - ({up[-1]} if tile[2] == 0 else set())
        for axis, side in sides.items():
            low, high = map(float, side.split(" to "))
            its = own[:, "xyz".index(axis)]
            assert low - 0.06 <= its.min() and its.max() <= high + 0.06 and 4 < high - low < 7


def test_places_outside_of_all_tiles_have_one_owner_at_most():
    points = np.random.default_rng(0).random((3000, 3)) * [12, 6, 2.0]
    tiling = Tiling.of(points, Frame.with_up("z"), 6.0)
    outside = np.array([[6.1, -0.3, 1.0], [-0.2, 3.0, 1.0], [5.9, 6.4, 1.0], [60.0, 3.0, 1.0]])
    owners = sum(tiling.owned(tile, outside).astype(int) for tile in tiling.tiles)
    assert owners.tolist() == [1, 1, 1, 0]


def test_what_lies_below_the_floor_or_behind_a_wall_is_of_the_nearest_tile():
    points = np.random.default_rng(0).random((3000, 3)) * [18, 12, 2.0]
    tiling = Tiling.of(points, Frame.with_up("z"), 6.0)
    assert len(tiling.tiles) == 6
    for tile in tiling.tiles:
        middle = tiling.center(tile)
        below = np.array([[middle[0], middle[1], tiling.origin[2] - 1e-9], [middle[0], middle[1], 0.5]])
        assert [tiling.owned(other, below).tolist() for other in tiling.tiles].count([True, True]) == 1
        assert tiling.owned(tile, below).all()
        behind = np.array([[middle[0], tiling.origin[1] - 1e-9, 1.0]])
        assert tiling.owned((tile[0], 0, 0), behind).all()


def test_few_windows_are_in_memory_at_a_time():
    made, done = 0, 0

    def tasks():
        nonlocal made
        scan = hall(0.3, (6, 6), color=False)
        from pcdbench.completion.tile_work import TileTask

        for number in range(5):
            made += 1
            assert made - done <= 1, "a window is made when the one before it is done"
            yield (number, 0, 0), TileTask(scan, np.array([9.0, 9.0, 9.0]), (0, number), 1)

    for _tile, outcome in tile_outcomes(tasks(), Nothing(), jobs=1):
        done += 1
        assert not isinstance(outcome, Exception)
    assert done == 5


class Spot(Completer):
    """Adds one point of the floor in each of two tiles, so far to the left of the border between them."""

    def __init__(self, left_m: float | None, right_m: float | None) -> None:
        super().__init__()
        self.of_tile = (left_m, right_m)

    def complete(self, cloud, rng):
        # Tiles of 4 m, their middles at the origin; the window of the right one reaches 3.5 m to the left.
        is_right = bool(cloud.points[:, 0].min() < -3)
        left_m = self.of_tile[is_right]
        if left_m is None:
            return cloud
        spot = [(-2 if is_right else 2) - left_m, 0.0, cloud.points[:, 2].min()]
        return PointCloud(np.concatenate([cloud.points, [spot]]))


def spotted(left_m, right_m):
    steps = np.arange(80) * 0.1
    floor = np.stack(np.meshgrid(steps, steps[:40], [0.0]), axis=-1).reshape(-1, 3)
    done = pcdbench.complete(
        PointCloud(floor[np.hypot(*(floor[:, :2] - (4, 2)).T) > 0.6]), Spot(left_m, right_m), tile_m=4.0
    )
    assert done.tiles == 2
    return done.added_cloud.points, done.confidence[done.added]


def test_two_tiles_do_not_put_two_points_at_one_place_of_their_border():
    # The floor's spacing is 10 cm: new points keep 7 cm apart, 0.7 of that across a border.
    for apart_m, count in ((0.02, 1), (0.04, 1), (0.06, 2)):
        added, _ = spotted(apart_m / 2, -apart_m / 2)
        assert len(added) == count, apart_m
        assert added[0, 0] == pytest.approx(4 - apart_m / 2, abs=1e-3), "the earlier tile's stays"


def test_a_neighbouring_tile_that_sees_nothing_there_halves_the_confidence():
    (one, two), (disputed, agreed) = zip(*(spotted(0.2, right_m) for right_m in (None, 0.21)), strict=True)
    assert one == pytest.approx(two) and len(one) == 1
    assert agreed <= 1 and disputed / agreed == pytest.approx(0.5, rel=1e-5)


def test_what_lies_a_tenth_of_the_extent_outside_is_not_added():
    class Beyond(Completer):
        def complete(self, cloud, rng):
            (low, _, floor), (high, *_) = cloud.points.min(axis=0), cloud.points.max(axis=0)
            off = np.array([[high + 0.3, 0, floor], [high + 0.5, 0, floor], [low - 0.5, 0, floor], [0, 0, floor + 0.5]])
            return PointCloud(np.concatenate([cloud.points, off]))

    steps = np.arange(0, 4.01, 0.1)
    floor = np.stack(np.meshgrid(steps, steps, [0.0]), axis=-1).reshape(-1, 3)
    added = pcdbench.complete(PointCloud(floor), Beyond(), tile_m=8.0).added_cloud.points
    np.testing.assert_allclose(added, [[4.3, 4.0, 0.0]], atol=1e-3)
