"""DeepPCD's networks: the published size, invariances, the embedding's properties, exact shortcuts, who learns what."""

import numpy as np
import pytest
import torch
from completer_cases import box_room, far_from
from pcdbench_completers.deeppcd.color import ColorNetwork
from pcdbench_completers.deeppcd.inference import painted
from pcdbench_completers.deeppcd.neighborhoods import NEIGHBORS, Neighborhoods, farthest
from pcdbench_completers.deeppcd.network import (
    DeepPCDNetwork,
    Displacement,
    PlanePointGenerator,
    Relations,
    plane_points,
    position_embedding,
)
from pcdbench_completers.layers import SplitLinear, Standardized, neighbor_max
from pcdbench_completers.patch_neighbors import within
from pcdbench_completers.patches import Patches

from pcdbench.training.precision import bfloat16_pays


@pytest.fixture(scope="module")
def patches():
    room = far_from(box_room(12_000), [[2.0, 2.0, 0.0]], 0.8)
    return Patches.of(room.points, 3, np.random.default_rng(1))


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    return DeepPCDNetwork().eval()


def around(points):
    found = Neighborhoods.of(points)
    return tuple(map(torch.from_numpy, (found.sampled_1, found.neighbors_1, found.sampled_2, found.neighbors_2)))


def completed(network, patches, points=None, select=slice(None), **more):
    points = (patches.points if points is None else points)[select]
    with torch.inference_mode():
        return network(
            torch.from_numpy(points),
            around(points),
            torch.from_numpy(patches.cells[select]),
            torch.from_numpy(patches.low[select]),
            torch.tensor(patches.scale),
            **more,
        )


def parameters(module):
    return sum(value.numel() for value in module.parameters())


def test_the_geometry_network_has_the_published_size(network):
    assert parameters(network) == 7_735_055
    assert abs(4 * parameters(network) / 30.9e6 - 1) < 0.01
    assert parameters(network.encoder) == 733_696
    assert parameters(network.relations) == 4 * 590_592 + 3_072 + 1_574_656
    assert parameters(network.generator) == 1_842_185
    assert parameters(network.local_displacement) == parameters(network.global_displacement) == 609_539


def test_the_color_network_has_the_size_of_its_tables():
    network = ColorNetwork()
    assert parameters(network) == 2_608_196
    assert parameters(network.generator) == 913_475 and parameters(network.discriminator) == 1_354_817


def test_the_order_of_a_patchs_points_does_not_matter(network, patches):
    order = np.random.default_rng(5).permutation(patches.points.shape[1])
    one, other = completed(network, patches), completed(network, patches, patches.points[:, order])
    # Neighbours at equal distances may be told apart by their order; there are next to none.
    assert (one.points - other.points).abs().max() < 1e-5


def test_the_order_of_patches_orders_the_result_and_changes_nothing_else(network, patches):
    order = np.random.default_rng(6).permutation(len(patches.points))
    one, other = completed(network, patches), completed(network, patches, select=order)
    assert (one.patches[order] - other.patches).abs().max() < 1e-5
    assert (one.points.unflatten(0, (len(order), -1))[order].flatten(0, 1) - other.points).abs().max() < 1e-5


def test_patches_are_displaced_by_what_they_are_and_the_whole_by_what_is_most_in_any(network, patches):
    given = []
    parts = (network.local_displacement, network.global_displacement)
    hooks = [part.register_forward_pre_hook(lambda _, arguments: given.append(arguments)) for part in parts]
    result = completed(network, patches)
    for hook in hooks:
        hook.remove()
    (planes, own), (merged, whole) = given
    assert torch.equal(planes, result.planes) and own.std(dim=0).max() > 0
    assert torch.equal(whole, own.amax(dim=0).expand_as(own))
    assert torch.allclose(merged, torch.from_numpy(patches.low)[:, None] + float(patches.scale) * result.patches)


@pytest.mark.parametrize("count", [1, 2, 7])
def test_any_number_of_patches(network, patches, count):
    result = completed(network, patches, select=slice(count))
    assert result.patches.shape == (count, 1024, 3) and result.points.shape == (count * 1024, 3)
    assert torch.isfinite(result.points).all()


