"""Makes the pictures of docs/completers/ and README.md: `python docs/make_completer_pictures.py [SCANS]`, two minutes.

A hall, an office and, where the folder SCANS is given, its first scan, 30 % missing: true, incomplete, and what every
completer makes of it. And the rooms of the boards that voxel_unet completes worst, half of each missing.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from pcdbench.case import make_case
from pcdbench.datasets.clouds import Clouds
from pcdbench.datasets.synthetic import Indoor
from pcdbench.geometry.neighbors import nearest
from pcdbench.incompletenesses.holes import Holes
from pcdbench.plugins import registry
from pcdbench.scene import Scene
from pcdbench.viewing.picture import write_picture

COMPLETERS = ("deeppcd", "deeppcd_merged", "pcn", "foldingnet", "plane_fitting", "hole_filling", "voxel_unet")
GENERATED = {"hall": "env002_crop0", "office": "env001_crop0"}
LEVEL = 0.3
# Of the rooms at 50 % those with the largest ChD over that of doing nothing, in leaderboards/.
FAILING = "env009_crop0"
FAILING_SCAN = "office_b_room10"
WIDTH = 2000  # pixels


def draw(name: str, scene: Scene, level: float, completers: Sequence[str]) -> None:
    case = make_case(scene, "holes", Holes(), level, seed=0)
    clouds = [("true", scene.complete), ("incomplete", case.cloud)]
    for completer in completers:
        made = registry().get("completer", completer).load()()
        clouds.append((completer, made.complete(case.cloud, np.random.default_rng(0))))
    path = Path(__file__).parent / "images" / f"{name}.png"
    away, _ = nearest(scene.complete.points, case.cloud.points)
    missing = {"incomplete": scene.complete.select(away > 0)}
    write_picture(path, clouds, f"{scene.name}: {level:.0%} missing", scene.complete, missing)
    with Image.open(path) as picture:
        width = min(WIDTH, picture.width)
        small = picture.convert("RGB").resize((width, round(width * picture.height / picture.width)))
    small.quantize(128).save(path, optimize=True)
    print(path)


def main(folder: str = "") -> None:
    generated = Indoor()
    for name, scene in GENERATED.items():
        draw(f"completers_{name}", generated.scene(scene), LEVEL, COMPLETERS)
    draw("case", generated.scene(GENERATED["office"]), LEVEL, ["voxel_unet", "deeppcd_merged"])  # the README's
    draw("voxel_unet_failing", generated.scene(FAILING), 0.5, ["voxel_unet"])
    if folder:
        scans = Clouds(Path(folder))
        draw("completers_real_office", scans.scene(scans.scene_names(scans.default_split)[0]), LEVEL, COMPLETERS)
        if FAILING_SCAN in scans.scene_names(scans.default_split):
            draw("voxel_unet_failing_real", scans.scene(FAILING_SCAN), 0.5, ["voxel_unet"])


if __name__ == "__main__":
    main(*sys.argv[1:])
