"""What each part of voxel_unet's training brings, at equal steps: the table of docs/completers/voxel_unet.md.

    python docs/study_voxel_unet.py OUT [--steps 600] [--folder SCANS] [--only NAME ...]

Trains a network a variant into OUT/NAME, each from the same first weights on the same pairs, and measures the median
ChD over that of doing nothing: on generated rooms of the split `val`, on the same rooms with natural gaps, and on the
scans of a folder. What is in OUT already is not trained again. A step takes about a second; nothing of a folder of
scans is ever trained on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pcdbench_completers.voxel_unet.completer import VOXEL_SPACINGS
from pcdbench_completers.voxel_unet.network import WIDTHS, VoxelUNet
from pcdbench_completers.voxel_unet.trainee import VoxelUNetTrainee

from pcdbench.case import Case, make_case
from pcdbench.completer import Completer
from pcdbench.datasets.clouds import Clouds
from pcdbench.datasets.synthetic import Indoor
from pcdbench.incompletenesses.holes import Holes
from pcdbench.scene import Scene
from pcdbench.training.augment import Recipe, natural_gaps
from pcdbench.training.loop import Budget, train
from pcdbench.training.stream import PairStream
from pcdbench.training.validation import capped_chd
from pcdbench.weights import Weights

LEVELS = (0.1, 0.3, 0.5)
ROOMS = 8
MIN_POINTS = 8000
BARE = Recipe(gaps=False, ghosts=False, clutter=False, density=False, noise=False, pose=False, color=False)


@dataclass(frozen=True)
class Variant:
    """A training that differs from the full one in one thing.

    Attributes:
        share: of the steps that are trained.
    """

    recipe: Recipe = field(default_factory=Recipe)
    widths: tuple[int, ...] = WIDTHS
    voxel_spacings: float = VOXEL_SPACINGS
    share: float = 1.0


VARIANTS = {
    "everything": Variant(),
    "no natural gaps": Variant(Recipe(gaps=False)),
    "no ghosts": Variant(Recipe(ghosts=False)),
    "no clutter": Variant(Recipe(clutter=False)),
    "one density": Variant(Recipe(density=False)),
    "no noise": Variant(Recipe(noise=False)),
    "one heading and scale": Variant(Recipe(pose=False)),
    "one light": Variant(Recipe(color=False)),
    "no augmentation": Variant(BARE),
    "voxels of 1.25 spacings": Variant(voxel_spacings=1.25),
    "voxels of 2.5 spacings": Variant(voxel_spacings=2.5),
    "three levels": Variant(widths=WIDTHS[:3]),
    "four levels": Variant(widths=WIDTHS[:4]),
    "half the width": Variant(widths=tuple(width // 2 for width in WIDTHS)),
    "half the steps": Variant(share=0.5),
    "a quarter of the steps": Variant(share=0.25),
}


def trained(variant: Variant, out: Path, steps: int) -> Completer:
    """The completer of a variant, trained unless it is there."""
    trainee = VoxelUNetTrainee(variant.widths, variant.voxel_spacings)
    total, done = round(variant.share * steps), out / "done"
    if not done.exists():
        train(trainee, out, Budget(steps=total), stream=PairStream(recipe=variant.recipe), resume=True)
        done.touch()
    weights = Weights(out / "weights.safetensors", str(out / "weights.safetensors"), "voxel_unet")
    network = VoxelUNet(variant.widths)
    weights.load_into(network)
    return trainee.completer(network)


def generated() -> Iterator[Scene]:
    data = Indoor()
    yield from (data.scene(name) for name in data.scene_names("val")[:ROOMS])


def with_gaps(scenes: Iterator[Scene]) -> Iterator[Scene]:
    """The scenes with complete clouds that have natural gaps of their own."""
    for number, scene in enumerate(scenes):
        kept = natural_gaps(scene.complete.points, np.random.default_rng(number))
        yield replace(scene, complete=scene.complete.select(kept), complete_index=scene.complete_index[kept])


def real(folder: Path) -> Iterator[Scene]:
    data = Clouds(folder)
    scenes = (data.scene(name) for name in data.scene_names(data.default_split))
    yield from (scene for scene in scenes if len(scene.complete) >= MIN_POINTS)


def cases(scenes: Iterable[Scene]) -> dict[float, list[tuple[Case, float]]]:
    """By level, the scenes' cases, each with the ChD of doing nothing."""
    made: dict[float, list[tuple[Case, float]]] = {level: [] for level in LEVELS}
    for scene in scenes:
        for level in LEVELS:
            case = make_case(scene, "holes", Holes(), level, 1)
            made[level].append((case, capped_chd(case.cloud.points, scene.complete.points)))
    return made


def ratios(completer: Completer, by_level: dict[float, list[tuple[Case, float]]]) -> list[float]:
    """At each level, the median ChD over that of doing nothing."""
    found = []
    for made in by_level.values():
        ours = [
            capped_chd(completer.complete(case.cloud, np.random.default_rng(0)).points, case.scene.complete.points)
            for case, _ in made
        ]
        found.append(float(np.median(ours) / np.median([nothing for _, nothing in made])))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--folder", type=Path, help="real scans, to be measured on")
    parser.add_argument("--only", nargs="*", default=list(VARIANTS), choices=list(VARIANTS))
    arguments = parser.parse_args()
    places = {"generated rooms": cases(generated()), "with natural gaps": cases(with_gaps(generated()))}
    if arguments.folder is not None:
        places["real rooms"] = cases(real(arguments.folder))
    print(f"| {arguments.steps} steps, 10 / 30 / 50 % missing | {' | '.join(places)} |\n|---|{'---|' * len(places)}")
    for name in arguments.only:
        completer = trained(VARIANTS[name], arguments.out / name.replace(" ", "_"), arguments.steps)
        cells = [" / ".join(f"{ratio:.2f}" for ratio in ratios(completer, by_level)) for by_level in places.values()]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
