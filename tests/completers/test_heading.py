"""The heading of a room's walls."""

import numpy as np
import pytest
from numpy.typing import NDArray
from pcdbench_completers.heading import wall_heading

from pcdbench.geometry.poses import rotation_about


def walls(rng: np.random.Generator, missing: float = 0.0) -> NDArray[np.float64]:
    """A box of 5 x 3 x 2.5 m with 5 mm noise, of one long wall only a part, and a round column in it."""
    u, v = rng.random((2, 6, 1500))
    length, width, height = 5 * u, 3 * v, 2.5 * v
    faces = [
        (length[0], 3 * v[0], 0 * u[0]),
        (length[1], 3 * v[1], 0 * u[1] + 2.5),
        (length[2], 0 * u[2], height[2]),
        (length[3][u[3] > missing], 0 * u[3][u[3] > missing] + 3, height[3][u[3] > missing]),
        (0 * u[4], width[4], 2.5 * u[4]),
        (0 * u[5] + 5, width[5], 2.5 * u[5]),
    ]
    around = 2 * np.pi * rng.random(1500)
    column = (2 + 0.3 * np.cos(around), 1.5 + 0.3 * np.sin(around), 2.5 * rng.random(1500))
    points = np.concatenate([np.stack(face, axis=1) for face in [*faces, column]])
    return points - points.mean(axis=0) + rng.normal(scale=0.005, size=points.shape)


@pytest.mark.parametrize("degrees", [0.0, 3.0, 20.0, 44.0, -44.0, -20.0])
@pytest.mark.parametrize("missing", [0.0, 0.7])
def test_walls_say_how_a_room_is_turned(degrees: float, missing: float) -> None:
    points = walls(np.random.default_rng(0), missing) @ rotation_about("z", np.radians(degrees)).T
    assert np.degrees(wall_heading(points)) == pytest.approx(degrees, abs=0.5)


def test_a_turn_by_a_right_angle_is_none() -> None:
    points = walls(np.random.default_rng(1))
    by_20 = wall_heading(points @ rotation_about("z", np.radians(20)).T)
    by_110 = wall_heading(points @ rotation_about("z", np.radians(110)).T)
    assert by_110 == pytest.approx(by_20, abs=1e-9)


def test_at_half_a_right_angle_either_turn_lays_walls_along_the_axes() -> None:
    points = walls(np.random.default_rng(2)) @ rotation_about("z", np.pi / 4).T
    assert abs(np.degrees(wall_heading(points))) == pytest.approx(45, abs=0.5)


def test_without_anything_upright_there_is_no_heading() -> None:
    flat = np.random.default_rng(3).random((500, 3)) * (4.0, 4.0, 0.0)
    assert wall_heading(flat) == 0.0
