"""The generated data set: the same scenes everywhere, surveyed as scans are, split by environment."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pcdbench.case import make_case
from pcdbench.datasets.synthetic import Indoor
from pcdbench.datasets.synthetic.crops import CENTER_CLEARANCE_M, COMPLETE_POINTS
from pcdbench.datasets.synthetic.footprints import Footprint, Footprints
from pcdbench.datasets.synthetic.generator import environment, kind_of
from pcdbench.datasets.synthetic.indoor import _made
from pcdbench.datasets.synthetic.layouts import LARGE_KINDS, SMALL_KINDS
from pcdbench.datasets.synthetic.plan import bumped, contains, cut_corner, rectangle
from pcdbench.errors import PcdbenchError
from pcdbench.files import UNFINISHED
from pcdbench.geometry.neighbors import nearest
from pcdbench.geometry.visibility import MeshRaycaster
from pcdbench.incompletenesses.holes import Holes
from pcdbench.keys import digest

REFERENCE = Path(__file__).with_name("indoor_reference.json")
CROPS = ("env048_crop0", "env049_crop0")
ENVIRONMENTS = (1, 3, 7, 49)


def rounded_digest(values) -> str:
    """Digest of numbers in steps of 0.1 mm, whose borders lie where no length of the generator does."""
    return digest(np.floor(np.asarray(values, np.float64) * 1e4 + 0.377).astype(np.int64).ravel().tolist())


def environment_digests(index: int) -> dict[str, str]:
    place = environment(index)
    boxes = [[*tagged.box.center, *tagged.box.size, tagged.box.yaw_rad] for tagged in place.objects]
    return {
        "vertices": rounded_digest(place.mesh.vertices),
        "triangles": digest(place.mesh.triangles.ravel().tolist()),
        "materials": digest([place.mesh.materials.tolist(), place.mesh.tints.tolist()]),
        "boxes": rounded_digest(boxes),
        "labels": digest([tagged.label for tagged in place.objects]),
        "stations": rounded_digest(place.stations),
    }


def crop_reference(scene) -> dict:
    """What is committed of a crop: its size and 500 of its points, micrometres."""
    sample = scene.complete.points[:: len(scene.complete) // 500][:500]
    return {"dense": len(scene.dense), "points_um": np.rint(sample * 1e6).astype(int).tolist()}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PCDBENCH_CACHE", str(folder))
        yield folder


@pytest.fixture(scope="module")
def scenes(cache):
    return {name: Indoor().scene(name) for name in CROPS}


@pytest.mark.parametrize("index", ENVIRONMENTS)
def test_environments_are_the_same_on_every_machine(index):
    expected = json.loads(REFERENCE.read_text())["environments"][str(index)]
    assert environment_digests(index) == expected


@pytest.mark.parametrize("index", [1, 13])
def test_what_touches_a_wall_is_in_the_room_however_numpy_rounds(index, monkeypatch):
    """As on a processor by whose vector unit every third sine is off by a last bit."""
    before = environment_digests(index)
    rng = np.random.default_rng(1)

    def rounded_otherwise(function):
        def wrapped(*its, **options):
            value = np.asarray(function(*its, **options), np.float64)
            off = np.nextafter(value, rng.choice([-9.0, 9.0]))
            return np.where(rng.random(value.shape) < 0.3, off, value)[()]

        return wrapped

    for name in ("sin", "cos", "arctan2"):
        monkeypatch.setattr(np, name, rounded_otherwise(getattr(np, name)))
    environment.cache_clear()
    after = environment_digests(index)
    environment.cache_clear()
    assert after == before


@pytest.mark.parametrize("name", CROPS)
def test_clouds_are_the_same_on_every_machine(scenes, name):
    """Of 500 committed points of the complete cloud, 495 are there to a micrometre; counts are within 0.1 %."""
    expected = json.loads(REFERENCE.read_text())["crops"][name]
    scene = scenes[name]
    assert len(scene.dense) == pytest.approx(expected["dense"], rel=0.001)
    apart, _ = nearest(np.array(expected["points_um"]) / 1e6, scene.complete.points)
    assert np.mean(apart < 2e-6) >= 0.99


def test_rays_that_round_otherwise_change_next_to_nothing(scenes, monkeypatch):
    """Every direction off by the last bit of float32: more than what makes of processors differ in."""
    changes: list[int] = []

    class Beside:
        def __init__(self, scene):
            self.scene = scene

        def cast_rays(self, rays, **options):
            exact = rays.numpy()
            up = np.random.default_rng(0).random((len(exact), 3)) < 0.5
            beside = exact.copy()
            beside[:, 3:] = np.nextafter(exact[:, 3:], np.where(up, np.inf, -np.inf).astype(np.float32))
            found, hits = (self.scene.cast_rays(type(rays)(its), **options) for its in (beside, exact))
            changes.append(int((found["primitive_ids"].numpy() != hits["primitive_ids"].numpy()).sum()))
            return found

    prepared = MeshRaycaster.__init__

    def prepare(self, *mesh):
        prepared(self, *mesh)
        self._scene = Beside(self._scene)

    monkeypatch.setattr(MeshRaycaster, "__init__", prepare)
    environment.cache_clear()
    try:
        beside = _made("env049_crop0", "benchmark", 49, 0)
    finally:
        environment.cache_clear()
    assert sum(changes) > 500
    there = scenes["env049_crop0"]
    for cloud, other in ((there.dense, beside.dense), (there.complete, beside.complete)):
        same = {tuple(point) for point in cloud.points} & {tuple(point) for point in other.points}
        assert len(same) > 0.999 * max(len(cloud), len(other))
    masks = [make_case(scene, "holes", Holes(), 0.3, 0).kept for scene in (there, beside)]
    kept = [scene.complete.points[mask] for scene, mask in zip((there, beside), masks, strict=True)]
    assert len({tuple(point) for point in kept[0]} & {tuple(point) for point in kept[1]}) > 0.995 * len(kept[0])


@pytest.mark.parametrize("name", CROPS)
def test_a_scene_holds_what_the_contract_says(scenes, name):
    scene = scenes[name]
    assert len(scene.complete) == COMPLETE_POINTS == len(np.unique(scene.complete_index))
    np.testing.assert_array_equal(scene.dense.points[scene.complete_index], scene.complete.points)
    assert 100_000 < len(scene.dense) <= 500_000
    assert 4.0 < scene.longest_side_m < 16.5
    assert len(scene.objects) >= 3
    assert abs(np.percentile(scene.complete.points[:, 2], 2)) < 0.1
    for tagged in scene.objects:
        assert tagged.box.contains(scene.complete.points, 0.03).sum() >= 25, tagged.label


@pytest.mark.parametrize("name", CROPS)
def test_the_middle_of_a_scene_is_free(scenes, name):
    scene = scenes[name]
    points = scene.complete.points
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    floor = environment(int(name[3:6])).floor
    assert floor.clearance_at(middle[None, :2])[0] >= CENTER_CLEARANCE_M - 0.1
    beside = np.hypot(*(scene.dense.points[:, :2] - middle[:2]).T) < 0.2
    body = (scene.dense.points[:, 2] > 0.3) & (scene.dense.points[:, 2] < 1.6)
    assert (beside & body).sum() < 20


@pytest.mark.parametrize("name", CROPS)
def test_points_lie_on_the_surface_but_for_noise_and_mixed_pixels(scenes, name):
    scene = scenes[name]
    open3d = pytest.importorskip("pcdbench.open3d_loader").load_open3d()
    solid = open3d.t.geometry.RaycastingScene()
    center = scene.complete.points.mean(axis=0)
    solid.add_triangles(
        (scene.surface.vertices - center).astype(np.float32),
        scene.surface.triangles[~scene.surface.transparent].astype(np.uint32),
    )
    distance = solid.compute_distance((scene.complete.points - center).astype(np.float32)).numpy()
    assert np.median(distance) < 0.006
    assert 0.0005 < np.mean(distance > 0.04) < 0.05


@pytest.mark.parametrize("name", CROPS)
def test_a_scan_has_shadows(scenes, name):
    """Much of the surface inside a scene was never seen: backs of cupboards, floor under things."""
    scene = scenes[name]
    corners = scene.surface.vertices[scene.surface.triangles[~scene.surface.transparent]]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    rng = np.random.default_rng(0)
    rows = rng.choice(len(areas), 4000, p=areas / areas.sum())
    u, v = rng.uniform(size=(2, 4000, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    on_surface = (
        corners[rows, 0] + u * (corners[rows, 1] - corners[rows, 0]) + v * (corners[rows, 2] - corners[rows, 0])
    )
    low, high = scene.complete.points.min(axis=0) + 0.1, scene.complete.points.max(axis=0) - 0.1
    within = on_surface[((on_surface > low) & (on_surface < high)).all(axis=1)]
    unseen = nearest(within, scene.dense.points)[0] > 0.08
    assert len(within) > 200
    assert 0.15 < unseen.mean() < 0.85


@pytest.mark.parametrize("name", CROPS)
def test_materials_and_light_give_many_colors(scenes, name):
    colors = scenes[name].complete.colors
    assert colors.std(axis=0).min() > 0.08
    assert len(np.unique((colors * 12).astype(int), axis=0)) > 120
    # Textures: neighbours differ by more than the sensor's noise alone.
    assert (colors.max(axis=1) - colors.min(axis=1)).mean() > 0.03


def test_the_cache_gives_back_the_same_scene_and_is_remade_when_broken(scenes, cache):
    name = CROPS[1]
    first = scenes[name]
    start = time.perf_counter()
    again = Indoor().scene(name)
    assert time.perf_counter() - start < 2.0
    np.testing.assert_array_equal(first.dense.points, again.dense.points)
    np.testing.assert_array_equal(first.dense.colors, again.dense.colors)
    np.testing.assert_array_equal(first.complete_index, again.complete_index)
    np.testing.assert_array_equal(first.surface.vertices, again.surface.vertices)
    assert [tagged.label for tagged in first.objects] == [tagged.label for tagged in again.objects]
    assert dict(first.info) == dict(again.info)
    (path,) = cache.rglob(f"{name}.npz")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    np.testing.assert_array_equal(Indoor().scene(name).dense.points, first.dense.points)
    assert path.read_bytes() == whole
    assert not list(cache.rglob(UNFINISHED))


def test_a_complete_cloud_of_another_size_is_of_the_same_scene(cache):
    usual = Indoor().scene("env048_crop0")
    fewer = Indoor(options=Indoor.Options(complete_points=5000)).scene("env048_crop0")
    assert len(usual.complete) == 20_000 and len(fewer.complete) == 5000
    assert np.array_equal(fewer.dense.points, usual.dense.points)
    assert [str(one) for one in fewer.objects] == [str(one) for one in usual.objects]
    assert np.array_equal(fewer.dense.points[fewer.complete_index], fewer.complete.points)
    apart = cKDTree(fewer.complete.points).query(fewer.complete.points, k=2)[0][:, 1]
    assert np.median(apart) > 1.6 * np.median(cKDTree(usual.complete.points).query(usual.complete.points, k=2)[0][:, 1])


def test_splits_share_no_environment_and_have_the_published_sizes():
    data = Indoor()
    names = {split: list(data.scene_names(split)) for split in ("test", "test-small", "smoke", "val")}
    environments = {split: {name[:6] for name in found} for split, found in names.items()}
    assert len(names["test"]) * data.draws("test") == 300
    assert len(names["test-small"]) * data.draws("test-small") == 30
    assert set(names["test-small"]) <= set(names["test"])
    assert (len(names["smoke"]), len(names["val"])) == (2, 18)
    assert not environments["test"] & environments["val"]
    assert not (environments["test"] | environments["val"]) & environments["smoke"]
    kinds = [kind_of(int(name[3:])) for name in environments["test"]]
    assert sum(kind in LARGE_KINDS for kind in kinds) == sum(kind in SMALL_KINDS for kind in kinds) == 15
    assert {kind_of(int(name[3:])) in LARGE_KINDS for name in environments["smoke"]} == {True, False}
    assert len({data.digest(name) for name in names["test"]}) == 150
    assert len({data.environment(name) for name in names["test"]}) == 30
    assert {data.environment(f"env007_crop{crop}") for crop in range(5)} == {"env007"}


def test_unknown_names_are_explained():
    data = Indoor()
    with pytest.raises(PcdbenchError, match=r"no split 'tset'; did you mean test"):
        data.scene_names("tset")
    with pytest.raises(PcdbenchError, match=r"endless.*training_scene"):
        data.scene_names("train")
    for name in ("env050_crop0", "env001_crop5", "env0001_crop0", "train001_crop0", "../x"):
        with pytest.raises(PcdbenchError, match="no scene"):
            data.scene(name)
    with pytest.raises(PcdbenchError, match="numbered from 0"):
        data.training_scene(-1)


def test_training_scenes_are_others_and_in_time(cache):
    environment.cache_clear()
    # Three seconds alone on two cores; other work may share them here.
    start = time.process_time()
    scene = Indoor().training_scene(6)
    assert time.process_time() - start < 3.0 * 2 * 3
    assert scene.name == "train000001_crop1"
    assert len(scene.complete) == COMPLETE_POINTS
    assert environment(1, "train").mesh.vertices.shape != environment(1).mesh.vertices.shape
    assert not list(cache.rglob("train*"))


def test_pieces_neither_float_nor_meet():
    place = environment(49)
    boxes = [tagged.box for tagged in place.objects if tagged.box.center[2] - tagged.box.size[2] / 2 < 0.05]
    assert len(boxes) >= 8
    prints = [Footprint(*box.center[:2], *(box.size[:2] / 2 - 0.005), box.yaw_rad, 0.0, 1.0) for box in boxes]
    met = [(a, b) for a in range(len(prints)) for b in range(a) if prints[a].meets(prints[b], 0.0)]
    chairs_at_tables = sum("chair" in place.objects[k].label for k in range(len(place.objects)))
    assert len(met) <= chairs_at_tables
    assert place.mesh.bounds()[0][2] > -0.2


def test_footprints_meet_as_sampled_points_say():
    rng = np.random.default_rng(0)
    for _ in range(200):
        a = Footprint(0.0, 0.0, *rng.uniform(0.2, 1.0, 2), rng.uniform(-3, 3), 0.0, 1.0)
        b = Footprint(*rng.uniform(-2, 2, 2), *rng.uniform(0.2, 1.0, 2), rng.uniform(-3, 3), 0.0, 1.0)
        grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 60)] * 2), -1).reshape(-1, 2) * [a.half_x, a.half_y]
        cos, sin = np.cos(a.yaw_rad), np.sin(a.yaw_rad)
        if b.holds(grid @ np.array([[cos, sin], [-sin, cos]])):
            assert a.meets(b, 0.0) and b.meets(a, 0.0)
        if a.meets(b, -0.05):
            assert b.holds(grid @ np.array([[cos, sin], [-sin, cos]]))
    high = Footprint(0.0, 0.0, 1.0, 1.0, 0.0, 2.0, 2.5)
    assert not high.meets(Footprint(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.9), 0.1)


def test_footprints_near_another_are_all_that_may_meet_it():
    rng = np.random.default_rng(1)
    drawn = [
        Footprint(*rng.uniform(-6, 6, 2), *rng.uniform(0.1, 1.0, 2), rng.uniform(-3, 3), low, low + rng.uniform(0.1, 1))
        for low in rng.uniform(0, 2, 300)
    ]
    standing = Footprints()
    for footprint in drawn:
        standing.add(footprint)
    assert list(standing) == drawn
    for asked in drawn[:40]:
        near = list(standing.near(asked, 0.1))
        met = [other for other in drawn if other.meets(asked, 0.1)]
        assert [other for other in near if other.meets(asked, 0.1)] == met and asked in met
        assert len(near) < 60


def test_outlines_are_cut_as_drawn():
    room = rectangle(0, 0, 4, 3)
    notched = cut_corner(room, 2, "notch", (1.0, 0.5))
    slanted = cut_corner(room, 2, "slant", (1.0, 1.0))
    curved = cut_corner(room, 2, "round", (1.0, 1.0))
    pier = bumped(room, 0, 1.0, 2.0, 0.5)
    points = np.random.default_rng(0).uniform([0, 0], [4, 3], (20_000, 2))
    for outline, area in ((room, 12.0), (notched, 11.5), (slanted, 11.5), (curved, 12 - (1 - np.pi / 4)), (pier, 11.5)):
        assert contains(outline, points).mean() * 12 == pytest.approx(area, abs=0.12)


if __name__ == "__main__":
    # Writes the reference anew; needed with every new version of the generator.
    made = {
        "environments": {str(index): environment_digests(index) for index in ENVIRONMENTS},
        "crops": {name: crop_reference(Indoor().scene(name)) for name in CROPS},
    }
    REFERENCE.write_text(json.dumps(made, separators=(",", ":")) + "\n")
