"""inpainted_colors: colours continue smoothly across a hole and never cross from surface to surface."""

import numpy as np
from pcdbench_completers.inpainting import inpainted_colors


def square_with_hole(seed=0, count=4000):
    points = np.column_stack([np.random.default_rng(seed).random((count, 2)), np.zeros(count)])
    hole = np.linalg.norm(points[:, :2] - 0.5, axis=1) < 0.2
    return points[~hole], points[hole]


def test_a_gradient_is_continued_across_the_hole():
    observed, new = square_with_hole()
    shade = lambda points: np.repeat(points[:, :1], 3, axis=1).astype(np.float32)  # noqa: E731
    assert np.abs(inpainted_colors(new, observed, shade(observed)) - shade(new)).max() < 0.06


def test_one_color_stays_that_color():
    observed, new = square_with_hole()
    color = np.array([0.2, 0.4, 0.9], np.float32)
    assert np.abs(inpainted_colors(new, observed, np.tile(color, (len(observed), 1))) - color).max() < 1e-3


def test_surfaces_do_not_share_colors():
    observed, new = square_with_hole()
    points = np.concatenate([observed, observed + np.array([0, 0, 1e-3])])
    surface = np.repeat([0, 1], len(observed))
    colors = np.repeat(surface[:, None], 3, axis=1).astype(np.float32)
    assert inpainted_colors(new, points, colors, np.zeros(len(new)), surface).max() < 1e-3
    assert inpainted_colors(new, points, colors, np.ones(len(new)), surface).min() > 1 - 1e-3


def test_a_color_half_as_far_off_counts_four_times():
    observed, new = np.array([[-1.0, 0, 0], [2.0, 0, 0]]), np.zeros((1, 3))
    mixed = inpainted_colors(new, observed, np.array([[0, 1, 0.5], [1, 0, 0.5]], np.float32))
    np.testing.assert_allclose(mixed, [[0.2, 0.8, 0.5]], atol=1e-3)


def test_no_new_points_need_no_colors():
    observed, _ = square_with_hole()
    assert inpainted_colors(np.empty((0, 3)), observed, np.zeros(observed.shape, np.float32)).shape == (0, 3)
