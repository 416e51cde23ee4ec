"""Measures what `confidence` is worth on generated rooms with holes, and makes docs/images/complete_report.png.

`python docs/measure_confidence.py [ROOMS [COMPLETER,...]]`: rooms of the split `test-small` (five unless given), 40 %
missing; the error of an added point is its distance to the room's true surface. The picture is made with
`plane_fitting` and five rooms or more. About three minutes on two cores.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import spearmanr

import pcdbench
from pcdbench import PointCloud, Scene
from pcdbench.completion.report import write_report
from pcdbench.datasets.synthetic import Indoor
from pcdbench.open3d_loader import load_open3d

ROOMS = 5
LEVEL = 0.4
PICTURE = Path(__file__).parent / "images" / "complete_report.png"


def with_holes(cloud: PointCloud, seed: int) -> PointCloud:
    """The cloud without patches of 3 % around random points, until 40 % are gone."""
    rng = np.random.default_rng(seed)
    tree, kept = cKDTree(cloud.points), np.ones(len(cloud), np.bool_)
    while kept.mean() > 1 - LEVEL:
        _, near = tree.query(cloud.points[rng.integers(len(cloud))], k=int(0.03 * len(cloud)))
        kept[near] = False
    return cloud.select(kept)


def errors_m(scene: Scene, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) metres to the nearest surface of the scene."""
    assert scene.surface is not None
    open3d = load_open3d()
    casting = open3d.t.geometry.RaycastingScene()
    vertices = open3d.core.Tensor(scene.surface.vertices.astype(np.float32))
    casting.add_triangles(vertices, open3d.core.Tensor(scene.surface.triangles.astype(np.uint32)))
    return np.asarray(casting.compute_distance(open3d.core.Tensor(points.astype(np.float32))).numpy(), np.float64)


def main(rooms: str = str(ROOMS), completers: str = "plane_fitting,hole_filling") -> None:
    data = Indoor()
    names = data.scene_names("test-small")
    names = names[:: max(1, len(names) // int(rooms))][: int(rooms)]
    print(
        "| completer | added points | rank correlation of confidence and error |"
        " mean error of thirds: lowest, middle, highest confidence |"
    )
    print("|---|---|---|---|")
    for completer in completers.split(","):
        correlations, thirds, count = [], [], 0
        for number, name in enumerate(names):
            scene = data.scene(name)
            done = pcdbench.complete(with_holes(scene.complete, number), completer)
            error, trust = errors_m(scene, done.added_cloud.points), done.confidence[done.added]
            count += len(error)
            correlations.append(float(spearmanr(trust, error)[0]))
            thirds.append([100 * part.mean() for part in np.array_split(error[np.argsort(trust)], 3)])
            if number == 0 and completer == "plane_fitting" and len(names) >= ROOMS:
                with tempfile.TemporaryDirectory() as made:
                    write_report(done, Path(made), name, completer)
                    PICTURE.write_bytes((Path(made) / "report.png").read_bytes())
        mean = ", ".join(f"{value:.1f}" for value in np.mean(thirds, axis=0))
        spread = f"{np.mean(correlations):.2f} ({min(correlations):.2f} to {max(correlations):.2f} by room)"
        print(f"| `{completer}` | {count:,} | {spread} | {mean} cm |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
