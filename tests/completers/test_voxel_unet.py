"""voxel_unet: the grid, the network's shapes, what is learned from, and what its shipped weights make of a room."""

from __future__ import annotations

import time

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from pcdbench_completers.local_surface import surface_spacing
from pcdbench_completers.prism import Prism
from pcdbench_completers.voxel_unet import tiles
from pcdbench_completers.voxel_unet.completer import (
    MAX_SHIFT,
    SHIPPED_WEIGHTS,
    USUAL_SHARE,
    VoxelUNetCompleter,
    given_what_is_missing,
    surface_points,
    unobserved,
)
from pcdbench_completers.voxel_unet.grid import CHANNELS, Grid, network_input, sub_voxel_means
from pcdbench_completers.voxel_unet.network import OUTPUTS, VoxelUNet, for_inference, placed, split_voxels
from pcdbench_completers.voxel_unet.tiles import Prediction
from pcdbench_completers.voxel_unet.trainee import VoxelUNetTrainee
from scipy.spatial import cKDTree

import pcdbench
from pcdbench.cloud import PointCloud
from pcdbench.geometry.chamfer import CloudDistances
from pcdbench.geometry.neighbors import loose_tree
from pcdbench.geometry.poses import rotation_about
from pcdbench.geometry.sampling import apart_indices, poisson_disk_indices
from pcdbench.testing import check_completer
from pcdbench.training.stream import TrainingPair

trained = pytest.mark.skipif(not SHIPPED_WEIGHTS.is_file(), reason="the package has no weights of voxel_unet")


def room(count: int, seed: int = 0) -> PointCloud:
    """Floor, ceiling and four walls of 6 x 4 x 2.6 m with 5 mm noise, evenly spread, a table in it."""
    rng = np.random.default_rng(seed)
    faces = []
    sides = np.array([6.0, 4.0, 2.6])
    areas = [(a, b, c, end) for a, b, c in ((0, 1, 2), (0, 2, 1), (1, 2, 0)) for end in (0.0, 1.0)]
    total = sum(sides[a] * sides[b] for a, b, _, _ in areas) + 2.0
    for a, b, c, end in areas:
        n = round(4 * count * sides[a] * sides[b] / total)
        points = np.zeros((n, 3))
        points[:, [a, b]] = rng.uniform(0, 1, (n, 2)) * sides[[a, b]]
        points[:, c] = end * sides[c]
        faces.append(points)
    table = rng.uniform(0, 1, (round(4 * count * 2.0 / total), 3)) * (2.0, 1.0, 0.0) + (2.0, 1.5, 0.75)
    points = np.concatenate([*faces, table]) + rng.normal(scale=0.005, size=(sum(map(len, faces)) + len(table), 3))
    colors = np.clip(0.5 + 0.3 * np.sin(points) + rng.normal(scale=0.02, size=points.shape), 0, 1)
    return PointCloud(points, colors.astype(np.float32)).select(poisson_disk_indices(points, count, rng))


def with_hole(cloud: PointCloud, center: tuple[float, float, float], radius: float) -> PointCloud:
    return cloud.select(np.linalg.norm(cloud.points - center, axis=1) > radius)