def test_patches_know_of_each_other(network, patches):
    alone, together = completed(network, patches, select=slice(1)), completed(network, patches)
    assert (alone.patches[0] - together.patches[0]).abs().max() > 1e-4


def test_chosen_plane_points_are_completed_as_among_all(network, patches):
    chosen = torch.stack([torch.randperm(1024)[:300] for _ in patches.points])
    some, every = completed(network, patches, chosen=chosen), completed(network, patches)
    expected = every.patches.gather(1, chosen[..., None].expand(-1, -1, 3))
    assert (some.patches - expected).abs().max() < 1e-5


def test_displacements_begin_at_rest(network, patches):
    result = completed(network, patches)
    assert (result.patches - result.planes).abs().max() < 0.05


def test_displacements_learn_where_in_which_patch_a_point_lies():
    torch.manual_seed(0)
    displacement = Displacement()
    points, feature = torch.rand(2, 64, 3), 2 * torch.rand(2, 768)
    # To the middle in one patch, away from it in the other.
    wanted = 0.3 * torch.tensor([1.0, -1.0])[:, None, None] * (0.5 - points)
    optimizer = torch.optim.AdamW(displacement.parameters(), lr=1e-3)
    for _ in range(60):
        off = (displacement(points, feature) - wanted).square().mean() / wanted.square().mean()
        optimizer.zero_grad()
        off.backward()
        optimizer.step()
    assert off.item() < 0.1  # with torch's first weights it stays at 0.99


def test_standardized_channels_have_no_mean_and_a_spread_of_one_wherever_training_was():
    rng = torch.Generator().manual_seed(0)
    channels = Standardized(3)
    offset, spread = torch.tensor([5.0, -1.0, 0.0]), torch.tensor([0.1, 1.0, 7.0])
    for _ in range(50):
        channels(offset + spread * torch.randn(4, 25, 3, generator=rng))
    channels.eval()
    found = channels(offset + spread * torch.randn(10_000, 3, generator=rng))
    assert found.mean(dim=0).abs().max() < 0.1 and (found.std(dim=0) - 1).abs().max() < 0.1
    before = channels.mean.clone()
    channels(torch.full((1, 3), 100.0))
    assert torch.equal(channels.mean, before)  # completing changes nothing
    assert not list(channels.parameters())


def test_options_of_the_ablations(patches):
    flat = DeepPCDNetwork(generator=False).eval()
    assert parameters(flat) == 7_735_055 - 1_842_185
    result = completed(flat, patches)
    assert result.turns is None and result.patches.shape[1] == 1024
    few = DeepPCDNetwork(plane_points=256).eval()
    assert completed(few, patches).patches.shape[1] == 256


def test_embeddings_have_one_length_and_products_that_depend_on_the_difference_alone():
    cells = torch.cartesian_prod(torch.arange(6), torch.arange(6))
    embedded = position_embedding(cells).double()
    assert torch.allclose(embedded.norm(dim=1), torch.full((36,), 192.0**0.5, dtype=torch.float64), atol=1e-4)
    products = embedded @ embedded.T
    difference = (cells[:, None] - cells).abs()
    for x, y in ((0, 1), (2, 3), (5, 0)):
        same = products[(difference == torch.tensor([x, y])).all(dim=2)]
        assert same.max() - same.min() < 1e-3
    assert (products - products.diag().diag()).max() < 192 - 0.5  # no two positions look alike


def test_moving_by_an_offset_is_one_linear_map_wherever_from():
    cells = torch.cartesian_prod(torch.arange(4), torch.arange(4))
    offset = torch.tensor([2, 1])
    embedded, moved = (position_embedding(c).double().view(-1, 192, 4) for c in (cells, cells + offset))
    for wave in (0, 20, 100):
        # Four basis positions decide the 4 x 4 map of a wavelength; it must hold for all others.
        solved = torch.linalg.lstsq(embedded[:, wave], moved[:, wave])
        assert (embedded[:, wave] @ solved.solution - moved[:, wave]).abs().max() < 1e-5
        rotation = solved.solution if torch.linalg.matrix_rank(embedded[:, wave], rtol=1e-3) == 4 else torch.eye(4)
        assert (rotation @ rotation.T - torch.eye(4)).abs().max() < 1e-2


