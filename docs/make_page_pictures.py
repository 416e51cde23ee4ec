"""Makes the pictures of pages in docs/: `python docs/make_page_pictures.py`, a minute; needs Chromium.

The viewer with a generated room, its completion and its truth, for docs/viewing.md; the page of the board `indoor`, for
docs/leaderboards.md.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser_for_tests import pictured

import pcdbench
from pcdbench.case import make_case
from pcdbench.datasets.synthetic import Indoor
from pcdbench.incompletenesses.holes import Holes
from pcdbench.plugins import registry

ROOT = Path(__file__).parents[1]
SCENE = "env001_crop0"
LEVEL = 0.3
VIEWER, BOARD = (1500, 720), (1160, 2500)  # pixels


def viewer_page() -> str:
    scene = Indoor().scene(SCENE)
    case = make_case(scene, "holes", Holes(), LEVEL, seed=0)
    completer = registry().get("completer", "voxel_unet").load()()
    completed = completer.complete(case.cloud, np.random.default_rng(0))
    clouds = {"scan": case.cloud, "completed by voxel_unet": completed, "truth": scene.complete}
    return pcdbench.view(clouds, reference=scene.complete).html


def main() -> None:
    pages = {
        "view": (viewer_page(), 'choose("added");', VIEWER),
        "board_page": (
            (ROOT / "leaderboards" / "indoor" / "index.html").read_text(encoding="utf-8"),
            'document.querySelectorAll("input[name=task]")[1].click();',
            BOARD,
        ),
    }
    for name, (page, script, size) in pages.items():
        path = ROOT / "docs" / "images" / f"{name}.png"
        with tempfile.TemporaryDirectory() as folder:
            pictured(page, script, Path(folder), path, size)
        print(path)


if __name__ == "__main__":
    main()
