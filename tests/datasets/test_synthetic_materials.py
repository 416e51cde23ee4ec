"""Colors are decided by place and tint alone, the same on every machine, and show something at every distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pcdbench.datasets.synthetic.materials import MATERIALS, colors, material_id
from pcdbench.datasets.synthetic.noise import fractal_noise, hashed, uniform, value_noise

NAMES = [material.name for material in MATERIALS]
UNIFORM_BY_NATURE = {
    "glass",
    "mirror",
    "lamp",
    "ceiling_paint",
    "black_gloss",
    "black_metal",
    "black_plastic",
    "rubber",
}
PATTERNED_AT_5_CM = [
    "wallpaper", "brick", "floor_tiles", "wall_tiles", "parquet", "planks", "carpet", "rug", "terrazzo", "marble",
    "artwork", "photograph", "whiteboard", "notices", "book_spines", "goods", "cardboard", "wood", "curtain",
    "concrete",
]  # fmt: skip

PINNED_HASHES = [11847483327594566635, 3386281177624648703, 7826330307654747040, 975205666591264362]
PINNED_UNIFORM = [0.6885003439937464, 0.7675231638457025, 0.581997124339304]
PINNED_VALUE_NOISE = [0.468808918833727, 0.33092625021867744]
PINNED_COLORS = {
    "wall_paint": [[0.882634, 0.842514, 0.742215], [0.884085, 0.843899, 0.743435]],
    "carpet": [[0.608174, 0.524288, 0.419431], [0.276316, 0.335527, 0.414475]],
    "brick": [[0.450847, 0.252474, 0.216407], [0.513211, 0.287398, 0.246341]],
    "wood": [[0.568581, 0.398006, 0.246385], [0.830831, 0.688982, 0.48634]],
    "fabric": [[0.519673, 0.187082, 0.187082], [0.523806, 0.18857, 0.18857]],
    "artwork": [[0.158762, 0.338691, 0.687967], [0.845528, 0.432372, 0.144124]],
    "ceiling_panels": [[0.873323, 0.873323, 0.853014], [0.837548, 0.837548, 0.81807]],
}


def wall(count: int, spacing: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Points on an upright wall facing y, in a grid of `count` by `count` around 1.5 m high, and their normals."""
    step = (np.arange(count) + 0.5) * spacing
    u, v = np.meshgrid(step - step.mean(), step - step.mean() + 1.5)
    points = np.column_stack([u.ravel(), np.full(u.size, 0.3), v.ravel()])
    return points, np.tile([0.0, 1.0, 0.0], (len(points), 1))


def painted(name: str, points: np.ndarray, normals: np.ndarray, tint: int) -> np.ndarray:
    return colors(points, normals, np.full(len(points), material_id(name)), np.full(len(points), tint))


@pytest.mark.parametrize("name", NAMES)
def test_colors_are_in_range_and_vary_with_place_and_tint(name: str) -> None:
    rng = np.random.default_rng(5)
    points, normals = rng.uniform(-4, 4, (3000, 3)), rng.normal(size=(3000, 3))
    ids, tints = np.full(3000, material_id(name)), rng.integers(0, 30, 3000)
    albedo = colors(points, normals, ids, tints)
    assert albedo.shape == (3000, 3)
    assert albedo.dtype == np.float32
    assert np.all((albedo >= 0) & (albedo <= 1))
    assert np.array_equal(albedo, colors(points, normals, ids, tints))
    at_wall, facing = wall(40, 0.0437)
    means = [painted(name, at_wall, facing, tint).mean(axis=0) for tint in range(12)]
    assert np.ptp(means, axis=0).max() > 0.002
    if name not in UNIFORM_BY_NATURE:
        assert max(painted(name, at_wall, facing, tint).std(axis=0).max() for tint in range(12)) > 0.008


@pytest.mark.parametrize("name", PATTERNED_AT_5_CM)
def test_patterns_are_seen_at_a_scan_s_spacing(name: str) -> None:
    points, normals = wall(24, 0.05)
    contrast = [painted(name, points, normals, tint).std(axis=0).max() for tint in range(8)]
    assert max(contrast) > 0.04


def test_a_point_s_color_does_not_depend_on_the_others() -> None:
    rng = np.random.default_rng(0)
    count = 20_000  # more than are colored at a time
    points, normals = rng.uniform(-3, 3, (count, 3)), rng.normal(size=(count, 3))
    ids, tints = rng.integers(0, len(MATERIALS), count), rng.integers(0, 2**31, count)
    everything = colors(points, normals, ids, tints)
    chosen = rng.permutation(count)[:500]
    assert np.array_equal(colors(points[chosen], normals[chosen], ids[chosen], tints[chosen]), everything[chosen])


