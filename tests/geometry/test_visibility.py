"""Rays cast on meshes against intersections worked out by hand and by brute force."""

import numpy as np
import pytest

from pcdbench.geometry.visibility import MeshRaycaster, camera_directions, panorama_directions


def brute_force_ranges(vertices, triangles, origin, directions):
    """Möller-Trumbore, every ray with every triangle."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    ranges = np.full(len(directions), np.inf)
    for row, direction in enumerate(directions):
        p = np.cross(direction, c - a)
        det = np.einsum("ij,ij->i", b - a, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ij,ij->i", origin - a, p) / det
            q = np.cross(origin - a, b - a)
            v = q @ direction / det
            t = np.einsum("ij,ij->i", c - a, q) / det
        ok = (np.abs(det) > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        ranges[row] = t[ok].min() if ok.any() else np.inf
    return ranges


def test_ranges_agree_with_brute_force():
    rng = np.random.default_rng(3)
    vertices = rng.uniform(-3, 3, (40, 1, 3)).repeat(3, axis=1).reshape(120, 3) + rng.uniform(-1, 1, (120, 3))
    triangles = np.arange(120).reshape(-1, 3)
    directions = panorama_directions(12.0, -90.0, 90.0)
    origin = np.array([0.1, 0.2, 0.3])
    expected = brute_force_ranges(vertices, triangles, origin, directions)
    hits = MeshRaycaster(vertices, triangles).cast(origin, directions)
    # A ray through the border of a triangle may fall on either side in float32.
    agree = np.isclose(hits.range_m, expected, atol=1e-4)
    assert agree.mean() > 0.998
    assert 0.05 < np.isfinite(expected).mean() < 1.0
    hit = hits.triangle >= 0
    assert np.array_equal(hit, np.isfinite(hits.range_m))
    corners = vertices[triangles[hits.triangle[hit]]]
    points = origin + hits.range_m[hit, None] * directions[hit]
    off_plane = np.einsum("ij,ij->i", points - corners[:, 0], hits.normals[hit])
    assert np.abs(off_plane).max() < 1e-12


def test_map_coordinates_keep_their_precision():
    corners = np.array([[2.0, -1, -1], [2, 3, -1], [2, -1, 3]])
    offset = np.array([1.2e6, -4.0e6, 300.0])
    near = MeshRaycaster(corners, [[0, 1, 2]]).cast(np.zeros(3), [[1.0, 0, 0]])
    far = MeshRaycaster(corners + offset, [[0, 1, 2]]).cast(offset, [[1.0, 0, 0]])
    assert near.range_m[0] == pytest.approx(2.0, abs=1e-6)
    assert far.range_m[0] == pytest.approx(2.0, abs=1e-6)


def test_normals_look_back_at_the_origin_from_both_sides():
    caster = MeshRaycaster([[1.0, -1, -1], [1, 1, -1], [1, 0, 1]], [[0, 1, 2]])
    hits = caster.cast([[0.0, 0, 0], [2.0, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]])
    np.testing.assert_allclose(hits.normals, [[-1, 0, 0], [1, 0, 0]], atol=1e-6)


def test_nothing_hit_and_empty_mesh():
    caster = MeshRaycaster([[1.0, -1, -1], [1, 1, -1], [1, 0, 1]], [[0, 1, 2]])
    for missed in (
        caster.cast(np.zeros(3), [[-1.0, 0, 0]]),
        MeshRaycaster(np.empty((0, 3)), np.empty((0, 3), np.int64)).cast(np.zeros(3), [[1.0, 0, 0]]),
    ):
        assert missed.range_m.tolist() == [np.inf]
        assert missed.triangle.tolist() == [-1]
        assert missed.normals.tolist() == [[0, 0, 0]]


def test_camera_directions_span_the_field_of_view():
    width, height = 401, 201
    rays = camera_directions(90.0, width, height).reshape(height, width, 3)
    np.testing.assert_allclose(rays[100, 200], [1, 0, 0], atol=1e-12)
    assert rays[100, 0, 1] > 0 > rays[100, -1, 1]
    assert rays[0, 200, 2] > 0 > rays[-1, 200, 2]
    left_edge_deg = np.degrees(np.arctan2(rays[100, 0, 1], rays[100, 0, 0]))
    assert left_edge_deg == pytest.approx(45.0, abs=0.1)
    flat = rays / rays[..., :1]
    assert flat[100, 199, 1] == pytest.approx(flat[99, 200, 2])
    with pytest.raises(ValueError, match="horizontal_fov_deg"):
        camera_directions(180.0, 4, 3)


def test_panorama_covers_the_sphere_evenly():
    rays = panorama_directions(2.0, -90.0, 90.0)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    assert len(rays) == pytest.approx(4 * np.pi / np.radians(2.0) ** 2, rel=0.02)
    np.testing.assert_allclose(rays.mean(axis=0), 0.0, atol=1e-3)
    assert np.degrees(np.arcsin(panorama_directions(2.0, -60.0, 30.0)[:, 2].min())) == pytest.approx(-59.0)
