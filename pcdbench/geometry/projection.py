"""What voxels look like from the six sides of their grid, and how alike two such views are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pcdbench.geometry.voxels import Voxels

FACES = ("-x", "+x", "-y", "+y", "-z", "+z")
"""The side from which each image of `six_faces` is seen, in order."""

BACKGROUND = 0.0
"""Grey value of pixels that show nothing: black. Surfaces indoors are light, so that what is missing stands out."""

WINDOW = 7
"""Side of the square SSIM window, pixels."""

Image = NDArray[np.float64]


def six_faces(voxels: Voxels) -> list[Image]:
    """Orthographic images of the voxels from the six sides of the grid, in the order of `FACES`.

    Each pixel shows the colour of the nearest occupied voxel along its line of sight, or `BACKGROUND` where
    there is none. An image has the grid's two other axes as rows and columns, in that order: (ny, nz, 3) along
    x, (nx, nz, 3) along y, (nx, ny, 3) along z. Opposite sides are not mirrored.
    """
    images = []
    for axis in range(3):
        rows, columns = (other for other in range(3) if other != axis)
        near_first = np.argsort(voxels.index[:, axis], kind="stable")
        for order in (near_first[::-1], near_first):
            image = np.full((voxels.shape[rows], voxels.shape[columns], 3), BACKGROUND)
            # Painter's algorithm: of equal pixels numpy keeps the last one written, which is the nearest.
            image[voxels.index[order, rows], voxels.index[order, columns]] = voxels.colors[order]
            images.append(image)
    return images


def structural_similarity(first: Image, second: Image) -> float:
    """SSIM of two (H, W, 3) images with values in [0, 1]: 1 for equal ones.

    Wang et al. (2004), equations 13 and 17, over a uniform window of `WINDOW` pixels, channels averaged. Both
    images are first framed by half a window of background, so that every pixel counts and images smaller than
    the window have a value too.
    """
    from skimage.metrics import structural_similarity as ssim

    half = WINDOW // 2
    frame = ((half, half), (half, half), (0, 0))
    first, second = (np.pad(image, frame, constant_values=BACKGROUND) for image in (first, second))
    return float(ssim(first, second, win_size=WINDOW, channel_axis=-1, data_range=1.0))


def six_face_similarity(first: Voxels, second: Voxels) -> float:
    """Mean SSIM of the six faces of two sets of voxels on one grid: 1 where they look alike from every side."""
    pairs = zip(six_faces(first), six_faces(second), strict=True)
    return float(np.mean([structural_similarity(*pair) for pair in pairs]))