def test_cells_and_means_are_those_of_a_plain_loop() -> None:
    rng = np.random.default_rng(0)
    cloud = PointCloud(rng.uniform(-1, 1, (300, 3)), rng.uniform(0, 1, (300, 3)).astype(np.float32))
    grid = Grid.around(cloud.points, 0.3, rng.random(3))
    features = network_input(cloud, grid)
    cells: dict[tuple[int, ...], list[int]] = {}
    for row, point in enumerate(cloud.points):
        cells.setdefault(tuple(int(n) for n in (point - grid.origin) // 0.3), []).append(row)
    assert features.shape == (CHANNELS, *grid.shape)
    assert features[0].sum() == len(cells)
    for cell, rows in cells.items():
        center = grid.origin + (np.array(cell) + 0.5) * 0.3
        value = features[(slice(None), *cell)]
        assert value[1] == pytest.approx(np.log(len(rows)) / 2, abs=1e-6)
        assert value[2:5] == pytest.approx((cloud.points[rows].mean(axis=0) - center) / 0.3, abs=1e-6)
        assert value[5:8] == pytest.approx(2 * cloud.colors[rows].mean(axis=0) - 1, abs=1e-6)
    assert np.all(features[8] == 1)
    index, offsets, colors = sub_voxel_means(cloud, grid)
    assert colors is not None
    centers = (np.stack(np.unravel_index(index, [2 * n for n in grid.shape]), axis=1) + 0.5) * 0.15 + grid.origin
    restored = centers + offsets * 0.15
    near, _ = cKDTree(cloud.points).query(restored)
    singles = np.bincount(grid.cells(cloud.points, 2)[0])[index] == 1
    assert near[singles].max() < 1e-6


def test_a_part_of_the_input_is_the_input_of_the_part() -> None:
    cloud = room(3000)
    grid = Grid.around(cloud.points, 0.25)
    part = grid.part((3, 2, 1), (13, 12, 9))
    whole = network_input(cloud, grid)[:, 3:13, 2:12, 1:9]
    alone = network_input(cloud.select(part.holds(cloud.points)), part)
    assert np.allclose(whole, alone, atol=1e-5)


def test_the_network_has_its_size_and_answers_every_sub_voxel() -> None:
    network = VoxelUNet().eval()
    assert sum(parameter.numel() for parameter in network.parameters()) == pytest.approx(9.46e6, rel=0.01)
    with torch.inference_mode():
        out = network(torch.zeros(1, CHANNELS, 19, 22, 9))
    assert out.shape == (1, OUTPUTS, 38, 44, 18)
    offsets, colors = placed(10 * out[0, 1:].flatten(1).T)
    assert offsets.shape == colors.shape == (38 * 44 * 18, 3)
    assert offsets.abs().max() <= 0.5
    assert 0 <= colors.min() <= colors.max() <= 1


def test_its_answers_can_be_asked_for_one_by_one() -> None:
    torch.manual_seed(0)
    network = VoxelUNet().eval()
    features = torch.randn(1, CHANNELS, 9, 6, 7)
    with torch.inference_mode():
        whole = network(features)[0]
        trunk = network.trunk(features)
        at = torch.ones(18, 12, 14).nonzero()[::5]
        offsets, colors = placed(whole[1:][:, *at.T].T)
        assert torch.allclose(network.occupancy(trunk), whole[0], atol=1e-5)
        for one, other in zip(network.details(trunk, at), (offsets, colors), strict=True):
            assert torch.allclose(one, other, atol=1e-5)


@pytest.mark.parametrize("shape", [(16, 32, 16), (13, 9, 7), (17, 16, 5), (33, 2, 1), (1, 1, 1)])
def test_the_network_that_answers_is_the_one_that_learned(
    shape: tuple[int, int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sizes that halve to odd ones, where coarse voxels are cut in two; statistics of another network, all alike."""
    # Rounding to bfloat16 would hide what is compared here.
    monkeypatch.setattr("pcdbench_completers.voxel_unet.network.bfloat16_pays", lambda: False)
    torch.manual_seed(0)
    network = VoxelUNet().eval()
    for name, values in network.named_buffers():
        if name.endswith(("running_mean", "running_var")):
            values.uniform_(0.5, 1.5)
    features = torch.randn(1, CHANNELS, *shape)
    with torch.inference_mode():
        learned, answers = network.trunk(features), for_inference(network).trunk(features)
    assert answers.shape == (1, 16, *shape)
    torch.testing.assert_close(answers, learned, atol=1e-5 * float(learned.abs().max()), rtol=0)


def test_weights_of_before_the_prism_was_known_answer_as_they_did() -> None:
    torch.manual_seed(0)
    network = VoxelUNet().eval()
    state = network.state_dict()
    state["down.0.0.weight"] = state["down.0.0.weight"][:, :10]
    features = torch.rand(1, CHANNELS, 8, 8, 8)
    with torch.inference_mode():
        network.load_state_dict(state)
        answer = network(features)
        features[:, 10:] = 0
        assert torch.equal(network(features), answer)


def test_the_prism_is_the_hull_of_the_plan_without_strays() -> None:
    rng = np.random.default_rng(0)
    angle = np.pi / 6
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    box = rng.uniform((0, 0, 0), (4, 2, 2.5), (20_000, 3))
    box[:, :2] = box[:, :2] @ turn.T
    strays = np.array([[9.0, 9.0, 1.0], [-7.0, 0.0, 1.0], [0.5, 1.0, 6.0]])
    prism = Prism.around(np.concatenate([box, strays]), 0.25)
    assert (prism.low, prism.high) == pytest.approx((0.0, 2.5), abs=0.01)
    places = np.array([[2.0, 1.0, 1.2], [0.5, 1.0, 1.2], [4.3, 1.0, 1.2], [2.0, 1.0, -0.2], [2.0, 1.0, 2.4]])
    expected = [1.0, 0.5, -0.3, -0.2, 0.1]
    places[:, :2] = places[:, :2] @ turn.T
    assert prism.depth(places) == pytest.approx(expected, abs=0.03)


def test_a_prism_around_a_line_is_thin_and_around_three_points_is_theirs() -> None:
    line = np.linspace(0, 1, 50)[:, None] * (3.0, 0.0, 0.0)
    assert Prism.around(line, 0.1).depth(np.array([[1.5, 0.0, 0.0], [1.5, 1.0, 0.0]])) == pytest.approx([0.0, -1.0])
    assert Prism.around(line[:, [0, 0, 2]], 0.1).depth(np.array([[1.5, 1.5, 0.0], [2, 1, 0]])) == pytest.approx(
        [0.0, -np.sqrt(0.5)]
    )
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]])
    assert Prism.around(corners, 0.1).depth(np.array([[0.5, 0.5, 0.0]]))[0] == pytest.approx(0.0)


def test_the_network_is_told_how_deep_each_voxel_lies() -> None:
    cloud = room(3000)
    grid = Grid.around(cloud.points, 0.25)
    sides, top, bottom = 8 * 0.25 * network_input(cloud, grid)[10:]
    centers = grid.origin + 0.25 * (np.argwhere(np.ones(grid.shape)) + 0.5)
    depth = np.minimum(np.minimum(sides, top), bottom).reshape(-1)
    assert depth == pytest.approx(np.clip(grid.prism.depth(centers), -1.0, 3.0), abs=1e-5)


def test_split_voxels_puts_each_part_into_its_corner() -> None:
    x = torch.arange(16.0).view(1, 16, 1, 1, 1).repeat(1, 1, 2, 1, 1)
    out = split_voxels(x)
    assert out.shape == (1, 2, 4, 2, 2)
    assert out[0, 0, :2].flatten().tolist() == list(range(8))
    assert out[0, 1, 2:].flatten().tolist() == list(range(8, 16))


def pair(seed: int = 0, colored: bool = True) -> TrainingPair:
    truth = room(20_000, seed)
    complete = room(4_000, seed + 1)
    if not colored:
        complete = complete.without_colors()
    return TrainingPair(truth, complete, np.linalg.norm(complete.points - (3.0, 2.0, 0.0), axis=1) > 1.0)


def test_what_is_learned_is_where_the_truth_lies_and_not_what_was_observed() -> None:
    example = VoxelUNetTrainee().example(pair(), np.random.default_rng(0))
    state = example["state"]
    assert set(np.unique(state)) == {0, 1, 2, 3, 4}
    observed = example["features"][0].repeat(2, axis=0).repeat(2, axis=1).repeat(2, axis=2) > 0
    assert observed[state == 4].all()
    occupied = np.zeros(state.shape, bool)
    occupied[tuple(example["at"].T)] = True
    assert np.array_equal(occupied[state < 4], state[state < 4] % 2 == 1)
    # The hole in the floor: occupied sub-voxels far from observed ones, all in one layer or two.
    far = np.argwhere(state == 1)
    assert len(far) > 100
    assert np.abs(example["offsets"]).max() <= 0.5


def test_a_batch_counts_what_its_examples_count() -> None:
    trainee = VoxelUNetTrainee()
    rng = np.random.default_rng(0)
    examples = [trainee.example(pair(1), rng), trainee.example(pair(2, colored=False), rng)]
    (together,) = trainee.collate(examples)
    network = trainee.network().eval()
    losses = {}
    for name, chosen in {"both": [together], "each": [trainee.collate([one])[0] for one in examples]}.items():
        with torch.inference_mode():
            losses[name] = [trainee.loss(network, {k: torch.as_tensor(v) for k, v in one.items()}) for one in chosen]
    counts = [int((example["state"] < 4).sum()) for example in examples]
    each = [float(loss["entropy"]) for loss in losses["each"]]
    # Padding changes a little at the borders: the network sees empty space there instead of its own zero padding.
    assert float(losses["both"][0]["entropy"]) == pytest.approx(np.average(each, weights=counts), rel=0.05)
    assert float(losses["each"][1]["color"]) == 0.0
    assert float(losses["both"][0]["color"]) == pytest.approx(float(losses["each"][0]["color"]), rel=0.05)


def test_a_loss_computed_by_hand() -> None:
    """Everywhere odds of three to one for surface: 2 empty, 1 occupied, 2 and 1 beside observed ones, 2 observed."""
    state = torch.tensor([0, 0, 1, 2, 2, 3, 4, 4], dtype=torch.uint8).view(1, 2, 2, 2)
    out = torch.zeros(1, OUTPUTS, 2, 2, 2)
    out[:, 0] = np.log(3)
    example = {
        "features": torch.zeros(1, CHANNELS, 1, 1, 1),
        "state": state,
        "at": torch.tensor([[0, 0, 1, 0], [0, 1, 0, 1]]),
        "offsets": torch.full((2, 3), 0.1),
        "colors": torch.full((1, 3), 0.25),
        "colored": torch.tensor([True, False]),
    }
    losses = VoxelUNetTrainee().loss(lambda _: out, example)
    entropy = (1 + 0.25) * (2 * np.log(4) + np.log(4 / 3)) / 6
    assert float(losses["entropy"]) == pytest.approx(entropy, rel=1e-6)
    assert float(losses["loss"]) == pytest.approx(10 * entropy + 0.1 + 0.25, rel=1e-6)


def flat_prediction(spacing: float, noise: float, seed: int = 0) -> tuple[PointCloud, Prediction, NDArray[np.float64]]:
    """A floor of 4 x 4 m with a square hole of 2 x 2 m, and sub-voxels predicted in it with noisy heights."""
    rng = np.random.default_rng(seed)
    floor = np.concatenate([rng.uniform(-2, 2, (80_000, 2)), np.zeros((80_000, 1))], axis=1)
    even = floor[apart_indices(floor, 0.74 * spacing, rng)]
    even = even + rng.normal(scale=noise, size=even.shape) * (0, 0, 1)
    inside = np.all(np.abs(even[:, :2]) < 1.0, axis=1)
    edge = 0.875 * spacing
    axis = np.arange(-1 + edge / 2, 1, edge)
    cells = np.stack(np.meshgrid(axis, axis, [0.0]), axis=-1).reshape(-1, 3)
    cells = cells + rng.uniform(-0.3, 0.3, cells.shape) * edge * (1, 1, 0)
    cells = cells + rng.normal(scale=noise, size=cells.shape) * (0, 0, 1)
    found = Prediction(
        cells,
        np.full(len(cells), 0.9, np.float32),
        np.full((len(cells), 3), 0.5, np.float32),
        np.full(len(cells), 2, np.int8),
    )
    return PointCloud(even[~inside]), found, even[inside]


def test_added_points_are_a_thin_even_layer_as_dense_as_the_observed_ones() -> None:
    noise = 0.006
    cloud, found, truth = flat_prediction(0.08, noise)
    spacing = surface_spacing(cloud.points)
    found = unobserved(found, loose_tree(cloud.points), Grid.around(cloud.points, 2 * spacing), spacing)
    added, confidence = surface_points(cloud, loose_tree(cloud.points), found, spacing, np.random.default_rng(0))
    assert len(added) == len(confidence) == pytest.approx(len(truth), rel=0.1)
    assert np.abs(added.points[:, 2]).std() <= 2 * noise
    apart = cKDTree(np.concatenate([cloud.points, added.points])).query(added.points, k=2)[0][:, 1]
    assert apart.min() > 0.6 * spacing
    assert apart.max() < 1.6 * spacing
    assert (confidence == np.float32(0.9)).all()


def test_a_tile_asks_of_its_middle_what_was_not_observed_and_may_be_likely_enough() -> None:
    tile = (tiles._Span((10, 16), (12, 14)), tiles._Span((0, 1), (0, 1)), tiles._Span((0, 1), (0, 1)))
    occupancy = torch.full((12, 2, 2), 0.21)
    occupancy[5] = 0.19
    observed = np.array([6 * 4 + 1])
    # Three of 0.2 each pass 1 - 0.8^3 = 0.488 together, just.
    asked = tiles._may_be_surface(occupancy, 0.488, observed, tile)
    expected = torch.zeros(12, 2, 2, dtype=torch.bool)
    expected[[4, 6, 7]] = True
    expected[6, 0, 1] = False
    assert torch.equal(asked, expected)


def test_surface_is_the_likeliest_of_three_in_a_row_across_it() -> None:
    occupancy = torch.from_numpy(np.random.default_rng(0).uniform(size=(4, 5, 6)).astype(np.float32)) ** 4
    at = torch.ones_like(occupancy).nonzero()
    probability, ridge, across = (its.view(4, 5, 6) for its in tiles.surface(occupancy, at))
    padded = np.pad(occupancy.numpy(), 1)
    for cell in np.ndindex(4, 5, 6):
        rows = []
        for axis in range(3):
            step = np.eye(3, dtype=int)[axis]
            rows.append([padded[tuple(np.array(cell) + 1 + k * step)] for k in (-1, 0, 1)])
        axis = int(np.argmin([before + after + min(before, after) for before, _, after in rows]))
        before, here, after = rows[axis]
        assert int(across[cell]) == axis
        assert float(probability[cell]) == pytest.approx(1 - (1 - before) * (1 - here) * (1 - after), abs=1e-6)
        assert bool(ridge[cell]) == (here >= max(before, after))


def test_a_surface_whose_depth_is_uncertain_is_found_whole_and_in_one_layer() -> None:
    # A wall, somewhere within three sub-voxels, its occupancy as uneven along it as a network's.
    occupancy = torch.zeros(9, 14, 14)
    along = torch.from_numpy(np.random.default_rng(0).uniform(0.8, 1.2, size=(12, 12)).astype(np.float32))
    occupancy[3:6, 1:-1, 1:-1] = torch.tensor([0.2, 0.3, 0.15])[:, None, None] * along
    at = torch.ones_like(occupancy).nonzero()
    probability, ridge, across = (its.view(9, 14, 14) for its in tiles.surface(occupancy, at))
    inner = (slice(None), slice(2, -2), slice(2, -2))
    found = (ridge & (probability > 0.3))[inner]
    assert found[4].all() and int(found.sum()) == 100
    assert (across[inner][4] == 0).all()


def test_probabilities_follow_how_much_is_missing() -> None:
    # Observed: 2,000 sub-voxels with a point in the middle of each.
    grid = Grid(np.zeros(3), 2.0, (20, 20, 5), 0.0, Prism(np.zeros((0, 3)), 0.0, 10.0))
    cloud = PointCloud(np.stack(np.unravel_index(np.arange(2000), (40, 40, 10)), axis=1) + 0.5)

    def adjusted(count: int) -> NDArray[np.float32]:
        chances = np.resize(np.float32([0.2, 0.8]), count)
        found = Prediction(np.zeros((count, 3)), chances, np.zeros((count, 3), np.float32), np.zeros(count, np.int8))
        return given_what_is_missing(found, cloud, grid).probability

    usual = round(USUAL_SHARE * 2000 / 0.5)
    assert adjusted(usual) == pytest.approx(np.resize([0.2, 0.8], usual), abs=1e-3)
    assert adjusted(2 * usual)[:2] == pytest.approx([2 / (2 + 4), 8 / (8 + 1)], abs=1e-3)
    assert adjusted(2)[:2] == pytest.approx([1 / (1 + 4 * MAX_SHIFT), 4 / (4 + MAX_SHIFT)], abs=1e-3)
    assert adjusted(100 * usual)[:2] == pytest.approx(
        [MAX_SHIFT / (MAX_SHIFT + 4), 4 * MAX_SHIFT / (4 * MAX_SHIFT + 1)], abs=1e-3
    )
    assert len(adjusted(0)) == 0


@pytest.mark.parametrize(("says", "meant"), [(0.9, 0.75), (0.5, None)])
def test_of_a_small_hole_the_network_is_believed_a_third(
    says: float, meant: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Odds of 9 to 1 are 3 to 1 then; those of 1 to 1 fall below the threshold."""
    axis = np.arange(0, 4.01, 0.1)
    floor = np.stack(np.meshgrid(axis, axis, [0.0]), axis=-1).reshape(-1, 3)
    cloud = with_hole(PointCloud(floor - floor.mean(axis=0)), (0.0, 0.0, 0.0), 0.8)
    side = np.arange(-2, 3) * 0.09
    places = np.stack(np.meshgrid(side, side, [0.0]), axis=-1).reshape(-1, 3)
    found = Prediction(places, np.full(25, says, np.float32), np.zeros((25, 3), np.float32), np.full(25, 2, np.int8))
    monkeypatch.setattr("pcdbench_completers.voxel_unet.completer.predict", lambda *_: found)
    completer = VoxelUNetCompleter(network=VoxelUNet())
    completed, confidence = completer.complete_with_confidence(cloud, np.random.default_rng(0))
    assert (len(completed) > len(cloud)) == (meant is not None)
    assert confidence[len(cloud) :] == pytest.approx(meant or 0.0)


def test_colours_are_those_of_observed_surface_beside_it_and_the_networks_far_off() -> None:
    axis = np.arange(-2.0, 6.0, 0.05)
    cloud = PointCloud(np.stack([*np.meshgrid(axis, axis), np.zeros((160, 160))], axis=-1).reshape(-1, 3))
    cloud = cloud.select(cloud.points[:, 0] < 0)
    red = np.broadcast_to(np.float32((1, 0, 0)), cloud.points.shape)
    places = np.stack([*np.meshgrid(axis, axis), np.zeros((160, 160))], axis=-1).reshape(-1, 3)
    places = places[places[:, 0] > 0.05]
    gray = np.full((len(places), 3), 0.5, np.float32)
    found = Prediction(places, np.full(len(places), 0.9, np.float32), gray, np.full(len(places), 2, np.int8))
    added, _ = surface_points(
        PointCloud(cloud.points, red), loose_tree(cloud.points), found, 0.05, np.random.default_rng(0)
    )
    assert added.colors is not None
    beside, beyond = added.points[:, 0] < 0.1, added.points[:, 0] > 5.5
    assert added.colors[beside, 0].mean() > 0.9 > 0.1 > added.colors[beside, 1].mean()
    assert np.abs(added.colors[beyond] - 0.5).max() < 0.05


def test_validation_completes_with_the_options_of_the_training():
    trainee = VoxelUNetTrainee.for_options(VoxelUNetCompleter.Options(threshold=0.5))
    assert trainee.completer(trainee.network()).options.threshold == 0.5


@trained
def test_it_fills_the_hole_in_a_floor_and_keeps_every_point() -> None:
    complete = room(9000)
    cloud = with_hole(complete, (4.5, 2.0, 0.0), 0.8)
    completed = VoxelUNetCompleter().complete(cloud, np.random.default_rng(0))
    assert np.array_equal(completed.points[: len(cloud)], cloud.points)
    assert completed.colors is not None
    assert np.array_equal(completed.colors[: len(cloud)], cloud.colors)
    before = CloudDistances.between(cloud.points, complete.points).chamfer()
    after = CloudDistances.between(completed.points, complete.points).chamfer()
    assert after < 0.35 * before
    added = completed.points[len(cloud) :]
    hole = added[np.linalg.norm(added - (4.5, 2.0, 0.0), axis=1) < 0.8]
    assert np.abs(hole[:, 2] - np.median(hole[:, 2])).std() <= 2 * 0.005


@trained
def test_nothing_is_added_outside_of_what_was_observed() -> None:
    cloud = room(9000)
    cloud = with_hole(with_hole(cloud, (0.0, 2.0, 1.3), 1.0), (6.0, 4.0, 2.6), 0.8)
    completer = VoxelUNetCompleter(VoxelUNetCompleter.Options(threshold=0.05))
    added = completer.complete(cloud, np.random.default_rng(0)).points[len(cloud) :]
    spacing = surface_spacing(cloud.points)
    assert len(added) > 100
    assert Prism.around(cloud.points, 3.5 * spacing).depth(added).min() > -2 * spacing


@trained
def test_a_stray_far_off_costs_nothing() -> None:
    cloud = with_hole(room(3000), (4.5, 2.0, 0.0), 0.8)
    far = pcdbench.PointCloud([[5e5, 5.4e6, 300.0]], [[0.5, 0.5, 0.5]])
    completer = VoxelUNetCompleter()
    alone = completer.complete(cloud, np.random.default_rng(0))
    began = time.monotonic()
    both = completer.complete(pcdbench.PointCloud.concatenate([cloud, far]), np.random.default_rng(0))
    assert time.monotonic() - began < 30
    assert len(both) - 1 == pytest.approx(len(alone), rel=0.1)


def test_tiles_are_those_with_points_however_far_apart() -> None:
    grid = Grid(np.zeros(3), 0.1, (10**9, 50, 200), 0.0, Prism.around(room(300).points, 0.2))
    last = (10**9 - 1) // tiles.STEP
    blocks = {(0, 0, 0): np.zeros(1, np.int64), (last, 0, 1): np.zeros(1, np.int64)}
    began = time.monotonic()
    found = list(tiles._tiles_with_points(blocks, grid))
    assert time.monotonic() - began < 1
    assert found[0][0].read == (0, tiles.TILE) and found[0][1].read == (0, 50)
    assert found[-1][0].read[1] == found[-1][0].used[1] == 10**9
    assert found[-1][2].used == (tiles.STEP + tiles.HALO, 2 * tiles.STEP + tiles.HALO)


@trained
def test_it_needs_no_colour_and_moves_with_the_cloud() -> None:
    cloud = with_hole(room(5000), (4.5, 2.0, 0.0), 0.8)
    completer = VoxelUNetCompleter()
    here = completer.complete(cloud, np.random.default_rng(0))
    offset = np.array([4.5e5, 5.2e6, 300.0])
    there = completer.complete(PointCloud(cloud.points + offset, cloud.colors), np.random.default_rng(0))
    assert len(here) == pytest.approx(len(there), rel=0.01)
    assert cKDTree(here.points).query(there.points - offset)[0].mean() < 0.005
    assert completer.complete(cloud.without_colors(), np.random.default_rng(0)).colors is None


@trained
def test_a_turned_room_is_read_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = with_hole(room(9000), (4.5, 2.0, 0.0), 0.8)
    turn = rotation_about("z", np.radians(33.0))
    grids: list[Grid] = []
    around = Grid.around
    monkeypatch.setattr(Grid, "around", lambda *args: grids.append(around(*args)) or grids[-1])
    straight, turned = (
        VoxelUNetCompleter().complete(PointCloud(points, cloud.colors), np.random.default_rng(0)).points[len(cloud) :]
        for points in (cloud.points, cloud.points @ turn.T)
    )
    assert grids[0].shape == grids[1].shape
    assert grids[0].edge_m == pytest.approx(grids[1].edge_m)
    assert len(straight) > 100
    assert len(turned) == pytest.approx(len(straight), rel=0.1)
    apart, _ = cKDTree(straight).query(turned @ turn)
    assert np.quantile(apart, 0.95) < grids[0].edge_m


def test_what_is_learned_lies_along_the_axes() -> None:
    turn = rotation_about("z", np.radians(-25.0))
    its = pair()
    turned = TrainingPair(
        PointCloud(its.truth.points @ turn.T, its.truth.colors),
        PointCloud(its.complete.points @ turn.T, its.complete.colors),
        its.kept,
    )
    straight, example = (VoxelUNetTrainee().example(one, np.random.default_rng(1)) for one in (its, turned))
    assert example["state"].shape == straight["state"].shape
    assert (example["state"] == straight["state"]).mean() > 0.99


@trained
def test_a_higher_threshold_adds_less_and_confidence_is_above_it() -> None:
    cloud = with_hole(with_hole(room(12_000), (4.5, 2.0, 0.0), 1.2), (2.0, 0.0, 1.3), 0.9)
    counts = []
    for threshold in (0.05, 0.5, 0.95):
        completer = VoxelUNetCompleter(VoxelUNetCompleter.Options(threshold=threshold))
        completed, confidence = completer.complete_with_confidence(cloud, np.random.default_rng(0))
        assert len(confidence) == len(completed)
        assert (confidence[: len(cloud)] == 1).all()
        assert confidence.min() > threshold
        counts.append(len(completed) - len(cloud))
    assert counts[0] > counts[1] > counts[2]


@trained
def test_strays_outside_of_the_prism_cost_no_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    read = []
    monkeypatch.setattr(tiles, "network_input", lambda *args: read.append(args) or network_input(*args))
    strays = np.random.default_rng(0).uniform(50, 500, (30, 3))
    VoxelUNetCompleter().complete(
        pcdbench.PointCloud(np.concatenate([room(2000).points, strays])), np.random.default_rng(0)
    )
    assert len(read) == 1


def test_a_box_misses_the_prism_by_any_one_face() -> None:
    prism = Prism.around(room(3000).points, 0.5)
    low, high = np.array([1.0, 1.0, 1.0]), np.array([2.0, 2.0, 2.0])
    assert not prism.misses(low, high, 0.0)
    for axis in range(3):
        away = 20.0 * np.eye(3)[axis]
        for moved in (away, -away):
            assert prism.misses(low + moved, high + moved, 5.0) and not prism.misses(low + moved, high + moved, 30.0)
            assert not prism.misses(np.minimum(low, low + moved), np.maximum(high, high + moved), 0.0)
    assert not prism.misses(low + 99.0, high + 99.0, np.inf)


@trained
def test_tiles_give_what_one_piece_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    complete = room(12_000)
    cloud = with_hole(with_hole(complete, (4.5, 2.0, 0.0), 0.8), (2.0, 0.0, 1.3), 0.7)
    completer = VoxelUNetCompleter()
    whole = completer.complete(cloud, np.random.default_rng(0))
    monkeypatch.setattr(tiles, "STEP", 32)
    monkeypatch.setattr(tiles, "TILE", 32 + 2 * tiles.HALO)
    parts = completer.complete(cloud, np.random.default_rng(0))
    one, many = (CloudDistances.between(made.points, complete.points).chamfer() for made in (whole, parts))
    assert many == pytest.approx(one, rel=0.01)


@trained
def test_it_keeps_the_contract() -> None:
    check_completer(VoxelUNetCompleter())


def test_a_handful_of_points_comes_back_as_it_is() -> None:
    cloud = pcdbench.PointCloud(np.random.default_rng(0).uniform(size=(5, 3)))
    completed = VoxelUNetCompleter(network=VoxelUNet().eval()).complete(cloud, np.random.default_rng(0))
    assert np.array_equal(completed.points, cloud.points)


def test_weights_of_narrower_levels_answer_as_before_and_can_learn_in_the_new_channels() -> None:
    torch.manual_seed(0)
    narrow, wide = VoxelUNet((4, 6, 8)), VoxelUNet((4, 8, 16))
    features = torch.rand(1, CHANNELS, 8, 8, 4)
    for _ in range(3):  # statistics of its own
        narrow(features)
    wide.load_state_dict(narrow.state_dict())
    with torch.no_grad():
        assert torch.allclose(wide.eval()(features), narrow.eval()(features), atol=1e-5)
    wide(features).square().sum().backward()
    of_new, of_old = (wide.up[0][0].weight.grad[:, channels].abs().sum() for channels in (slice(8, 16), slice(8)))
    assert of_new > 0.01 * of_old > 0


def test_weights_of_wider_levels_are_of_another_network() -> None:
    with pytest.raises(RuntimeError, match="size mismatch"):
        VoxelUNet((4, 6, 8)).load_state_dict(VoxelUNet((4, 8, 16)).state_dict())
