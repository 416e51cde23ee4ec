"""What a piece of furniture is, and the small choices that all of them make."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.primitives import frustum

Rng = np.random.Generator
Place = Literal["floor", "wall", "ceiling", "surface"]
Choice = TypeVar("Choice")


@dataclass(frozen=True)
class Top:
    """A level rectangle that things can be put on, in the frame of its piece.

    Attributes:
        center: (x, y) metres.
        size: (x, y) metres.
        z: height in metres.
    """

    center: tuple[float, float]
    size: tuple[float, float]
    z: float


@dataclass(frozen=True, eq=False)
class Built:
    """A piece as it came out: its mesh, and the tops that things can be put on."""

    mesh: Mesh
    tops: tuple[Top, ...] = ()

    @cached_property
    def corners(self) -> tuple[list[float], list[float]]:
        """The lowest and the highest corner of the mesh, x, y, z each, metres."""
        low, high = self.mesh.bounds()
        return low.tolist(), high.tolist()


@dataclass(frozen=True)
class Piece:
    """A kind of object.

    Attributes:
        label: what it is, in the words of scene understanding (table, chair, bookcase, clutter, ...).
        build: makes one of random size, style and color, decided by the generator alone, front towards +y.
        place: `floor`: origin at the centre of what stands on the floor; `surface`: the same, on a `Top`; `wall`:
            origin on the floor at the foot of the wall, the wall at y = 0, the piece at its height in y >= 0;
            `ceiling`: origin on the ceiling, the piece below.
        tagged: whether it is large enough (about 0.4 m) to be a tagged object of a scene.
    """

    label: str
    build: Callable[[Rng], Built]
    place: Place
    tagged: bool


def built(parts: Iterable[Mesh], *tops: Top) -> Built:
    """The parts as one piece."""
    return Built(Mesh.merge(parts), tops)


def tint(rng: Rng) -> int:
    """A random tint."""
    return int(rng.integers(1 << 31))


def tints(rng: Rng, count: int) -> NDArray[np.int64]:
    """(count,) random tints."""
    return rng.integers(1 << 31, size=count, dtype=np.int64)


def pick(rng: Rng, options: Sequence[Choice]) -> Choice:
    """One of the options, all equally likely."""
    return options[int(rng.integers(len(options)))]


def chance(rng: Rng, probability: float) -> bool:
    """True with the probability given."""
    return bool(rng.random() < probability)


def arc(
    radius: float, start_rad: float, end_rad: float, count: int, center: tuple[float, float] = (0.0, 0.0)
) -> NDArray[np.float64]:
    """(count, 2) points on a circle from one angle to another."""
    angle = np.linspace(start_rad, end_rad, count)
    return np.column_stack([center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)])


def arc_band(radius: float, thickness: float, start_rad: float, end_rad: float, count: int = 10) -> NDArray[np.float64]:
    """(2 count, 2) the outline of a bent board of inner `radius` around the origin."""
    inner = arc(radius, start_rad, end_rad, count)
    return np.concatenate([inner, arc(radius + thickness, end_rad, start_rad, count)])


def round_rectangle(width: float, depth: float, radius: float, steps: int = 4) -> NDArray[np.float64]:
    """(4 steps, 2) a rectangle around the origin with round corners."""
    x, y = width / 2 - radius, depth / 2 - radius
    corners = [(x, y), (-x, y), (-x, -y), (x, -y)]
    return np.concatenate(
        [arc(radius, k * np.pi / 2, (k + 1) * np.pi / 2, steps, corner) for k, corner in enumerate(corners)]
    )


def leaning_leg(
    foot: tuple[float, float],
    top: tuple[float, float],
    height: float,
    radii: tuple[float, float],
    material: str,
    color: int = 0,
) -> Mesh:
    """A round leg from `foot` on the floor to `top` under a seat or board, level at both ends."""
    upright = frustum(radii[0], radii[1], height, (*foot, 0.0), material, color, segments=8)
    drift = np.array([top[0] - foot[0], top[1] - foot[1], 0.0])
    return upright.deformed(lambda vertices: vertices + vertices[:, 2:] / height * drift)