def test_one_color_runs_around_corners_of_a_solid_material() -> None:
    point = np.array([[1.0, 2.0, 0.5]] * 3)
    sides = colors(point, np.eye(3), np.full(3, material_id("board")), np.full(3, 7))
    assert np.ptp(sides, axis=0).max() == 0


def test_names_are_unique_and_scan_returns_are_declared() -> None:
    assert len(set(NAMES)) == len(NAMES) >= 30
    assert [m.name for m in MATERIALS if m.transparent] == ["glass"]
    assert [m.name for m in MATERIALS if m.mirror] == ["mirror"]
    assert all(0 <= m.dropout < 1 and 0 <= m.glow <= 1 for m in MATERIALS)
    assert MATERIALS[material_id("black_gloss")].dropout >= 0.4
    with pytest.raises(KeyError):
        material_id("unobtainium")


def test_brick_has_mortar_at_its_joints_and_every_brick_its_own_tone() -> None:
    row = 20  # an even row: its bricks begin at multiples of 24 cm
    middle = np.array([[0.24 * k + 0.12, 0.0, (row + 0.5) * 0.075] for k in range(30)])
    joint = np.array([[0.24 * k + 0.004, 0.0, (row + 0.5) * 0.075] for k in range(30)])
    normals = np.tile([0.0, -1.0, 0.0], (30, 1))
    assert painted("brick", joint, normals, 1) == pytest.approx(np.tile([0.72, 0.7, 0.66], (30, 1)), abs=1e-6)
    assert painted("brick", middle, normals, 1).std(axis=0).max() > 0.03


def test_tile_grout_lies_at_multiples_of_the_tile() -> None:
    u = np.arange(0.0, 2.0, 0.002) + 0.001
    points = np.column_stack([u, np.full(len(u), 0.2), np.zeros(len(u))])
    albedo = painted("floor_tiles", points, np.tile([0.0, 0.0, 1.0], (len(u), 1)), 3)
    grout = np.all(np.abs(albedo - np.float32([0.45, 0.44, 0.42])) < 1e-6, axis=1)
    assert np.array_equal(grout, (u % 0.4) < 0.008)


def test_noise_is_pinned_across_machines() -> None:
    assert [int(word) for word in hashed(np.array([0, 1, -1, 2**40]), 7)] == PINNED_HASHES
    assert uniform(np.arange(3), 5) == pytest.approx(PINNED_UNIFORM, abs=1e-15)
    at = np.array([[0.25, -1.5, 2.75], [10.1, 20.2, -30.3]])
    assert value_noise(at, 3) == pytest.approx(PINNED_VALUE_NOISE, abs=1e-12)


@pytest.mark.parametrize("name", PINNED_COLORS)
def test_colors_are_pinned_across_machines(name: str) -> None:
    points = np.array([[0.213, 1.377, 0.842], [-2.131, 0.518, 1.905]])
    albedo = colors(points, [[0, 1, 0], [0.1, 0.2, -3]], np.full(2, material_id(name)), [11, 12])
    assert albedo == pytest.approx(np.array(PINNED_COLORS[name]), abs=1e-5)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=4))
def test_hashing_is_what_whole_numbers_give(cells: list[int]) -> None:
    mask, step = 2**64 - 1, 0x9E3779B97F4A7C15
    first, second = 0xBF58476D1CE4E5B9, 0x94D049BB133111EB
    state = step
    for cell in cells:
        state = ((state ^ (cell * step & mask)) * first) & mask
        state ^= state >> 29
    state = ((state ^ (state >> 30)) * first) & mask
    state = ((state ^ (state >> 27)) * second) & mask
    assert int(hashed(*(np.array([cell]) for cell in cells))[0]) == state ^ (state >> 31)


@settings(max_examples=50, deadline=None)
@given(st.integers(-50, 50), st.integers(-50, 50), st.floats(-1e-6, 1e-6))
def test_value_noise_is_continuous_and_takes_its_corner_s_value_there(x: int, y: int, off: float) -> None:
    at = np.array([[x, y], [x + off, y + off]], np.float64)
    corner, beside = value_noise(at, 9)
    assert 0 <= corner < 1
    assert beside == pytest.approx(corner, abs=1e-4)


def test_noise_is_even_and_independent_of_its_seed() -> None:
    cells = np.arange(40_000)
    first, second = uniform(cells, 1), uniform(cells, 2)
    assert np.histogram(first, bins=20, range=(0, 1))[0] == pytest.approx(2000, abs=220)
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.02
    assert abs(np.corrcoef(first[1:], first[:-1])[0, 1]) < 0.02
    cloud = fractal_noise(np.random.default_rng(1).uniform(-99, 99, (20_000, 3)), 4)
    assert 0 <= cloud.min() < cloud.max() < 1
    assert cloud.mean() == pytest.approx(0.5, abs=0.01)
