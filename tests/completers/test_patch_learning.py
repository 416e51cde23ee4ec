"""What patchwise networks learn from: losses by brute force, true patches, examples, and that a step or two teaches."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from completer_cases import box_room
from hypothesis import given, settings
from hypothesis import strategies as st
from pcdbench_completers.deeppcd.color_trainee import PAINTED, ColorTrainee
from pcdbench_completers.deeppcd.completer import DeepPCD, DeepPCDOptions
from pcdbench_completers.deeppcd.trainee import NEIGHBORHOODS, DeepPCDTrainee
from pcdbench_completers.foldingnet.completer import FoldingNet
from pcdbench_completers.foldingnet.trainee import FoldingNetTrainee
from pcdbench_completers.heading import wall_heading
from pcdbench_completers.patch_truth import distances_by_patch, evenly, true_patches
from pcdbench_completers.patches import Patches
from pcdbench_completers.patchwise import PatchwiseOptions
from pcdbench_completers.pcn.completer import PCN
from pcdbench_completers.pcn.trainee import PCNTrainee

from pcdbench import PointCloud
from pcdbench.geometry.poses import rotation_about
from pcdbench.plugins import load_target
from pcdbench.training.chamfer import matched, mean_by_group
from pcdbench.training.stream import TrainingPair

TRAINEES = {
    "deeppcd": DeepPCDTrainee(DeepPCDOptions(grid=1)),
    "flat": DeepPCDTrainee(DeepPCDOptions(grid=1, generator=False, plane_points=256)),
    "color": ColorTrainee(DeepPCDOptions(grid=1)),
    "pcn": PCNTrainee(PatchwiseOptions(grid=1)),
    "foldingnet": FoldingNetTrainee(PatchwiseOptions(grid=1)),
}


@pytest.fixture(scope="module")
def pair():
    room = box_room(4000)
    complete = room.select(np.arange(0, len(room), 2))
    kept = np.linalg.norm(complete.points - [2.0, 2.0, 0.0], axis=1) > 1.2
    return TrainingPair(room, complete, kept)


def example(trainee, pair, seed=0):
    return trainee.example(pair, np.random.default_rng(seed))


def tensors(made):
    return {name: torch.as_tensor(value) for name, value in made.items()}


def brute(found, truth):
    """The differences that KD-trees must find, by all pairs."""
    apart = np.linalg.norm(found[:, None] - truth, axis=2)
    return found - truth[apart.argmin(axis=1)], truth - found[apart.argmin(axis=0)]


@settings(max_examples=25, deadline=None)
@given(found=st.integers(1, 40), truth=st.integers(1, 40), seed=st.integers(0, 999))
def test_matches_are_those_of_all_pairs(found, truth, seed):
    rng = np.random.default_rng(seed)
    a, b = (rng.normal(size=(count, 3)).astype(np.float32) for count in (found, truth))
    for one, other in zip(matched(torch.from_numpy(a), torch.from_numpy(b)), brute(a, b), strict=True):
        assert np.allclose(one.norm(dim=1), np.linalg.norm(other, axis=1), atol=1e-5)


def test_points_match_within_their_group():
    rng = np.random.default_rng(1)
    a, b = rng.random((60, 3)).astype(np.float32), rng.random((50, 3)).astype(np.float32)
    a_of, b_of = rng.permutation(np.arange(60) % 3), rng.permutation(np.arange(50) % 3)
    there, back = matched(*map(torch.from_numpy, (a, b, a_of, b_of)))
    for group in range(3):
        expected = brute(a[a_of == group], b[b_of == group])
        assert np.allclose(there[a_of == group], expected[0]) and np.allclose(back[b_of == group], expected[1])


def test_the_gradient_moves_a_point_to_its_match_and_what_chose_it():
    found = torch.tensor([[0.0, 0, 0], [1, 0, 0]], requires_grad=True)
    truth = torch.tensor([[0.1, 0, 0], [0.4, 0, 0]])
    there, back = matched(found, truth)
    (there.square().sum(dim=1).mean() + back.square().sum(dim=1).mean()).backward()
    # Found 0 is nearest to true 0 and is the nearest of both true points; found 1 is nearest to true 1 alone.
    assert torch.allclose(found.grad[:, 0], torch.tensor([-0.1 - 0.1 - 0.4, 0.6]))


def test_means_by_group():
    means = mean_by_group(torch.tensor([1.0, 2.0, 6.0]), torch.tensor([0, 2, 2]), 4)
    assert means.tolist() == [1.0, 0.0, 4.0, 0.0]


@pytest.mark.parametrize("power", [1, 2])
def test_distances_by_patch_by_brute_force(power):
    rng = np.random.default_rng(2)
    found, truth = rng.random((3, 20, 3)).astype(np.float32), rng.random((45, 3)).astype(np.float32)
    truth_of = np.sort(rng.integers(0, 3, 45))
    there, back = distances_by_patch(*map(torch.from_numpy, (found, truth, truth_of)), power)
    for patch in range(3):
        to_truth, from_truth = brute(found[patch], truth[truth_of == patch])
        assert there[patch] == pytest.approx((np.linalg.norm(to_truth, axis=1) ** power).mean(), rel=1e-4)
        assert back[patch] == pytest.approx((np.linalg.norm(from_truth, axis=1) ** power).mean(), rel=1e-4)


def test_even_samples_are_as_dense_everywhere():
    rng = np.random.default_rng(3)
    dense, sparse = rng.random((9000, 3)) * [5, 5, 0], rng.random((3000, 3)) * [5, 5, 0] + [10, 0, 0]
    points = np.concatenate([dense, sparse])
    rows = evenly(points, 1500, rng)
    assert len(rows) == pytest.approx(1500, rel=0.15) and len(set(rows)) == len(rows)
    assert (rows < len(dense)).sum() == pytest.approx((rows >= len(dense)).sum(), rel=0.1)


def test_true_patches_lie_where_their_patches_do():
    room = box_room(6000)
    observed = room.select(room.points[:, 0] + room.points[:, 1] > 2.5)
    patches = Patches.of(observed.points, 3, np.random.default_rng(0))
    of, points = true_patches(patches, patches.grid.scaled(room.points))
    metric = patches.grid.metric(patches.low[of] + patches.scale * points)
    distances = np.linalg.norm(metric[:, None] - room.points[::20], axis=2).min(axis=0)
    assert (distances < 1e-5).mean() > 0.9  # all but those of cells that were left out
    cell = (metric[:, :2] - patches.grid.low[:2]) / patches.grid.side_m / patches.grid.extent[:2] * 3
    border = patches.cells[of]
    assert ((cell > border - 0.011) | (border == 0)).all() and ((cell < border + 1.011) | (border == 2)).all()


@pytest.mark.parametrize("target", [DeepPCD.trainee, DeepPCD.color_trainee, PCN.trainee, FoldingNet.trainee])
def test_training_and_validation_cut_by_the_options(target, pair, monkeypatch):
    of, grids = Patches.of, []
    monkeypatch.setattr(Patches, "of", lambda points, grid, rng: (grids.append(grid), of(points, grid, rng))[1])
    options = DeepPCDOptions if "deeppcd" in target else PatchwiseOptions
    trainee = load_target(target).for_options(options(grid=2))
    assert len(example(trainee, pair)["points"]) == 4
    trainee.completer(trainee.network().eval()).complete(pair.complete, np.random.default_rng(0))
    assert grids == [2, 2]


@pytest.mark.parametrize("target", [DeepPCD.trainee, DeepPCD.color_trainee, PCN.trainee, FoldingNet.trainee])
def test_training_and_validation_cut_along_the_walls(target, pair, monkeypatch):
    R_scan_room = rotation_about("z", np.radians(30))
    of, headings = Patches.of, []
    monkeypatch.setattr(
        Patches, "of", lambda points, grid, rng: (headings.append(wall_heading(points)), of(points, grid, rng))[1]
    )
    truth, complete = (PointCloud(cloud.points @ R_scan_room.T, cloud.colors) for cloud in (pair.truth, pair.complete))
    trainee = load_target(target).for_options((DeepPCDOptions if "deeppcd" in target else PatchwiseOptions)(grid=2))
    example(trainee, replace(pair, truth=truth, complete=complete))
    trainee.completer(trainee.network().eval()).complete(complete, np.random.default_rng(0))
    assert len(headings) == 2 and np.degrees(np.abs(headings)).max() < 0.5


@pytest.mark.parametrize("name", TRAINEES)
def test_an_example_is_decided_by_its_generator(name, pair):
    one, again, other = (example(TRAINEES[name], pair, seed) for seed in (1, 1, 2))
    assert all(np.array_equal(one[key], again[key]) for key in one)
    assert any(not np.array_equal(one[key], other[key]) for key in one)


@pytest.mark.parametrize("name", TRAINEES)
def test_losses_are_deterministic_and_every_weight_learns(name, pair):
    torch.manual_seed(0)
    trainee = TRAINEES[name]
    network, made = trainee.network(), tensors(example(trainee, pair))
    losses = trainee.loss(network, made)
    assert losses["loss"].dtype == torch.float32
    assert losses["loss"].item() == trainee.loss(network, made)["loss"].item()
    losses["loss"].backward()
    silent = [key for key, value in network.named_parameters() if value.grad is None or not value.grad.abs().max() > 0]
    # With a single patch attention has nothing to choose, so query and key learn nothing.
    assert all(key.startswith(("relations.query", "relations.key")) for key in silent)


@pytest.mark.parametrize("name", TRAINEES)
def test_a_few_steps_on_one_pair_lower_its_loss(name, pair):
    torch.manual_seed(0)
    trainee = TRAINEES[name]
    network, made = trainee.network(), tensors(example(trainee, pair))
    optimizer = torch.optim.AdamW(trainee.parameter_groups(network))
    term = "color" if name == "color" else "loss"
    values = []
    for step in range(20):
        for group in optimizer.param_groups:
            group["lr"] = 1e-3 * (step + 1) / 20 * group.get("rate", 1.0)
        optimizer.zero_grad()
        losses = trainee.loss(network, made)
        losses["loss"].backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        values.append(losses[term].item())
    assert min(values[-3:]) < 0.8 * values[0]


def test_deeppcds_loss_computed_by_hand():
    """One patch of half the cloud's size, one point; all that is true lies at the origin and faces (0, 0.6, 0.8)."""
    planes, patches, points = torch.tensor([[[0, 0, 0.1]]]), torch.tensor([[[0, 0.2, 0]]]), torch.tensor([[0.3, 0, 0]])
    turns = 2 * torch.eye(3)[None, None]
    made = dict.fromkeys(["points", "cells", "low", "chosen", *NEIGHBORHOODS])
    made |= {"scale": torch.tensor(0.5), "truth": torch.zeros(1, 3), "patch_truth": torch.zeros(1, 3)}
    made |= {"patch_of": torch.tensor([0]), "normals": torch.tensor([[[0, 0.6, 0.8]]])}
    losses = TRAINEES["deeppcd"].loss(lambda *_: (planes, patches, points, turns), made)
    expected = {
        "cloud": 2 * 0.3**2 / 0.5**2,
        "patch": 2 * 0.2**2,
        "plane": 2 * 0.1**2,
        "turn": 3 * (1 - 2**2) ** 2,
        "face": 1 - 0.8**2,
    }
    assert {name: float(losses[name]) for name in expected} == pytest.approx(expected, rel=1e-5)
    weights = {"cloud": 1.0, "patch": 0.5, "plane": 0.5, "turn": 0.001, "face": 0.02}
    assert float(losses["loss"]) == pytest.approx(sum(weights[name] * expected[name] for name in weights), rel=1e-5)


def test_the_discriminator_learns_at_half_the_rate():
    trainee = TRAINEES["color"]
    painter, judge = trainee.parameter_groups(trainee.network())
    assert trainee.presets["published"].learning_rate == 2e-4 and "rate" not in painter and judge["rate"] == 0.5


def test_pairs_without_colors_are_painted_as_the_truth_is(pair):
    colorless = TrainingPair(pair.truth, pair.complete.without_colors(), pair.kept)
    one, other = example(TRAINEES["color"], colorless), example(TRAINEES["color"], pair)
    assert np.allclose(one["colors"], other["colors"]) and one["truth_colors"].shape == (1, PAINTED, 3)


def test_the_published_recipe_is_a_preset():
    published = TRAINEES["deeppcd"].presets["published"]
    assert published.learning_rate == 3e-4 and published.schedule == "plateau" and published.weight_decay == 0
    assert published.steps * published.batch == 500 * 1200 and published.validate_every * published.batch == 20 * 1200
