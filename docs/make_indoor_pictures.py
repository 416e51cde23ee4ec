"""Makes the pictures of docs/indoor.md: `python docs/make_indoor_pictures.py [FOLDER]`, about two minutes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pcdbench import PointCloud
from pcdbench.datasets.synthetic import Indoor
from pcdbench.datasets.synthetic.environment import Environment
from pcdbench.datasets.synthetic.generator import environment
from pcdbench.datasets.synthetic.lighting import shaded_colors
from pcdbench.geometry.visibility import camera_directions

Picture = NDArray[np.float32]

SHOWN = (0, 2, 4, 6, 12, 10, 1, 3, 5, 7, 11, 15)
TILE = (460, 310)
CUT_M = 2.1


def seen(place: Environment, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Picture:
    """(R, 3) the color that each ray sees."""
    hits = place.raycaster.cast(origins, directions)
    hit = np.flatnonzero(hits.triangle >= 0)
    picture = np.full((len(directions), 3), 0.93, np.float32)
    points = np.broadcast_to(origins, directions.shape)[hit] + directions[hit] * hits.range_m[hit, None]
    picture[hit] = shaded_colors(place, points, hits.normals[hit], place.opaque[hits.triangle[hit]])
    return picture


def from_above(place: Environment, width: int = 920) -> Picture:
    """The environment cut at 2.1 m, seen straight from above."""
    low, high = place.bounds
    pixel = (high - low)[0] / width
    x = low[0] + (np.arange(width) + 0.5) * pixel
    y = high[1] - (np.arange(int((high - low)[1] / pixel)) + 0.5) * pixel
    grid = np.stack([*np.meshgrid(x, y), np.full((len(y), len(x)), CUT_M)], axis=-1).reshape(-1, 3)
    down = np.tile([0.0, 0.0, -1.0], (len(grid), 1))
    return seen(place, grid, down).reshape(len(y), len(x), 3)


def camera_rays(yaw: float, pitch_deg: float, width: int, height: int, fov_deg: float = 82.0) -> NDArray[np.float64]:
    """(H * W, 3) the directions of a camera turned by `yaw` and tilted by `pitch_deg`."""
    rays = camera_directions(fov_deg, width, height)
    c, s = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    rays = rays @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    c, s = np.cos(yaw), np.sin(yaw)
    return rays @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def from_inside(place: Environment) -> Picture:
    """The view, from where one can stand, that shows the most pieces in the rooms the environment is named after."""
    floor = place.floor
    cells = np.argwhere((floor.clearance > 0.45) & floor.central)
    spots = floor.centers(cells[np.random.default_rng(0).choice(len(cells), min(25, len(cells)), replace=False)])
    best, view = -1.0, None
    for x, y in spots:
        for yaw in np.arange(8) * np.pi / 4:
            hits = place.raycaster.cast(np.array([x, y, 1.65]), camera_rays(yaw, -12.0, 48, 32))
            pieces = place.pieces[place.opaque[hits.triangle]]
            useful = pieces[(hits.triangle >= 0) & (hits.range_m > 1.2) & (pieces > 0)]
            score = len(np.unique(useful)) + 0.01 * len(useful) - 0.05 * float((hits.range_m < 1.0).sum())
            if score > best:
                best, view = score, (np.array([x, y, 1.65]), yaw)
    assert view is not None
    width, height = 2 * TILE[0], 2 * TILE[1]
    return seen(place, view[0], camera_rays(view[1], -12.0, width, height)).reshape(height, width, 3)


def cloud_picture(cloud: PointCloud, size_px: int, dot: int) -> Picture:
    """A cloud without what is above 2.1 m, seen obliquely from above."""
    assert cloud.colors is not None
    kept = cloud.points[:, 2] < CUT_M
    points, colors = cloud.points[kept], cloud.colors[kept]
    points = points - (points.min(axis=0) + points.max(axis=0)) / 2
    turn, tilt = np.radians(28.0), np.radians(52.0)
    x = points[:, 0] * np.cos(turn) - points[:, 1] * np.sin(turn)
    y = points[:, 0] * np.sin(turn) + points[:, 1] * np.cos(turn)
    up = y * np.sin(tilt) + points[:, 2] * np.cos(tilt)
    near = points[:, 2] * np.sin(tilt) - y * np.cos(tilt)
    scale = (size_px - 10) / np.ptp(x)
    height = int(np.ptp(up) * scale) + 10
    picture = np.full((height, size_px, 3), 1.0, np.float32)
    order = np.argsort(near)
    column = ((x - x.min()) * scale).astype(int)[order] + 3
    row = height - 6 - ((up - up.min()) * scale).astype(int)[order]
    for i in range(dot):
        for j in range(dot):
            picture[np.clip(row + i, 0, height - 1), np.clip(column + j, 0, size_px - 1)] = colors[order]
    return picture


def as_image(picture: Picture) -> Image.Image:
    return Image.fromarray(np.rint(np.clip(picture, 0.0, 1.0) * 255).astype(np.uint8))


def sheet(tiles: list[tuple[str, Image.Image]], columns: int, size: tuple[int, int]) -> Image.Image:
    """The pictures in a grid, a line of text under each."""
    rows = -(-len(tiles) // columns)
    page = Image.new("RGB", (columns * (size[0] + 8), rows * (size[1] + 24)), "white")
    draw = ImageDraw.Draw(page)
    font = ImageFont.load_default(14)
    for k, (title, image) in enumerate(tiles):
        x, y = k % columns * (size[0] + 8), k // columns * (size[1] + 24)
        image.thumbnail(size, Image.Resampling.LANCZOS)
        page.paste(image, (x + (size[0] - image.width) // 2, y + (size[1] - image.height) // 2))
        draw.text((x + 6, y + size[1] + 3), title, fill="black", font=font)
    return page


def save(image: Image.Image, path: Path) -> None:
    image.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)
    print(path, f"{path.stat().st_size / 1e6:.2f} MB")


def environments_sheet(picture_of: Callable[[Environment], Picture]) -> Image.Image:
    tiles = []
    for index in SHOWN:
        place = environment(index)
        tiles.append((f"{place.name}  {place.kind}", as_image(picture_of(place))))
    return sheet(tiles, 3, TILE)


def clouds_sheet() -> Image.Image:
    tiles = []
    for name in Indoor().scene_names("smoke"):
        scene = Indoor().scene(name)
        for title, cloud, dot in (("dense", scene.dense, 2), ("complete", scene.complete, 5)):
            line = f"{name}  {scene.info['kind']}, {title}: {len(cloud):,} points ({scene.info['survey']})"
            tiles.append((line, as_image(cloud_picture(cloud, 690, dot))))
    return sheet(tiles, 2, (690, 470))


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "images"
    folder.mkdir(parents=True, exist_ok=True)
    save(environments_sheet(from_above), folder / "indoor_above.png")
    save(environments_sheet(from_inside), folder / "indoor_inside.png")
    save(clouds_sheet(), folder / "indoor_clouds.png")