def test_wavelengths_go_from_two_pi_to_ten_thousand_times_that():
    embedded = position_embedding(torch.tensor([[1, 0], [2, 0]])).view(2, 192, 4)
    angle = torch.atan2(embedded[..., 1], embedded[..., 3])  # sin x cos y over cos x cos y
    assert torch.allclose(angle[:, 0], torch.tensor([1.0, 2.0]), atol=1e-5)
    assert torch.allclose(angle[:, -1], torch.tensor([1e-4, 2e-4]), atol=1e-7)
    ratios = angle[0, 1:] / angle[0, :-1]
    assert torch.allclose(ratios, ratios.mean().expand_as(ratios), rtol=1e-3)


@pytest.mark.parametrize("point", [3, 387])
def test_a_split_layer_is_the_layer_over_the_concatenation(point):
    torch.manual_seed(2)
    layer = SplitLinear(point, 768, 64)
    points, shared = torch.randn(4, 50, point, requires_grad=True), torch.randn(4, 768, requires_grad=True)
    whole = torch.nn.functional.linear(
        torch.cat([points, shared[:, None].expand(-1, 50, -1)], dim=2), layer.weight, layer.bias
    )
    split = layer(points, shared)
    assert torch.allclose(split, whole, atol=1e-5)
    weights = torch.randn_like(whole)
    inputs = (points, shared, layer.weight, layer.bias)
    for one, other in zip(
        torch.autograd.grad((split * weights).sum(), inputs),
        torch.autograd.grad((whole * weights).sum(), inputs),
        strict=True,
    ):
        assert torch.allclose(one, other, atol=1e-3)


def test_the_maximum_over_neighbors_and_its_gradient():
    torch.manual_seed(3)
    features = torch.randn(3, 40, 8, requires_grad=True)
    rows = torch.randint(0, 40, (3, 10, 32))
    expected = torch.stack([patch[near].amax(dim=1) for patch, near in zip(features, rows, strict=True)])
    pooled = neighbor_max(features, rows)
    with torch.no_grad():
        assert torch.equal(neighbor_max(features, rows), expected)
    assert torch.equal(pooled, expected)
    weights = torch.randn_like(pooled)
    # Distinct values: the gradient goes to the one maximum; repeated rows share it in the reference.
    (one,) = torch.autograd.grad((pooled * weights).sum(), features)
    (other,) = torch.autograd.grad((expected * weights).sum(), features)
    assert torch.allclose(one, other, atol=1e-6)


def test_in_bfloat16_the_maximum_over_neighbors_and_its_gradient_are_the_same():
    torch.manual_seed(4)
    features = (torch.randn(3, 40, 8) - 2).bfloat16().requires_grad_()
    rows = torch.randint(0, 40, (3, 10, 32))
    wide = features.detach().float().requires_grad_()
    pooled, expected = neighbor_max(features, rows), neighbor_max(wide, rows)
    assert pooled.dtype == torch.bfloat16
    assert (pooled < 0).any()
    assert torch.equal(pooled.float(), expected)
    # Sums over the points: which of two equal ones wins is free.
    (one,) = torch.autograd.grad(pooled.sum(), features)
    (other,) = torch.autograd.grad(expected.sum(), wide)
    assert torch.allclose(one.float().sum(dim=1), other.sum(dim=1))
    # Each gradient went to a point that has the maximum as its value.
    assert torch.allclose((one.float() * features.float()).sum(dim=1), expected.sum(dim=1), atol=1e-3)


def test_farthest_points_by_brute_force():
    patches = np.random.default_rng(4).random((2, 200, 3)).astype(np.float32)
    for points, chosen in zip(patches, farthest(patches, 30), strict=True):
        assert chosen[0] == np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1))
        for count in range(1, 30):
            apart = np.linalg.norm(points[:, None] - points[chosen[:count]], axis=2).min(axis=1)
            assert apart[chosen[count]] == pytest.approx(apart.max(), abs=1e-6)


