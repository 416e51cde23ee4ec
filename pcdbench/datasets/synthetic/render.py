"""Pictures of meshes as a camera sees them: rays, textures and a plain light."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcdbench.datasets.synthetic.materials import MATERIALS, colors, material_id
from pcdbench.datasets.synthetic.mesh import Mesh
from pcdbench.open3d_loader import load_open3d

_AMBIENT = 0.42
_LAMP = np.array([0.35, 0.5, 1.0]) / np.linalg.norm([0.35, 0.5, 1.0])
_SIDE_LAMP = np.array([-0.8, 0.35, 0.3]) / np.linalg.norm([-0.8, 0.35, 0.3])
_BACKGROUND = (0.93, 0.94, 0.96)


def render_view(
    mesh: Mesh, eye: ArrayLike, target: ArrayLike, fov_deg: float, width: int, height: int
) -> NDArray[np.float32]:
    """The mesh seen by a pinhole camera that stands upright; panes of glass are left out.

    Args:
        mesh: what to look at.
        eye: (3,) metres, where the camera is.
        target: (3,) metres, what is in the middle of the picture; not straight above or below `eye`.
        fov_deg: the horizontal angle of view.
        width: pixels.
        height: pixels.

    Returns:
        (height, width, 3) float32 in [0, 1]; a light grey where nothing is seen.
    """
    open3d = load_open3d()
    kept = mesh.materials != material_id("glass")
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(mesh.vertices.astype(np.float32)),
        open3d.core.Tensor(mesh.triangles[kept].astype(np.uint32)),
    )
    rays = _camera_rays(np.asarray(eye, np.float64), np.asarray(target, np.float64), fov_deg, width, height)
    hits = scene.cast_rays(open3d.core.Tensor(rays.astype(np.float32)))
    distance = hits["t_hit"].numpy().astype(np.float64)
    seen = np.flatnonzero(np.isfinite(distance))
    triangle = np.flatnonzero(kept)[hits["primitive_ids"].numpy()[seen].astype(np.int64)]
    points = rays[seen, :3] + rays[seen, 3:] * distance[seen, None]
    normals = mesh.triangle_normals()[triangle]
    normals = np.where(np.sum(normals * rays[seen, 3:], axis=1, keepdims=True) > 0, -normals, normals)
    picture = np.tile(np.array(_BACKGROUND, np.float32), (width * height, 1))
    albedo = colors(points, normals, mesh.materials[triangle], mesh.tints[triangle])
    glow = np.array([material.glow for material in MATERIALS])[mesh.materials[triangle]]
    picture[seen] = albedo * np.maximum(_shade(normals), glow)[:, None]
    return np.clip(picture, 0.0, 1.0).reshape(height, width, 3)


def _camera_rays(
    eye: NDArray[np.float64], target: NDArray[np.float64], fov_deg: float, width: int, height: int
) -> NDArray[np.float64]:
    """(H * W, 6) origins and unit directions, row by row from the top left."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    half = np.tan(np.radians(fov_deg) / 2)
    across = ((np.arange(width) + 0.5) / width * 2 - 1) * half
    along = ((np.arange(height) + 0.5) / height * 2 - 1) * half * height / width
    directions = forward + across[None, :, None] * right + along[:, None, None] * down
    directions = directions.reshape(-1, 3) / np.linalg.norm(directions.reshape(-1, 3), axis=1, keepdims=True)
    return np.concatenate([np.broadcast_to(eye, directions.shape), directions], axis=1)


def _shade(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) brightness under ambient light, a lamp above in front and a weaker one from the left."""
    lamp = np.clip(normals @ _LAMP, 0.0, None)
    side = np.clip(normals @ _SIDE_LAMP, 0.0, None)
    return np.minimum(_AMBIENT + 0.48 * lamp + 0.25 * side, 1.0)
