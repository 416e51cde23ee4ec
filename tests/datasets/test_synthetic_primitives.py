"""Solids are closed, face outwards and have the volume that geometry says; polygons are cut into all of themselves."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pcdbench.datasets.synthetic import primitives
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.datasets.synthetic.polygons import bridged, signed_area, triangulated

SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
L_SHAPE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)]


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def open_edges(mesh: Mesh) -> int:
    """Directed edges without their opposite, after joining equal vertices: 0 for a closed surface."""
    _, joined = np.unique(np.round(mesh.vertices, 9) + 0.0, axis=0, return_inverse=True)
    corners = joined.reshape(-1)[mesh.triangles]
    edges = Counter((int(t[k]), int(t[(k + 1) % 3])) for t in corners for k in range(3) if t[k] != t[(k + 1) % 3])
    return sum(abs(count - edges[(b, a)]) for (a, b), count in edges.items())


def ring_volume(corners: int, radius: float) -> float:
    """The area of a regular polygon inside a circle."""
    return corners / 2 * radius**2 * np.sin(2 * np.pi / corners)


HEXAGON = ring_volume(6, 0.05)
SOLIDS = {
    "box": (primitives.box((1, 2, 3), (4, 5, 6), "wood"), 6.0),
    "boxes": (primitives.boxes([[1, 1, 1], [2, 1, 1]], [[0, 0, 0], [5, 0, 0]], "wood", [1, 2]), 3.0),
    "prism": (primitives.prism(L_SHAPE, 1.0, 1.5, "wood"), 2.0),
    "profile_prism": (primitives.profile_prism(L_SHAPE, -1.0, 1.0, "wood"), 8.0),
    "cylinder": (primitives.cylinder(0.5, 2.0, (1, 2, 3), "wood", segments=40), 2 * ring_volume(40, 0.5)),
    "cone": (primitives.frustum(0.5, 0.0, 3.0, (0, 0, 0), "wood", segments=40), ring_volume(40, 0.5)),
    "tube": (primitives.tube([[0, 0, 0], [2, 0, 0]], 0.05, "wood", segments=6), 2 * HEXAGON),
    "lathe": (primitives.lathe([(0, 0), (1, 0), (1, 1), (0.5, 1), (0.5, 0.5), (0, 0.5)], "wood"), None),
    "torus": (primitives.torus(0.5, 0.05, (1, 2, 3), "wood"), None),
    "sphere": (primitives.sphere(1.0, (1, 1, 1), "wood", segments=80), 4 / 3 * np.pi),
    "rounded_box": (primitives.rounded_box((1, 2, 3), (0, 0, 0), 0.01, "wood"), 6.0),
    "sheet": (primitives.sheet(np.zeros((4, 6)), (2.0, 1.0), 0.1, "wood"), 0.2),
    "panel": (primitives.panel_with_openings(4, 3, 0.2, [(1, 2, 0, 2), (2.5, 3.5, 1, 2)], "wood"), 0.2 * (12 - 2 - 1)),
    "cut prism": (primitives.prism(SQUARE * 4, 0, 1, "wood", holes=[SQUARE + 1, SQUARE * 0.5 - 1]), 16 - 1 - 0.25),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_have_their_volume(name: str) -> None:
    mesh, expected = SOLIDS[name]
    if name != "panel":  # its faces meet its reveals along divided edges
        assert open_edges(mesh) == 0
    assert volume(mesh) > 0
    if expected is not None:
        assert volume(mesh) == pytest.approx(expected, rel=5e-3)


def test_a_bent_tube_keeps_its_radius_around_its_path() -> None:
    angle = np.linspace(0, np.pi, 20)
    path = np.column_stack([np.cos(angle), np.sin(angle), 0.2 * angle])
    mesh = primitives.tube(path, 0.1, "wood", segments=12)
    rings = mesh.vertices.reshape(22, 12, 3)[1:-1]
    assert np.linalg.norm(rings - path[:, None], axis=2) == pytest.approx(0.1)
    assert rings.mean(axis=1) == pytest.approx(path)


def test_an_opening_lets_rays_through_and_its_reveal_has_its_own_material() -> None:
    panel = primitives.panel_with_openings(4, 3, 0.2, [(1, 2, 0, 2)], "wall_paint", 3, "door_wood", 4)
    assert not np.any(
        np.all((panel.vertices[:, [0, 2]] > [1.01, -1]) & (panel.vertices[:, [0, 2]] < [1.99, 1.99]), axis=1)
    )
    a, b, c = (panel.vertices[panel.triangles[:, corner]] for corner in range(3))
    products = np.abs(np.cross(b - a, c - a))
    faces = products[:, 1] > 0.5 * np.linalg.norm(products, axis=1)
    assert set(panel.tints[faces]) == {3}
    assert set(panel.tints[~faces]) == {4}


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0.3, 1.0), min_size=3, max_size=24))
def test_star_shaped_polygons_are_triangulated_without_gap_or_overlap(radii: list[float]) -> None:
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii)
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) * np.array(radii)[:, None]
    areas = [signed_area(ring[triangle]) for triangle in triangulated(ring)]
    assert len(areas) == len(ring) - 2
    assert min(areas) >= -1e-12
    assert sum(areas) == pytest.approx(signed_area(ring))


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 3), st.floats(0.05, 0.4), st.integers(3, 12))
def test_holes_are_left_out(count: int, radius: float, corners: int) -> None:
    angle = 2 * np.pi * np.arange(corners) / corners
    circle = radius * np.column_stack([np.cos(angle), -np.sin(angle)])
    holes = [np.add(circle, (1.0 * k + 0.5, 0.5 + 0.1 * k)) for k in range(count)]
    outer = np.array([(0.0, 0.0), (count, 0.0), (count, 1.5), (0.0, 1.5)])
    ring = bridged(outer, holes)
    areas = [signed_area(ring[triangle]) for triangle in triangulated(ring)]
    assert min(areas) >= -1e-12
    assert sum(areas) == pytest.approx(count * 1.5 + sum(signed_area(hole) for hole in holes))


def test_meshes_move_turn_scale_and_merge() -> None:
    first, second = (primitives.box((2, 1, 1), (1, 0, 0), "wood", tint) for tint in (1, 9))
    turned = first.moved((10, 0, 5), np.pi / 2)
    assert np.round(turned.bounds(), 9) == pytest.approx(np.array([[9.5, 0, 4.5], [10.5, 2, 5.5]]))
    both = Mesh.merge([first, second.moved((10, 0, 5), np.pi / 2)])
    assert volume(both) == pytest.approx(4.0)
    assert sorted(set(both.tints)) == [1, 9]
    assert volume(both.scaled((1, 2, 3))) == pytest.approx(24.0)
    assert len(Mesh.merge([]).triangles) == 0
    assert first.rotated("x", np.pi / 2).vertices == pytest.approx(first.vertices[:, [0, 2, 1]] * [1, -1, 1])