def test_neighbors_by_brute_force():
    points = np.random.default_rng(4).random((3, 200, 3)).astype(np.float32)
    sampled = farthest(points, 20)
    found = within(points, sampled, 0.2, NEIGHBORS)
    assert found.shape == (3, 20, NEIGHBORS)
    for patch in range(3):
        distances = np.linalg.norm(points[patch][sampled[patch]][:, None] - points[patch], axis=2)
        for row, near in zip(distances, found[patch], strict=True):
            nearest = np.argsort(row)[:NEIGHBORS]
            assert set(near) == set(nearest[row[nearest] < 0.2])


def test_the_second_level_is_the_points_sampled_first(patches):
    found = Neighborhoods.of(patches.points)
    assert found.sampled_1.shape == (9, 256) and found.sampled_2.tolist() == 9 * [list(range(128))]
    assert found.neighbors_1.max() < 1024 and found.neighbors_2.max() < 256


def test_the_planar_grid_is_turned_and_placed():
    turn = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])  # x to y, y to z
    points = torch.tensor([[[0.5, 0.5, 0.5]]])
    placed = plane_points(points, turn[None, None])[0] - 0.5
    assert placed.shape == (16, 3) and placed[:, 0].abs().max() == 0
    assert placed[:, 1:].min() == pytest.approx(-0.14) and placed[:, 1:].max() == pytest.approx(0.14)
    assert len(torch.unique(placed, dim=0)) == 16
    turn[:, 2] = torch.tensor([0.0, 0.5, 0])
    moved = plane_points(points, turn[None, None])[0] - 0.5 - placed
    assert torch.allclose(moved, torch.tensor([0.0, 0.14, 0]).expand(16, 3), atol=1e-6)


def test_the_generator_begins_with_planes_as_far_from_floors_as_from_walls():
    torch.manual_seed(0)
    turns = PlanePointGenerator()(torch.rand(2, 5, 3), torch.rand(2, 5, 384), torch.rand(2, 768))
    assert (turns.transpose(2, 3) @ turns - torch.diag(torch.tensor([1.0, 1, 0]))).abs().max() < 0.2
    normals = torch.linalg.cross(turns[..., 0], turns[..., 1])
    assert (normals - 3**-0.5).abs().max() < 0.1
    assert torch.linalg.norm(turns[..., 2], dim=2).max() < 0.1


def test_the_size_of_patch_features_does_not_matter(patches):
    """Otherwise training makes them grow without end, until float16 does not hold them."""
    torch.manual_seed(0)
    network = DeepPCDNetwork().eval()
    network.encoder.mlp_3[-1].bias.data.normal_()
    before = completed(network, patches).planes
    network.encoder.mlp_3[-1].bias.data.mul_(1000)
    network.encoder.mlp_3[-1].weight.data.mul_(1000)
    assert torch.allclose(completed(network, patches).planes, before, atol=1e-4)


def test_planes_learn_to_lie_along_floors_and_walls():
    torch.manual_seed(0)
    points, normals = corners(np.random.default_rng(0), patches=8, points=86)
    near = around(points)
    normals = normals.gather(1, near[0][:, :32, None].long().expand(-1, -1, 3))
    network = DeepPCDNetwork(plane_points=512)
    optimizer = torch.optim.AdamW([*network.encoder.parameters(), *network.generator.parameters()], lr=1e-3)
    for _ in range(25):
        seeds, features, patch = network.encoder(torch.from_numpy(points), None, near)
        turns = network.generator(seeds[:, :32], features[:, :32], network.of_patches(patch))
        across = torch.nn.functional.normalize(torch.linalg.cross(turns[..., 0], turns[..., 1]), dim=2)
        leaning = 1 - (across * normals).sum(dim=2).square().mean()
        along = turns[..., :2]
        stretched = (along.transpose(2, 3) @ along - torch.eye(2)).square().sum(dim=(2, 3)).mean()
        optimizer.zero_grad()
        (leaning + 0.05 * stretched).backward()
        optimizer.step()
    assert leaning.item() < 0.03  # without what PConv tells of neighbours it is at 0.06


