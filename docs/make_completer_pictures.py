"""Makes the pictures of docs/completers/deeppcd.md: `python docs/make_completer_pictures.py [SCANS]`, about a minute.

A hall, an office and, where the folder SCANS is given, its first scan, 30 % missing: true, incomplete, and what every
completer makes of it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from pcdbench.case import make_case
from pcdbench.datasets.clouds import Clouds
from pcdbench.datasets.synthetic import Indoor
from pcdbench.incompletenesses.holes import Holes
from pcdbench.leaderboard.picture import write_picture
from pcdbench.plugins import registry

COMPLETERS = ("deeppcd", "deeppcd_merged", "pcn", "foldingnet", "plane_fitting", "hole_filling", "voxel_unet")
GENERATED = {"hall": "env002_crop0", "office": "env001_crop0"}
LEVEL = 0.3
WIDTH = 2000  # pixels


def main(folder: str = "") -> None:
    generated = Indoor()
    scenes = {name: generated.scene(scene) for name, scene in GENERATED.items()}
    if folder:
        scans = Clouds(Path(folder))
        scenes["real_office"] = scans.scene(scans.scene_names(scans.default_split)[0])
    for name, scene in scenes.items():
        case = make_case(scene, "holes", Holes(), LEVEL, seed=0)
        clouds = [("true", scene.complete), ("incomplete", case.cloud)]
        for completer in COMPLETERS:
            made = registry().get("completer", completer).load()()
            clouds.append((completer, made.complete(case.cloud, np.random.default_rng(0))))
        path = Path(__file__).parent / "images" / f"completers_{name}.png"
        write_picture(path, clouds, f"{scene.name}: {LEVEL:.0%} missing", scene.complete)
        with Image.open(path) as picture:
            small = picture.convert("RGB").resize((WIDTH, round(WIDTH * picture.height / picture.width)))
        small.quantize(128).save(path, optimize=True)
        print(path)


if __name__ == "__main__":
    main(*sys.argv[1:])
