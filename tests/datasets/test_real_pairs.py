"""Real pairs: the scan from few frames against the scan from all, and what the complete scan can judge."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pcdbench_tasks.chamfer import Chamfer
from pcdbench_tasks.ssim import Ssim
from typer.testing import CliRunner

from pcdbench.case import Case, make_case
from pcdbench.cli import app
from pcdbench.cloud import PointCloud
from pcdbench.datasets.clouds import Clouds
from pcdbench.errors import CloudError, PcdbenchError, Skipped
from pcdbench.geometry.freespace import points_on_triangles
from pcdbench.incompletenesses.holes import Holes
from pcdbench.incompletenesses.real_pair import RealPair
from pcdbench.runner.plan import Request, plan
from pcdbench.scene import Scene
from pcdbench.seen_space import MOST_VIEWPOINTS, SeenSpace, judged

REAL = Path(os.environ.get("PCDBENCH_REAL_DATA", Path(__file__).parents[3] / "shared/data/real"))
RNG = np.random.default_rng


def panel(corner, one, two, spacing=0.04):
    a, b, c = np.array(corner, float), np.array(one, float), np.array(two, float)
    return points_on_triangles(np.array([[a, a + b, a + c], [a + b + c, a + c, a + b]]), spacing)


def room_points():
    """A room of 4 x 3 x 2.4 m without ceiling, a partition of 1.6 m height across half of it."""
    return np.concatenate(
        [
            panel([0, 0, 0], [4, 0, 0], [0, 3, 0]),
            panel([0, 0, 0], [4, 0, 0], [0, 0, 2.4]),
            panel([0, 3, 0], [4, 0, 0], [0, 0, 2.4]),
            panel([0, 0, 0], [0, 3, 0], [0, 0, 2.4]),
            panel([4, 0, 0], [0, 3, 0], [0, 0, 2.4]),
        ]
    )


def noisy(points, seed=0, sigma=0.005):
    rng = RNG(seed)
    return PointCloud(points + rng.normal(0, sigma, points.shape), np.clip(rng.uniform(0.3, 0.9, points.shape), 0, 1))


def scene_of(points, partial=None, count=3000, **more):
    dense = noisy(points)
    index = np.sort(RNG(1).permutation(len(dense))[:count])
    return Scene("room", dense.select(index), dense, index, partial=partial, **more)


@pytest.fixture(scope="module")
def pair() -> Scene:
    """A room, and a scan that saw nothing of it beyond x = 1.6 m but has noise of its own."""
    points = room_points()
    return scene_of(points, noisy(points[points[:, 0] < 1.6], seed=5), viewpoints=np.array([[2.0, 1.5, 1.4]]))


def test_the_incomplete_cloud_is_the_other_scan(pair):
    case = make_case(pair, "real_pair", RealPair(), 0.3, 7)
    partial = {tuple(point) for point in pair.partial.points}
    assert all(tuple(point) in partial for point in case.cloud.points)
    assert len(case.cloud) == case.kept.sum() == len(pair.complete) - len(case.removed)
    # A complete point was seen where the other scan has a point near: brute force.
    some = slice(None, None, 20)
    gaps = np.linalg.norm(pair.complete.points[some, None] - pair.partial.points[None], axis=2).min(axis=1)
    np.testing.assert_array_equal(case.kept[some], gaps <= 0.03)
    assert case.level == pytest.approx(1 - case.kept.mean())
    assert case.level == pytest.approx((pair.complete.points[:, 0] > 1.6).mean(), abs=0.02)
    assert (case.removed.points[:, 0] > 1.57).all()


def test_reach_follows_thin_scans_and_the_option(pair):
    near = RealPair(RealPair.Options(near_m=0.5)).kept(pair, 0.0, RNG(0))
    assert near.mean() > RealPair().kept(pair, 0.0, RNG(0)).mean() + 0.05
    thin = replace(pair, partial=pair.partial.select(np.arange(0, len(pair.partial), 25)))
    assert RealPair().kept(thin, 0.0, RNG(0)).mean() > 0.3


def test_a_case_is_decided_by_its_seed(pair):
    first, again, other = (make_case(pair, "real_pair", RealPair(), 0.0, seed).cloud.points for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert len(first) == len(other) and not np.array_equal(first, other)


def test_scenes_without_a_second_scan_are_skipped(pair):
    with pytest.raises(Skipped, match=r"room has no incomplete scan of its own; give clouds\.complete=FILE"):
        make_case(replace(pair, partial=None), "real_pair", RealPair(), 0.0, 0)
    with pytest.raises(Skipped, match="misses nothing"):
        make_case(replace(pair, partial=pair.dense), "real_pair", RealPair(), 0.0, 0)


def test_pairs_in_two_frames_or_units_are_refused(pair):
    in_millimetres = PointCloud(pair.partial.points * 1000 + 9000)
    with pytest.raises(CloudError, match=r"nowhere within .* of the complete one; bring both into one frame and unit"):
        make_case(replace(pair, partial=in_millimetres), "real_pair", RealPair(), 0.0, 0)


def test_seen_space_is_what_lies_on_surfaces_and_before_them(pair):
    seen = SeenSpace(pair)
    on_wall, in_air, behind_wall, below_floor = [4, 1, 1], [3, 1, 1], [4.5, 1, 1], [2, 1, -0.5]
    np.testing.assert_array_equal(
        seen.holds(np.array([on_wall, in_air, behind_wall, below_floor], float)), [True, True, False, False]
    )
    above = np.array([[2.0, 1.5, 3.5]])
    assert not seen.holds(above)[0], "no surface was seen through it: the room has no ceiling"
    probes = RNG(3).uniform([0.2, 0.2, 0.2], [3.8, 2.8, 1.2], (500, 3))
    assert seen.holds(probes).mean() > 0.97
    assert seen.holds(pair.complete.points).all()


def test_shadows_of_furniture_are_unknown():
    cupboard = [panel([3, 0.5, 0], [0, 2, 0], [0, 0, 2.3]), panel([3, 0.5, 0], [1, 0, 0], [0, 0, 2.3])]
    scene = scene_of(np.concatenate([room_points(), *cupboard]), viewpoints=np.array([[1.0, 1.0, 1.2]]))
    inside, before = np.array([[3.5, 1.2, 1.0]]), np.array([[2.5, 1.2, 1.0]])
    assert not SeenSpace(scene).holds(inside)[0] and SeenSpace(scene).holds(before)[0]


def test_without_viewpoints_places_to_stand_are_taken(pair):
    unknown = replace(pair, viewpoints=None)
    viewpoints = SeenSpace(unknown).viewpoints
    assert len(viewpoints) == MOST_VIEWPOINTS
    assert (viewpoints > [0.2, 0.2, 1.0]).all() and (viewpoints < [3.8, 2.8, 1.6]).all()
    assert SeenSpace(unknown).holds(np.array([[3.0, 1.0, 1.0], [4.5, 1, 1]])).tolist() == [True, False]


def test_scans_with_nowhere_to_stand_are_seen_from_their_middle():
    shelf = np.concatenate(
        [panel([0, 0, z], [1, 0, 0], [0, 0.3, 0]) for z in (0.5, 1.0)] + [panel([0, 0.3, 0], [1, 0, 0], [0, 0, 1.5])]
    )
    scene = scene_of(shelf, count=500)
    assert len(SeenSpace(scene).viewpoints) == 1


@pytest.mark.parametrize(("task", "metric"), [(Chamfer, "chd"), (Chamfer, "accuracy_m"), (Ssim, "ssim")])
def test_what_the_complete_scan_did_not_see_costs_nothing_and_what_it_saw_empty_does(pair, task, metric):
    case = make_case(pair, "real_pair", RealPair(), 0.0, 0)
    rng = RNG(2)

    def measured(case, added):
        cloud = PointCloud.concatenate([case.cloud, PointCloud(added, np.full(added.shape, 0.5))])
        return task().evaluate(case, cloud, RNG(0))

    behind = rng.uniform([4.3, 0, 0], [4.8, 3, 2.4], (500, 3))
    in_air = rng.uniform([2.2, 1, 0.5], [3.2, 2, 1.2], (500, 3))
    nothing, unseen, wrong = (measured(case, added) for added in (np.empty((0, 3)), behind, in_air))
    assert unseen.samples[metric] == nothing.samples[metric] != wrong.samples[metric]
    assert nothing.trace["unseen_share"] < 0.01
    assert unseen.trace["unseen_share"] == pytest.approx(500 / (500 + len(case.cloud)), abs=0.01)
    # Where points were taken away, everything counts, as ever, and the trace says nothing.
    synthetic = make_case(pair, "holes", Holes(), 0.3, 0)
    nothing, unseen = (measured(synthetic, added) for added in (np.empty((0, 3)), behind))
    assert unseen.samples[metric] != nothing.samples[metric] and unseen.trace == {}


def test_completions_out_of_sight_are_skipped(pair):
    case = make_case(pair, "real_pair", RealPair(), 0.0, 0)
    with pytest.raises(Skipped, match="saw nothing of the space"):
        judged(case, PointCloud(pair.complete.points + 100))


def test_a_case_without_a_scan_is_what_it_was(pair):
    kept = np.arange(len(pair.complete)) % 2 == 0
    np.testing.assert_array_equal(Case(pair, "x", 0.5, 0, kept).cloud.points, pair.complete.points[kept])


@pytest.fixture
def folder(tmp_path, pair) -> Path:
    """Two rooms, each a complete scan with others beside it."""
    for name, limit in (("a", 1.2), ("b", 2.4)):
        pair.dense.write(tmp_path / name / "full.ply")
        for number in (1, 2):
            seen = pair.dense.points[:, 0] < limit + 0.2 * number
            noisy(pair.dense.points[seen], seed=number).write(tmp_path / name / f"part_{number}.ply")
    pair.dense.write(tmp_path / "c" / "alone.ply")
    return tmp_path


def opened(folder, **options):
    return Clouds(folder, Clouds.Options(**{"complete_points": 1000, "complete": "full.ply", **options}))


def test_clouds_beside_a_complete_one_are_its_pairs(folder, pair):
    dataset = opened(folder)
    assert dataset.scene_names("all") == ("a-part_1", "a-part_2", "b-part_1", "b-part_2")
    environments = [dataset.environment(name) for name in dataset.scene_names("all")]
    assert environments == ["a/full.ply", "a/full.ply", "b/full.ply", "b/full.ply"]
    assert opened(folder, complete="").environment("a-part_1") == "a-part_1"
    assert opened(folder / "a/part_1.ply").environment("part_1") == "../full.ply"
    scene = dataset.scene("a-part_1")
    np.testing.assert_allclose(scene.dense.points, pair.dense.points, atol=1e-6)
    assert scene.partial.points[:, 0].max() < 1.5
    assert scene.info["incomplete scan"] == "part_1.ply" and scene.source.endswith("full.ply")
    assert opened(folder, partials="*_2.ply").scene_names("all") == ("a-part_2", "b-part_2")


def test_both_files_decide_a_pair(folder):
    before = [opened(folder).digest(name) for name in ("a-part_1", "a-part_2")]
    assert before[0] != before[1]
    noisy(room_points(), seed=9).write(folder / "a/part_1.ply")
    after = [opened(folder).digest(name) for name in ("a-part_1", "a-part_2")]
    assert before[0] != after[0] and before[1] == after[1]
    noisy(room_points(), seed=9).write(folder / "a/full.ply")
    assert opened(folder).digest("a-part_2") != after[1]


def test_pairs_that_are_not_there_are_named(folder):
    with pytest.raises(PcdbenchError, match=r"holds no nowhere\.ply with clouds \* beside it; check clouds\.complete"):
        opened(folder, complete="nowhere.ply").scene_names("all")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"partials": ""}, "'' fits no name; give a pattern"),
        ({"partials": "."}, "'.' fits no name; give a pattern"),
        ({"complete": "sub/full.ply"}, "'sub/full.ply' is no name of a file .*; give the name alone"),
        ({"complete": "."}, "'.' is no name of a file"),
        ({"partials": "sub_*.ply"}, "partials would have no effect without the complete scan; add complete=FILE"),
    ],
)
def test_options_of_pairs_that_cannot_work_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        Clouds.Options(**options)


def test_a_pair_has_one_case_whatever_the_levels(folder):
    planned = plan(
        Request(
            completers=["incomplete"],
            tasks=["chamfer"],
            dataset=f"clouds:{folder}",
            incompletenesses=["real_pair", "holes"],
            levels=[0.1, 0.5],
            options=["clouds.complete=full.ply"],
            references=False,
        )
    )
    levels = [(cell.incompleteness.name, cell.level) for cell in planned.cells if cell.scene == "a-part_1"]
    assert levels == [("real_pair", 0.0), ("holes", 0.1), ("holes", 0.5)]


def test_a_run_of_pairs_says_how_much_was_missing(folder, tmp_path):
    what = f"--incompleteness real_pair --completer incomplete --task chamfer,ssim --jobs 1 --dataset clouds:{folder}"
    options = "--option clouds.complete=full.ply --option clouds.partials=*_1.ply --option clouds.complete_points=800"
    ended = CliRunner().invoke(app, ["run", *what.split(), *options.split(), "--out", str(tmp_path / "run")])
    assert ended.exit_code == 0, ended.stdout + ended.stderr
    rows = [json.loads(line) for line in (tmp_path / "run/rows.jsonl").read_text().splitlines()]
    floor = [row for row in rows if row["completer"]["name"] == "incomplete" and row["task"]["name"] == "chamfer"]
    missing = [row["missing"] for row in floor]
    assert len(missing) == 2 and 0.2 < min(missing) < max(missing) < 0.8
    assert all(row["points"]["incomplete"] < 800 * 0.8 and row["level"] == 0.0 for row in floor)
    assert f"about {np.mean(missing):.0%}" in ended.stdout
    shares = [row["trace"]["unseen_share"] for row in rows if row["completer"]["name"] == "incomplete"]
    assert max(shares) < 0.05
    said = f"incomplete {np.median(shares):.1%} ({max(shares):.1%})"
    assert "real_pair: in chamfer, ssim only what the complete scan saw counts. Left out" in ended.stdout
    assert said in ended.stdout


@pytest.mark.skipif(
    not (REAL / "redkitchen/clouds").is_dir(), reason="no real scans; PCDBENCH_REAL_DATA names the place"
)
def test_pairs_of_the_kitchen_miss_what_their_maker_says():
    """The share of full.ply within 3 cm of each scan, as counted by who made them, over even samples here."""
    dataset = opened(REAL / "redkitchen/clouds", partials="sub_*.ply", complete_points=5000)
    covered = json.loads((REAL / "redkitchen/clouds/partials.json").read_text())
    assert len(dataset.scene_names("all")) == 10
    for name in ("sub_300", "sub_400"):
        case = make_case(dataset.scene(name), "real_pair", RealPair(), 0.0, 0)
        assert 1 - case.level == pytest.approx(covered[name]["coverage_of_full_3cm"], abs=0.03)
        assert judged(case, case.cloud)[1]["unseen_share"] < 0.05