def corners(rng, patches, points):
    """(P, 3 * points, 3) of a floor and two walls at any heading, as patches are scaled, and the normals there."""
    heading, none = rng.uniform(0, np.pi, (patches, 1)), np.zeros((patches, 1))
    along = np.hstack([np.cos(heading), np.sin(heading), none])
    beside = np.hstack([-np.sin(heading), np.cos(heading), none])
    up = np.broadcast_to([0.0, 0.0, 1.0], along.shape)
    sides = [(along, beside, up), (along, up, beside), (beside, up, along)]
    shape = (patches, points, 1)
    found = np.concatenate([rng.random(shape) * a[:, None] + rng.random(shape) * b[:, None] for a, b, _ in sides], 1)
    found -= found.min(axis=1, keepdims=True)
    normals = np.concatenate([np.repeat(normal[:, None], points, axis=1) for _, _, normal in sides], axis=1)
    return (found / found.max(axis=(1, 2), keepdims=True)).astype(np.float32), torch.from_numpy(normals).float()


def test_relations_are_equivariant_and_see_positions():
    torch.manual_seed(0)
    relations, features = Relations().eval(), torch.randn(4, 768)
    cells = torch.tensor([[0, 0], [0, 1], [3, 2], [4, 4]])
    with torch.no_grad():
        one = relations(features, cells)
        assert torch.allclose(relations(features.flip(0), cells.flip(0)).flip(0), one, atol=1e-5)
        assert (relations(features, cells + torch.tensor([3, 0])) - one).abs().max() > 1e-3


def test_in_the_color_network_each_side_learns_from_its_own_loss():
    torch.manual_seed(0)
    network = ColorNetwork()
    observed = np.random.default_rng(2).random((2, 256, 3)).astype(np.float32)
    colors, points, truth = torch.rand(2, 256, 3), torch.rand(2, 100, 3), torch.rand(2, 100, 3)
    out = network(torch.from_numpy(observed), colors, around(observed), points, truth)
    assert out.colors.shape == (2, 100, 3) and out.colors.min() >= 0 and out.colors.max() <= 1
    sides = {
        "generator": [*network.condition.parameters(), *network.generator.parameters()],
        "discriminator": list(network.discriminator.parameters()),
    }
    for value, learns in (
        (out.colors, "generator"),
        (out.fooled, "generator"),
        (out.real, "discriminator"),
        (out.fake, "discriminator"),
    ):
        for side, weights in sides.items():
            grads = torch.autograd.grad(value.sum(), weights, retain_graph=True, allow_unused=True)
            reached = [grad is not None and bool(grad.abs().max() > 0) for grad in grads]
            assert sum(reached) > len(reached) / 2 if side == learns else not any(reached)
    assert torch.equal(out.fake, out.fooled)


def test_some_of_a_patchs_points_are_painted_as_among_all():
    torch.manual_seed(0)
    generator = ColorNetwork().generator
    points, condition = torch.rand(2, 60, 3), torch.rand(2, 512)
    with torch.no_grad():
        features, shared = generator.features(points, condition)
        some = generator.colors(features[:1, 10:30], shared[:1])
        assert torch.allclose(some, generator(points, condition)[:1, 10:30], atol=1e-6)


def test_painting_a_cloud_is_what_the_network_learned(patches):
    """Of some of the completed points, in the unit of the grid: the generator's colours as in training."""
    torch.manual_seed(0)
    network, generator = ColorNetwork(), np.random.default_rng(0)
    colors = generator.random((12_000, 3)).astype(np.float32)
    points = generator.random((len(patches.points), 40, 3)).astype(np.float32)
    wanted = generator.random(points.shape[0] * 40) < 0.3
    scaled = (patches.low[:, None] + patches.scale * points).reshape(-1, 3)
    found = painted(network, patches, Neighborhoods.of(patches.points), colors, scaled, wanted)
    with torch.no_grad():
        observed, seen, new = map(torch.from_numpy, (patches.points, colors[patches.rows], points))
        trained = network(observed, seen, around(patches.points), new, torch.zeros_like(new)).colors
    np.testing.assert_allclose(found, trained.flatten(0, 1).numpy()[wanted], atol=0.02 if bfloat16_pays() else 1e-4)
    assert np.ptp(found, axis=0).max() > 0.02
