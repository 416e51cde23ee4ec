"""What each part of voxel_unet brings: the tables of docs/completers/voxel_unet.md.

    python docs/study_voxel_unet.py [--folder SCANS] rules
    python docs/study_voxel_unet.py [--folder SCANS] training OUT [--more 120] [--steps 300] [--only NAME ...]

`rules`: the network in the package with one rule of what is made of its answers left out at a time; nothing is trained.

`training`, at equal steps:

Augmentations and voxels: the network in the package is trained on for `--more` steps with one thing left out or
changed, on pairs that it did not see; what it then does worse, that thing had brought. Sizes of the network: each is
trained from nothing for `--steps` steps on the same pairs. Measured are the cross entropy of occupancy on pairs of
other crops, and the median ChD over that of doing nothing: on generated rooms of the split `val`, on the same rooms
with natural gaps, and on the scans of a folder, which nothing is ever trained on. What is in OUT already is not
trained again. A step takes one to two seconds of one core.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import ModuleType

import numpy as np
import torch
from pcdbench_completers import inpainting
from pcdbench_completers.voxel_unet import completer as rules_of
from pcdbench_completers.voxel_unet import tiles
from pcdbench_completers.voxel_unet.completer import SHIPPED_WEIGHTS, VOXEL_SPACINGS
from pcdbench_completers.voxel_unet.network import WIDTHS, VoxelUNet
from pcdbench_completers.voxel_unet.tiles import surface
from pcdbench_completers.voxel_unet.trainee import VoxelUNetTrainee
from pcdbench_tasks.ssim import Ssim
from torch import Tensor

from pcdbench.case import Case, make_case
from pcdbench.completer import Completer
from pcdbench.datasets.clouds import Clouds
from pcdbench.datasets.synthetic import Indoor
from pcdbench.incompletenesses.holes import Holes
from pcdbench.scene import Scene
from pcdbench.training.augment import Recipe, natural_gaps, seen_from_stations
from pcdbench.training.loop import Budget, train
from pcdbench.training.stream import PairStream, TrainingPair
from pcdbench.training.validation import capped_chd
from pcdbench.weights import Weights

LEVELS = (0.1, 0.3, 0.5)
ROOMS = 8
HELD_OUT = range(40_000, 40_040)  # pairs of crops that no training came to
MIN_POINTS = 8000
NARROW = (16, 32, 64, 96, 128)  # what the study of sizes was made with, and the network had until version 6
BARE = Recipe(**dict.fromkeys((kind.name for kind in fields(Recipe)), False))


@dataclass(frozen=True)
class Variant:
    """A training that differs from the full one in one thing.

    Attributes:
        fresh: from nothing, not from the weights in the package.
    """

    recipe: Recipe = field(default_factory=Recipe)
    widths: tuple[int, ...] = WIDTHS
    voxel_spacings: float = VOXEL_SPACINGS
    fresh: bool = False


VARIANTS = {
    "nothing changed": Variant(),
    "no gaps of any kind": Variant(Recipe(gaps=False, stations=False, notches=False)),
    "no notches": Variant(Recipe(notches=False)),
    "surveys of all stations": Variant(Recipe(stations=False)),
    "no augmentation": Variant(BARE),
    "no clutter": Variant(Recipe(clutter=False)),
    "one density": Variant(Recipe(density=False)),
    "no noise": Variant(Recipe(noise=False)),
    "no ghosts": Variant(Recipe(ghosts=False)),
    "one heading and scale": Variant(Recipe(pose=False)),
    "one light": Variant(Recipe(color=False)),
    "voxels of 1.25 spacings": Variant(voxel_spacings=1.25),
    "voxels of 2.5 spacings": Variant(voxel_spacings=2.5),
    "five levels": Variant(widths=NARROW, fresh=True),
    "four levels": Variant(widths=NARROW[:4], fresh=True),
    "three levels": Variant(widths=NARROW[:3], fresh=True),
    "half the width": Variant(widths=tuple(width // 2 for width in NARROW), fresh=True),
}


def trained(variant: Variant, trainee: VoxelUNetTrainee, out: Path, steps: int) -> VoxelUNet:
    """The network of a variant, trained unless it is there."""
    done = out / "done"
    if not done.exists():
        stream = PairStream(seed=0 if variant.fresh else 1, recipe=variant.recipe)
        start = None if variant.fresh else Weights(SHIPPED_WEIGHTS, "", "voxel_unet")
        train(trainee, out, Budget(steps=steps), stream=stream, start=start, resume=True)
        done.touch()
    weights = Weights(SHIPPED_WEIGHTS, str(out / "weights.safetensors"), "voxel_unet")
    return weights.load_into(VoxelUNet(variant.widths)).eval()


def generated() -> Iterator[Scene]:
    data = Indoor()
    yield from (data.scene(name) for name in data.scene_names("val")[:ROOMS])


def with_gaps(scenes: Iterator[Scene]) -> Iterator[Scene]:
    """The scenes with complete clouds that have natural gaps of their own, also those of a survey of few stations."""
    for number, scene in enumerate(scenes):
        rng = np.random.default_rng(number)
        kept = np.flatnonzero(seen_from_stations(scene.complete.points, rng))
        kept = kept[natural_gaps(scene.complete.points[kept], rng)]
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


def entropy(trainee: VoxelUNetTrainee, network: VoxelUNet, pairs: Sequence[TrainingPair]) -> float:
    """The cross entropy of occupancy over pairs, in hundredths; comparable between networks of one size of voxels."""
    found = []
    for number, pair in enumerate(pairs):
        (example,) = trainee.collate([trainee.example(pair, np.random.default_rng(number))])
        tensors = {name: torch.as_tensor(value) for name, value in example.items()}
        with torch.inference_mode():
            found.append(float(trainee.loss(network, tensors)["entropy"]))
    return 100 * float(np.mean(found))


def ssim(completer: Completer, by_level: dict[float, list[tuple[Case, float]]]) -> list[float]:
    """At each level, the median SSIM."""
    rng = np.random.default_rng
    return [
        float(
            np.median(
                [
                    Ssim().evaluate(case, completer.complete(case.cloud, rng(0)), rng(0)).samples["ssim"]
                    for case, _ in made
                ]
            )
        )
        for made in by_level.values()
    ]


def across_most(occupancy: Tensor, at: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """As `tiles.surface`, but along the axis on which the neighbours are most occupied: along the surface, then."""
    probability, ridge, across = surface(-occupancy, at)
    here, *rows = tiles.around(occupancy, at)
    for axis, (before, after) in enumerate(rows):
        its = across == axis
        probability = torch.where(its, 1 - (1 - here) * (1 - before) * (1 - after), probability)
        ridge = torch.where(its, here >= torch.maximum(before, after), ridge)
    return probability, ridge, across


def study_rules(measured: dict[str, dict[float, list[tuple[Case, float]]]]) -> None:
    """The table of what each rule brings."""
    rules: dict[str, tuple[ModuleType, str, object]] = {
        "nothing left out": (tiles, "HALO", tiles.HALO),
        "added outside of the prism, too": (rules_of, "BEYOND", np.inf),
        "surface not looked for across it": (tiles, "surface", across_most),
        "how much is missing not asked": (rules_of, "MAX_SHIFT", 1.0),
        "colours of the network alone": (inpainting, "CONTINUED_REACH", 1e-9),
    }
    print(f"| | {' | '.join(f'{place}: ChD | SSIM' for place in measured)} |\n|---|{'---|---|' * len(measured)}")
    for name, (module, constant, value) in rules.items():
        usual = getattr(module, constant)
        setattr(module, constant, value)
        completer = rules_of.VoxelUNetCompleter()
        cells = []
        for made in measured.values():
            cells += [" / ".join(f"{ratio:.2f}" for ratio in ratios(completer, made))]
            cells += [" / ".join(f"{value:.2f}" for value in ssim(completer, made))]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
        setattr(module, constant, usual)


def study_training(arguments: argparse.Namespace, measured: dict[str, dict[float, list[tuple[Case, float]]]]) -> None:
    """The table of what is trained with something left out or changed."""
    pairs = [PairStream(seed=2)[index] for index in HELD_OUT]
    print(f"| | steps | entropy | {' | '.join(measured)} |\n|---|---|---|{'---|' * len(measured)}")
    for name in arguments.only:
        variant = VARIANTS[name]
        steps = arguments.steps if variant.fresh else arguments.more
        trainee = VoxelUNetTrainee(variant.widths, variant.voxel_spacings)
        network = trained(variant, trainee, arguments.out / name.replace(" ", "_"), steps)
        completer = trainee.completer(network)
        cells = [" / ".join(f"{ratio:.2f}" for ratio in ratios(completer, made)) for made in measured.values()]
        print(f"| {name} | {steps} | {entropy(trainee, network, pairs):.2f} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="real scans, to be measured on")
    studies = parser.add_subparsers(dest="study", required=True)
    studies.add_parser("rules")
    training = studies.add_parser("training")
    training.add_argument("out", type=Path)
    training.add_argument("--more", type=int, default=120, help="steps from the weights in the package")
    training.add_argument("--steps", type=int, default=300, help="steps from nothing")
    training.add_argument("--only", nargs="*", default=list(VARIANTS), choices=list(VARIANTS))
    arguments = parser.parse_args()
    places = {"generated rooms": generated()}
    if arguments.study == "training":
        places["with natural gaps"] = with_gaps(generated())
    if arguments.folder is not None:
        places["real rooms"] = real(arguments.folder)
    measured = {place: cases(scenes) for place, scenes in places.items()}
    if arguments.study == "rules":
        study_rules(measured)
    else:
        study_training(arguments, measured)


if __name__ == "__main__":
    main()
