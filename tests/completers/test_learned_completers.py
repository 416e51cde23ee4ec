"""deeppcd, deeppcd_merged, pcn, foldingnet as plugins: contract, merging, colours, and weights that are missing."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from completer_cases import box_room, far_from
from pcdbench_completers.deeppcd import completer as deeppcd
from pcdbench_completers.deeppcd.color import ColorNetwork, PaintingNetwork
from pcdbench_completers.deeppcd.completer import DeepPCD, DeepPCDMerged, DeepPCDMergedOptions, DeepPCDOptions
from pcdbench_completers.deeppcd.network import DeepPCDNetwork
from pcdbench_completers.foldingnet.completer import FoldingNet
from pcdbench_completers.foldingnet.network import FoldingNetNetwork
from pcdbench_completers.heading import RoomFrame
from pcdbench_completers.local_surface import surface_spacing
from pcdbench_completers.patchwise import PatchwiseCompleter, PatchwiseOptions, merged
from pcdbench_completers.pcn.completer import PCN
from pcdbench_completers.pcn.network import PCNNetwork
from pydantic import ValidationError
from safetensors.torch import save_file
from scipy.spatial import cKDTree
from typer.testing import CliRunner

from pcdbench import PcdbenchError, PointCloud
from pcdbench.cli import app, list_, run
from pcdbench.geometry.neighbors import nearest
from pcdbench.geometry.poses import rotation_about
from pcdbench.plugins import Registration, Registry, load_target
from pcdbench.runner.plan import Request, plan
from pcdbench.testing import check_completer
from pcdbench.weights import Weights


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def networks():
    torch.manual_seed(0)
    return {
        "geometry": DeepPCDNetwork(256).eval(),
        "painting": PaintingNetwork().eval(),
        "pcn": PCNNetwork().eval(),
        "foldingnet": FoldingNetNetwork().eval(),
    }


@pytest.fixture(params=["deeppcd", "deeppcd_merged", "pcn", "foldingnet"])
def completer(request, networks):
    own = {"network": networks["geometry"], "painting": networks["painting"]}
    lone = PatchwiseOptions(grid=2)
    return {
        "deeppcd": lambda: DeepPCD(DeepPCDOptions(grid=2, plane_points=256), **own),
        "deeppcd_merged": lambda: DeepPCDMerged(DeepPCDMergedOptions(grid=2, plane_points=256), **own),
        "pcn": lambda: PCN(lone, networks["pcn"]),
        "foldingnet": lambda: FoldingNet(lone, networks["foldingnet"]),
    }[request.param]()


def test_the_contract(completer):
    check_completer(completer)


@pytest.fixture(scope="module")
def room():
    return far_from(box_room(5000), [[2.0, 2.0, 0.0], [0.0, 2.0, 1.3]], 0.8)


def test_every_observed_point_is_kept_and_gaps_are_filled_at_the_observed_density():
    whole = box_room(8000)
    hole = np.array([3.0, 2.0, 0.0])
    room = far_from(whole, [hole.tolist()], 1.0)
    for found in (box_room(3000), box_room(20_000)):  # sparser and denser than what was observed
        result = merged(room, found, 2.0, rng())
        assert np.array_equal(result.points[: len(room)], room.points)
        assert np.array_equal(result.colors[: len(room)], room.colors)
        added = result.points[len(room) :]
        middle, filled = (np.linalg.norm(points - hole, axis=1) < 0.6 for points in (whole.points, added))
        assert 0.7 * middle.sum() < filled.sum() < 1.1 * middle.sum()
        assert (np.linalg.norm(added - hole, axis=1) < 1.0).all() and np.abs(added[:, 2]).max() < 0.05


def test_what_was_observed_alone_is_returned_where_nothing_else_was_found(room):
    assert len(merged(room, room, 2.0, rng())) == len(room)


def test_what_lies_over_observed_surface_is_the_networks_error_and_not_added(room):
    middle = room.points.mean(axis=0)
    hovering = PointCloud(room.points + 0.2 * (middle - room.points))  # 4 to 8 spacings off the walls
    assert len(merged(room.without_colors(), hovering, 3.0, rng())) == len(room)


def test_nothing_is_added_beyond_the_walls_and_the_ceiling(room):
    walls = room.points.max(axis=0)
    for axis in range(3):
        beyond = room.points.copy()
        beyond[:, axis] += walls[axis]
        added = merged(room.without_colors(), PointCloud(beyond), 3.0, rng()).points[len(room) :]
        assert (added <= walls + 0.2).all()
        # A floor that goes on through a wall is all that lies beside what was observed.
        assert len(added) < 0.05 * len(room)


def test_a_floor_without_walls_is_filled_and_does_not_go_on_beyond_its_edge():
    x, y = np.meshgrid(np.arange(0, 8.01, 0.1), np.arange(0, 4.01, 0.1))
    floor = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    observed = floor[(floor[:, 0] <= 4) & (np.linalg.norm(floor - [2.0, 2.0, 0.0], axis=1) > 0.8)]
    added = merged(PointCloud(observed), PointCloud(floor), 3.0, rng()).points[len(observed) :]
    assert len(added) > 50 and np.linalg.norm(added - [2.0, 2.0, 0.0], axis=1).max() < 0.8


def test_how_far_off_a_found_point_lies_is_measured_along_the_surface():
    def plate(spacing_m, height_m):
        steps = np.arange(0, 4.01, spacing_m)
        return np.stack(np.meshgrid(steps, steps, [height_m]), axis=3).reshape(-1, 3)

    room = PointCloud(np.concatenate([plate(0.1, 0.0), plate(0.1, 1.0)]))
    # Two and a half spacings above the floor, and so sparse that it could pass for the floor itself.
    assert len(merged(room, PointCloud(plate(0.3, 0.25)), 2.0, rng())) == len(room)


def test_a_found_point_that_has_no_others_beside_it_is_not_added():
    hole = np.array([3.0, 2.0, 0.0])
    room = far_from(box_room(8000), [hole.tolist()], 1.0)
    strays = np.stack(np.meshgrid([2.6, 3.4], [1.6, 2.4], [0.8, 1.6]), axis=3).reshape(-1, 3)
    found = PointCloud(np.concatenate([box_room(8000).points, strays]))
    added = merged(room.without_colors(), found, 3.0, rng()).points[len(room) :]
    assert len(added) > 50 and added[:, 2].max() < 0.05
    strays_alone = PointCloud(np.concatenate([room.points, strays]))
    assert len(merged(room.without_colors(), strays_alone, 3.0, rng())) == len(room)


def test_a_surface_that_carries_on_nothing_that_was_observed_is_not_added():
    hole = np.array([3.0, 2.0, 0.0])
    room = far_from(box_room(8000), [hole.tolist()], 1.0).without_colors()
    side = np.linspace(-0.4, 0.4, 17)
    level = hole + np.stack(np.meshgrid(side, side, [0.0]), axis=3).reshape(-1, 3)
    for up, kept in ((level, True), (hole + (level - hole)[:, [0, 2, 1]], False)):
        added = merged(room, PointCloud(np.concatenate([room.points, up])), 3.0, rng()).points[len(room) :]
        assert (len(added) > 20) == kept and (kept or not len(added))


def test_added_points_continue_the_observed_colors_unless_the_found_ones_have_their_own():
    room = far_from(box_room(8000), [[3.0, 2.0, 0.0]], 1.0)
    red, green = (np.tile(np.float32(color), (20_000, 1)) for color in ((1, 0, 0), (0, 1, 0)))
    observed = PointCloud(room.points, red[: len(room)])
    found = PointCloud(box_room(20_000).points, green)
    for these, color in ((found.without_colors(), red[0]), (found, green[0])):
        added = merged(observed, these, 3.0, rng()).colors[len(room) :]
        assert len(added) > 50 and np.abs(added - color).max() < 0.01


class Creeping(PatchwiseCompleter):
    """Finds the floor at half a metre about what is there."""

    Options = PatchwiseOptions

    def __init__(self, options, floor):
        super().__init__(options)
        self.floor = floor

    def found(self, cloud, patches, rng):
        return self.floor.select(nearest(self.floor.points, cloud.points)[0] < 0.5)


def test_a_second_pass_goes_on_from_what_the_first_one_added():
    hole = np.array([3.0, 2.0, 0.0])
    room = far_from(box_room(8000), [hole.tolist()], 1.2).without_colors()
    floor = RoomFrame.of(room.points).laid(box_room(20_000).without_colors())

    def reached(passes):
        result = Creeping(PatchwiseOptions(grid=2, keep_observed=True, passes=passes), floor).complete(room, rng())
        assert np.array_equal(result.points[: len(room)], room.points)
        return np.linalg.norm(result.points - hole, axis=1).min()

    assert 0.6 < reached(1) < 0.8 and reached(2) < 0.35
    with pytest.raises(ValidationError, match="keep_observed=true"):
        PatchwiseOptions(passes=2)
    with pytest.raises(ValueError, match="add keep_observed=true, or leave it"):
        PatchwiseOptions(clearance_spacings=2.0)


def test_the_networks_own_cloud_has_its_points_in_every_patch(networks, room):
    result = DeepPCD(DeepPCDOptions(grid=2, plane_points=256), networks["geometry"], networks["painting"])
    completed = result.complete(room, rng())
    assert len(completed) == 4 * 256 and completed.colors is not None
    assert result.complete(room.without_colors(), rng()).colors is None
    assert np.array_equal(result.complete(room.without_colors(), rng()).points, completed.points)


def test_observed_colors_are_kept_where_the_completed_point_lies_on_observed_surface(monkeypatch, networks, room):
    placed = PointCloud(np.concatenate([room.points[:512] + 0.001, [[2.0, 2.0, 0.0]] * 512]))
    placed = RoomFrame.of(room.points).laid(placed).points

    def put(network, patches, around):
        return patches.grid.scaled(placed).astype(np.float32)

    monkeypatch.setattr("pcdbench_completers.deeppcd.inference.completed", put)
    options = DeepPCDOptions(grid=2, plane_points=256)
    completed = DeepPCD(options, networks["geometry"], networks["painting"]).complete(room, rng())
    assert np.array_equal(completed.colors[:512], room.colors[:512])
    painted = completed.colors[512:]
    assert np.ptp(painted, axis=0).max() < 0.2 and np.abs(painted - 0.5).max() < 0.3  # an untrained network is gray
    nearest = DeepPCD(options.model_copy(update={"color": "nearest"}), networks["geometry"]).complete(room, rng())
    assert all((color == room.colors).all(axis=1).any() for color in nearest.colors[512:520])


def test_patches_of_pcn_and_foldingnet_know_nothing_of_each_other(networks):
    torch.manual_seed(1)
    points = torch.rand(3, 1024, 3)
    chosen = torch.randint(0, 16_384, (3, 100))
    neighbors = torch.randint(0, 1024, (3, 1024, 16))
    with torch.no_grad():
        both = networks["pcn"](points, chosen)[1], networks["foldingnet"](points, neighbors)
        alone = networks["pcn"](points[:1], chosen[:1])[1], networks["foldingnet"](points[:1], neighbors[:1])
        assert networks["pcn"](points[:1])[1].shape == (1, 16_384, 3) and both[1].shape == (3, 2025, 3)
    for one, other in zip(both, alone, strict=True):
        assert torch.allclose(one[:1], other, atol=1e-5)


def test_pcn_and_foldingnet_have_their_published_layers(networks):
    def size(*layers):
        return sum(a * b + b for a, b in layers)

    pcn = size((3, 128), (128, 256), (512, 512), (512, 1024), (1024, 1024), (1024, 1024), (1024, 3072))
    pcn += size((1029, 512), (512, 512), (512, 3))
    folding = size((12, 64), (64, 64), (64, 64), (64, 128), (128, 1024), (1024, 512), (512, 512))
    folding += size((514, 512), (512, 512), (512, 3), (515, 512), (512, 512), (512, 3))
    assert sum(value.numel() for value in networks["pcn"].parameters()) == pcn
    assert sum(value.numel() for value in networks["foldingnet"].parameters()) == folding


def saved(folder, **modules):
    files = {}
    for name, module in modules.items():
        files[name] = folder / f"{name}.safetensors"
        save_file({key: value.half() for key, value in module.state_dict().items()}, files[name])
    return files


def test_weights_of_ones_own(tmp_path, networks, room):
    torch.manual_seed(0)
    files = saved(tmp_path, geometry=networks["geometry"], color=ColorNetwork())
    alone = {"grid": 2, "plane_points": 256, "weights": str(files["geometry"])}
    options = alone | {"color": "network", "color_weights": str(files["color"])}
    loaded = DeepPCD(DeepPCDOptions(**options))
    assert len(loaded.weights_digest()) == 64
    again = DeepPCDMerged(DeepPCDMergedOptions(**options))
    assert again.weights_digest() == loaded.weights_digest()
    one = loaded.complete(room.without_colors(), rng())
    other = DeepPCD(DeepPCDOptions(grid=2, plane_points=256), networks["geometry"], networks["painting"])
    assert np.abs(one.points - other.complete(room.without_colors(), rng()).points).max() < 0.02  # float16
    geometry_alone = DeepPCD(DeepPCDOptions(**alone))
    assert geometry_alone.weights_digest() != loaded.weights_digest()


def test_weights_under_ones_home_are_found_and_a_path_that_is_none_is_one_line(monkeypatch, tmp_path, networks):
    monkeypatch.setenv("HOME", str(tmp_path))
    saved(tmp_path, geometry=networks["geometry"])
    assert Weights(tmp_path / "none", "~/geometry.safetensors", "deeppcd").card is None
    for path in ("~nobody/geometry.safetensors", "x" * 5000):
        with pytest.raises(PcdbenchError, match=r"the weights of deeppcd are not at .*; check the path"):
            Weights(tmp_path / "none", path, "deeppcd")


def test_weights_of_a_colour_network_that_is_not_asked_for_are_told():
    with pytest.raises(ValidationError, match="add color=network"):
        DeepPCDOptions(color_weights="color.safetensors")


def test_weights_of_another_network_are_one_line(tmp_path, networks):
    files = saved(tmp_path, geometry=networks["geometry"])
    with pytest.raises(PcdbenchError, match="another network"):
        DeepPCD(DeepPCDOptions(generator=False, color="nearest", weights=str(files["geometry"])))


@pytest.mark.usefixtures("tiny_plugins")
def test_missing_weights_say_how_to_train_and_all_leaves_such_completers_out(monkeypatch, tmp_path):
    monkeypatch.setattr(deeppcd, "SHIPPED", tmp_path / "weights.safetensors")
    with pytest.raises(PcdbenchError, match="pcdbench train deeppcd") as caught:
        DeepPCD()
    assert "\n" not in str(caught.value)
    asked = Request(["all"], ["tiny_gap"], dataset="tiny", incompletenesses=["slab"])
    planned = plan(asked)
    assert {"deeppcd", "deeppcd_merged"} <= set(planned.left_out)
    assert "pcdbench train deeppcd" in planned.left_out["deeppcd"]
    assert "plane_fitting" in {plugin.name for plugin in planned.completers}
    with pytest.raises(PcdbenchError, match="pcdbench train deeppcd"):
        plan(replace(asked, completers=["deeppcd"]))


def test_list_shows_that_weights_are_missing(monkeypatch, tmp_path):
    there = tmp_path / "there.safetensors"
    there.touch()
    name = {"target": "a:B", "summary": "sums", "reference": False, "origin": "here"}
    registry = Registry()
    registry.add(Registration("completer", "one", **name, weights=(there, tmp_path / "absent.safetensors")))
    registry.add(Registration("completer", "two", **name, weights=(there,)))
    monkeypatch.setattr(list_, "registry", lambda: registry)
    lines = CliRunner().invoke(app, ["list"]).stdout.splitlines()
    assert lines[1:3] == ["  one  sums [weights missing]  here", "  two  sums                    here"]


def test_a_run_tells_what_it_leaves_out_in_one_line_for_all_without_weights(monkeypatch, tmp_path):
    name = {"summary": "", "reference": False, "origin": "here", "weights": (tmp_path / "absent.safetensors",)}
    found = [Registration("completer", its, "a:B", **name) for its in ("one", "two", "asked_for")]
    found.append(Registration("completer", "broken", "a:B", **name | {"weights": ()}))
    monkeypatch.setattr("pcdbench.plugins.Registry.all", lambda *_: found)
    lines = run._left_out({"one": "no weights", "broken": "it has a bug", "two": "no weights"})
    assert lines[0] == "broken is left out: it has a bug" and len(lines) == 2
    assert "one, two (" in lines[1] and "asked_for" not in lines[1]


def test_the_color_network_in_the_package_paints_what_was_not_observed(room):
    """Where nothing was observed, and nowhere else."""
    cloud = far_from(room, room.points[::600].tolist(), 0.6)
    painted = DeepPCD(DeepPCDOptions(color="network")).complete(cloud, rng())
    nearest = DeepPCD().complete(cloud, rng())
    assert np.array_equal(painted.points, nearest.points)
    other = np.any(painted.colors != nearest.colors, axis=1)
    assert 0.02 < other.mean() < 0.9
    away, _ = cKDTree(cloud.points).query(nearest.points)
    new = away > deeppcd.OBSERVED_SPACINGS * surface_spacing(cloud.points - cloud.points.mean(axis=0))
    assert other[new].mean() > 0.95 and not other[~new].any()
    assert painted.colors.min() >= 0 and painted.colors.max() <= 1


def test_missing_weights_of_a_part_name_the_options_they_are_given_by(monkeypatch, tmp_path, networks):
    monkeypatch.setattr(deeppcd, "SHIPPED_COLOR", tmp_path / "color.safetensors")
    with pytest.raises(PcdbenchError, match=r"train deeppcd\.color .*--option deeppcd\.color_weights=DIR"):
        DeepPCD(DeepPCDOptions(color="network"), networks["geometry"])


@pytest.mark.parametrize("completer", [DeepPCD, DeepPCDMerged, PCN, FoldingNet])
def test_trainees_are_where_completers_say(completer):
    trainee = load_target(completer.trainee)()
    assert "default" in trainee.presets and "published" in trainee.presets


def test_a_part_is_trained_by_its_name_and_another_is_refused(tmp_path):
    assert "default" in load_target(DeepPCD.color_trainee)().presets
    refused = CliRunner().invoke(app, ["train", "deeppcd.shape", "--steps", "1", "--out", str(tmp_path / "out")])
    assert refused.exit_code == 2 and "deeppcd.shape learns nothing" in refused.stderr


def test_map_coordinates_cost_nothing(networks, room):
    offset = np.array([2.0**20, -(2.0**21), 64.0])
    exact = PointCloud(np.round(room.points * 2**20) / 2**20)
    completer = PCN(PatchwiseOptions(grid=2), networks["pcn"])
    far = completer.complete(PointCloud(exact.points + offset), rng())
    assert np.abs(far.points - offset - completer.complete(exact, rng()).points).max() < 1e-6


@pytest.mark.parametrize("degrees", [20.0, -35.0])
def test_a_room_is_completed_alike_however_its_scan_is_turned(completer, room, degrees):
    R_scan_room = rotation_about("z", np.radians(degrees))
    offset = np.array([300.0, -200.0, 5.0])
    straight = completer.complete(room, rng())
    turned = completer.complete(PointCloud(room.points @ R_scan_room.T + offset, room.colors), rng())
    back = (turned.points - offset) @ R_scan_room
    # Points at a border may fall into another patch; nearly all the others are the same.
    assert np.quantile(nearest(back, straight.points)[0], 0.9) < 1e-3
    assert np.quantile(nearest(straight.points, back)[0], 0.9) < 1e-3
