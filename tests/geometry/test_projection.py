"""The six faces against cubes whose sides are known and rays walked one by one; SSIM against its formula."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pcdbench.geometry.projection import (
    BACKGROUND,
    FACES,
    WINDOW,
    six_face_similarity,
    six_faces,
    structural_similarity,
)
from pcdbench.geometry.voxels import VoxelGrid, Voxels, voxelize

SIDE_COLORS = {
    "-x": (1.0, 0.0, 0.0),
    "+x": (0.0, 1.0, 0.0),
    "-y": (0.0, 0.0, 1.0),
    "+y": (1.0, 1.0, 0.0),
    "-z": (1.0, 0.0, 1.0),
    "+z": (0.0, 1.0, 1.0),
}


def cube(missing: str = "") -> tuple[np.ndarray, np.ndarray]:
    """The centres of 8 x 8 squares on each side of a 1 m cube, coloured by side, away from the edges."""
    along = (np.arange(8) + 1.5) / 10
    points, colors = [], []
    for axis, letter in enumerate("xyz"):
        for sign, level in (("-", 0.01), ("+", 0.99)):
            if sign + letter == missing:
                continue
            u, v = np.meshgrid(along, along, indexing="ij")
            points.append(np.insert(np.stack([u.ravel(), v.ravel()], axis=1), axis, level, axis=1))
            colors.append(np.tile(SIDE_COLORS[sign + letter], (64, 1)))
    return np.concatenate(points), np.concatenate(colors)


def voxels_of(points: np.ndarray, colors: np.ndarray) -> Voxels:
    return voxelize(points, colors, VoxelGrid(np.zeros(3), 0.1, (10, 10, 10)))


@pytest.mark.parametrize("face", range(6))
def test_each_face_shows_the_side_it_is_named_after(face):
    image = six_faces(voxels_of(*cube()))[face]
    assert image.shape == (10, 10, 3)
    np.testing.assert_allclose(image[1:-1, 1:-1], np.broadcast_to(SIDE_COLORS[FACES[face]], (8, 8, 3)))


@pytest.mark.parametrize("face", range(6))
def test_through_a_missing_side_the_opposite_one_shows(face):
    opposite = FACES[face ^ 1]
    image = six_faces(voxels_of(*cube(missing=FACES[face])))[face]
    np.testing.assert_allclose(image[1:-1, 1:-1], np.broadcast_to(SIDE_COLORS[opposite], (8, 8, 3)))


def test_faces_keep_the_order_of_their_axes():
    image_sizes = [image.shape for image in six_faces(Voxels(np.array([[1, 2, 3]]), np.ones((1, 3)), (2, 3, 5)))]
    assert image_sizes == [(3, 5, 3)] * 2 + [(2, 5, 3)] * 2 + [(2, 3, 3)] * 2
    images = six_faces(Voxels(np.array([[1, 2, 3]]), np.ones((1, 3)), (2, 3, 5)))
    assert [tuple(np.argwhere(image[..., 0])[0]) for image in images] == [
        (2, 3),
        (2, 3),
        (1, 3),
        (1, 3),
        (1, 2),
        (1, 2),
    ]


@given(st.integers(0, 2**32), st.integers(0, 60))
def test_faces_agree_with_rays_walked_one_by_one(seed, count):
    rng = np.random.default_rng(seed)
    shape = (4, 5, 3)
    index = np.unique(rng.integers(0, shape, (count, 3)), axis=0)
    index = rng.permutation(index)
    colors = rng.random((len(index), 3))
    volume = {tuple(voxel): color for voxel, color in zip(index.tolist(), colors, strict=True)}
    images = six_faces(Voxels(index.reshape(-1, 3), colors, shape))
    for face, image in enumerate(images):
        axis, from_high = face // 2, face % 2
        rest = [i for i in range(3) if i != axis]
        steps = range(shape[axis])[::-1] if from_high else range(shape[axis])
        for row in range(shape[rest[0]]):
            for column in range(shape[rest[1]]):
                seen = np.full(3, BACKGROUND)
                for step in steps:
                    voxel = [0, 0, 0]
                    voxel[axis], voxel[rest[0]], voxel[rest[1]] = step, row, column
                    if tuple(voxel) in volume:
                        seen = volume[tuple(voxel)]
                        break
                np.testing.assert_array_equal(image[row, column], seen)


def ssim_by_definition(first: np.ndarray, second: np.ndarray) -> float:
    """Wang et al. (2004), equation 13, one window at a time, with sample (co)variances."""
    half, c1, c2 = WINDOW // 2, 0.01**2, 0.03**2
    framed = [
        np.pad(image, ((half, half), (half, half), (0, 0)), constant_values=BACKGROUND) for image in (first, second)
    ]
    values = []
    for row in range(first.shape[0]):
        for column in range(first.shape[1]):
            for channel in range(3):
                x, y = (image[row : row + WINDOW, column : column + WINDOW, channel].ravel() for image in framed)
                covariance = np.cov(x, y)
                values.append(
                    (2 * x.mean() * y.mean() + c1)
                    * (2 * covariance[0, 1] + c2)
                    / ((x.mean() ** 2 + y.mean() ** 2 + c1) * (covariance[0, 0] + covariance[1, 1] + c2))
                )
    return float(np.mean(values))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 12), st.integers(1, 12))
def test_similarity_agrees_with_its_definition_for_images_of_any_size(seed, rows, columns):
    rng = np.random.default_rng(seed)
    first = rng.random((rows, columns, 3))
    second = np.clip(first + rng.normal(0, 0.2, first.shape), 0, 1)
    assert structural_similarity(first, second) == pytest.approx(ssim_by_definition(first, second), abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(
    hnp.arrays(np.float64, (5, 9, 3), elements=st.floats(0, 1)),
    hnp.arrays(np.float64, (5, 9, 3), elements=st.floats(0, 1)),
)
def test_similarity_is_symmetric_and_one_for_equal_images(first, second):
    assert structural_similarity(first, first) == pytest.approx(1.0)
    value = structural_similarity(first, second)
    assert value == pytest.approx(structural_similarity(second, first))
    assert -1.0 <= value <= 1.0 + 1e-12


def test_a_side_left_out_costs_similarity():
    whole = voxels_of(*cube())
    assert six_face_similarity(whole, whole) == pytest.approx(1.0)
    assert six_face_similarity(voxels_of(*cube(missing="+z")), whole) < 0.95


def test_points_outside_the_grid_show_on_its_border():
    points, colors = cube()
    white = np.ones((64, 3))
    stray = points[-64:] + np.array([0.0, 0.0, 3.0])
    image = six_faces(voxels_of(np.concatenate([points[:-64], stray]), np.concatenate([colors[:-64], white])))[5]
    np.testing.assert_allclose(image[1:-1, 1:-1], 1.0)
