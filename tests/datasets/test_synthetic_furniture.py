"""Every piece of furniture stands where it should, at a size that exists, the same for the same seed."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pcdbench.datasets.synthetic.furniture import FURNITURE, Built
from pcdbench.datasets.synthetic.materials import MATERIALS
from pcdbench.datasets.synthetic.mesh import Mesh

SEEDS = range(20)
DIGESTS = Path(__file__).parent / "synthetic_furniture_digests.json"
LARGEST = {"floor": (3.7, 2.0, 2.4), "wall": (3.0, 0.35, 2.6), "ceiling": (0.9, 0.9, 0.9), "surface": (0.8, 0.7, 0.7)}


@cache
def pieces(name: str) -> list[Built]:
    return [FURNITURE[name].build(np.random.default_rng(seed)) for seed in SEEDS]


def digest(built: Built) -> str:
    """Of the vertices on a grid of 0.1 mm, set off so that round lengths do not lie on a cell's border."""
    cells = np.floor(built.mesh.vertices * 1e4 + 0.377).astype("<i8")
    return hashlib.sha256(cells.tobytes()).hexdigest()[:12]


def _edge_products(mesh: Mesh) -> np.ndarray:
    """(T, 3) along each triangle's normal, twice its area long."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


@pytest.mark.parametrize("name", FURNITURE)
def test_a_piece_is_whole_plausible_and_in_its_place(name: str) -> None:
    piece = FURNITURE[name]
    extents = []
    for built in pieces(name):
        mesh = built.mesh
        assert np.all(np.isfinite(mesh.vertices))
        assert mesh.triangles.min() >= 0
        assert mesh.triangles.max() < len(mesh.vertices)
        assert len(mesh.materials) == len(mesh.tints) == len(mesh.triangles) <= 4000
        assert set(np.unique(mesh.materials)) <= set(range(len(MATERIALS)))
        areas = np.linalg.norm(_edge_products(mesh), axis=1) / 2
        assert np.mean(areas < 1e-10) < 0.02
        low, high = mesh.bounds()
        extents.append(high - low)
        assert np.all(high - low <= LARGEST[piece.place])
        if piece.place in ("floor", "surface"):
            assert abs(low[2]) < 0.005
            assert np.all(low[:2] < 0)
            assert np.all(high[:2] > 0)
        elif piece.place == "wall":
            assert -1e-9 <= low[1] < 0.02
            assert low[2] >= -1e-9
            assert high[2] <= 2.6
        else:
            assert -0.003 < high[2] < 1e-9
    assert np.median([max(extent) for extent in extents]) > (0.35 if piece.tagged else 0.05)


@pytest.mark.parametrize("name", FURNITURE)
def test_the_seed_decides_all_of_it_and_seeds_differ(name: str) -> None:
    first, again = (FURNITURE[name].build(np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(first.mesh.vertices, again.mesh.vertices)
    assert np.array_equal(first.mesh.tints, again.mesh.tints)
    assert np.array_equal(first.mesh.materials, again.mesh.materials)
    assert first.tops == again.tops
    assert len({digest(built) for built in pieces(name)}) > 4


def test_vertices_are_pinned_across_machines() -> None:
    expected = json.loads(DIGESTS.read_text())
    found = {name: digest(piece.build(np.random.default_rng(1))) for name, piece in FURNITURE.items()}
    assert found == expected, f"if furniture was changed on purpose, write this to {DIGESTS.name}: {json.dumps(found)}"


@pytest.mark.parametrize("name", [name for name in FURNITURE if any(built.tops for built in pieces(name))])
def test_things_put_on_a_top_are_carried_by_it(name: str) -> None:
    """Lines down through most of a top meet a surface at its height (there are gaps between slats and cushions)."""
    for built in pieces(name):
        mesh = built.mesh
        low, high = mesh.bounds()
        for top in built.tops:
            assert np.all(np.array(top.center) - np.array(top.size) / 2 >= low[:2] - 1e-6)
            assert np.all(np.array(top.center) + np.array(top.size) / 2 <= high[:2] + 1e-6)
            assert min(top.size) > 0.1
            shares = np.array([(u, v) for u in (-0.4, -0.2, 0.01, 0.2, 0.4) for v in (-0.33, 0.1, 0.33)])
            spots = top.center + shares * top.size
            near = [_heights_at(mesh.vertices, mesh.triangles, spot) for spot in spots]
            carried = [heights.size > 0 and np.min(np.abs(heights - top.z)) < 0.05 for heights in near]
            assert np.mean(carried) > 0.6


def _heights_at(vertices: np.ndarray, triangles: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The heights at which the vertical line through `at` (x, y) meets triangles."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    level = np.abs(doubled) > 1e-12
    a, b, c, doubled = a[level], b[level], c[level], doubled[level]
    second = ((at[0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (at[1] - a[:, 1]) * (c[:, 0] - a[:, 0])) / doubled
    third = ((b[:, 0] - a[:, 0]) * (at[1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (at[0] - a[:, 0])) / doubled
    inside = (second >= 0) & (third >= 0) & (second + third <= 1)
    heights = a[:, 2] + second * (b[:, 2] - a[:, 2]) + third * (c[:, 2] - a[:, 2])
    return heights[inside]


@pytest.mark.parametrize("name", ["desk", "sofa", "bookcase", "chair", "round_table", "cabinet"])
def test_a_kind_comes_in_several_sizes_materials_and_tints(name: str) -> None:
    built = pieces(name)
    heights = [np.round(b.mesh.bounds()[1][2], 3) for b in built]
    assert len(set(heights)) > 10
    assert len({frozenset(np.unique(b.mesh.materials)) for b in built}) >= 3
    assert len({int(b.mesh.tints.max()) for b in built}) > 10


def test_seats_and_tables_have_the_heights_people_build() -> None:
    for name, lowest, highest in (("desk", 0.7, 0.77), ("dining_table", 0.7, 0.78), ("meeting_table", 0.7, 0.78)):
        tops = [top.z for built in pieces(name) for top in built.tops]
        assert lowest <= min(tops)
        assert max(tops) <= highest


def test_much_of_it_is_curved() -> None:
    """Planes along the axes alone do not make up the furniture of offices."""
    for name in ("office_chair", "sofa", "armchair", "plant", "waste_bin", "round_table", "floor_lamp"):
        for built in pieces(name)[:5]:
            products = np.abs(_edge_products(built.mesh))
            assert np.mean(products.max(axis=1) < 0.99 * np.linalg.norm(products, axis=1)) > 0.4
