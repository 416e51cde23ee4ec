"""How DeepPCD's geometry learns: the cloud as a whole and patch by patch, and plane points that are turned only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from pcdbench.options import Options
from pcdbench.training.chamfer import matched
from pcdbench.training.stream import TrainingPair
from pcdbench.training.trainee import Example, Preset, Trainee

from ..heading import laid_along_axes
from ..local_surface import unoriented_normals
from ..patch_truth import TRUTH_POINTS, distances_by_patch, evenly, true_patches
from ..patches import Patches
from .completer import DeepPCD, DeepPCDOptions
from .neighborhoods import Neighborhoods
from .network import GRID_SIDE, DeepPCDNetwork

SHARE_MOVED = 0.25  # of the plane points, drawn anew for each example: a quarter of the displacement's cost
PATCH_WEIGHT = 0.5
# Published is the weight of |I - R^T R|^2; the plane points' own distances and how far planes lean are not: Chamfer
# distances hardly turn a plane, since across a wall it is nearer to it the smaller it is, whichever way it leans.
TURN_WEIGHT = 0.001
PLANE_WEIGHT, FACE_WEIGHT = 0.5, 0.02
NEIGHBORHOODS = tuple(field.name for field in fields(Neighborhoods))
EPOCH = 1_200  # samples, as published


class DeepPCDTrainee(Trainee):
    """Chamfer distance of the cloud + 0.5 times that of its patches + 0.001 |I - R^T R|^2 for the generator's turns R,
    as published, + 0.5 times that of the plane points + 0.02 times how far planes lean out of the true surface.
    """

    presets: ClassVar[Mapping[str, Preset]] = {
        "default": Preset(learning_rate=1e-3, batch=2),
        "continued": Preset(learning_rate=4e-4, batch=2),  # weights that are good already are not undone first
        "published": Preset(
            learning_rate=3e-4,
            batch=2,
            schedule="plateau",
            weight_decay=0.0,
            steps=500 * EPOCH // 2,
            validate_every=20 * EPOCH // 2,
        ),
    }

    def __init__(self, options: DeepPCDOptions | None = None) -> None:
        """Train a network of these options; weights, colour and merging play no part."""
        self.options = DeepPCDOptions.model_validate({}) if options is None else options

    @classmethod
    def for_options(cls, options: Options) -> DeepPCDTrainee:
        assert isinstance(options, DeepPCDOptions)
        return cls(options)

    def network(self) -> nn.Module:
        return DeepPCDNetwork(self.options.plane_points, self.options.generator)

    def completer(self, network: nn.Module) -> DeepPCD:
        assert isinstance(network, DeepPCDNetwork)
        return DeepPCD(self.options.model_copy(update={"color": "nearest"}), network=network)

    def example(self, pair: TrainingPair, rng: np.random.Generator) -> Example:
        """The observed patches with their neighbourhoods, and the truth: `truth` (T, 3) of the whole cloud in the unit
        of the grid, `patch_truth` (U, 3) of the patches `patch_of` (U,), scaled as they are, and `normals`
        (P, S, 3) of the true surface nearest to the S points that planes are placed at.
        """
        pair = laid_along_axes(pair)
        observed = pair.complete.select(pair.kept)
        patches = Patches.of(observed.points, self.options.grid, rng)
        assert patches is not None  # the fullest of G x G cells holds a mean cell's points at least
        truth = pair.truth.points[evenly(pair.truth.points, TRUTH_POINTS, rng)]
        scaled = patches.grid.scaled(truth)
        patch_of, patch_truth = true_patches(patches, scaled)
        around = Neighborhoods.of(patches.points)
        rows = around.sampled_1[:, : self.options.plane_points // GRID_SIDE**2, None]
        seeds = np.take_along_axis(patches.points, rows, axis=1)
        normals = unoriented_normals(scaled, at=(patches.low[:, None] + patches.scale * seeds).reshape(-1, 3))
        moved = round(SHARE_MOVED * self.options.plane_points)
        chosen = rng.random((len(patches.points), self.options.plane_points)).argsort(axis=1)[:, :moved]
        return {
            "points": patches.points,
            **vars(around),
            "cells": patches.cells,
            "low": patches.low,
            "scale": np.asarray(patches.scale),
            "chosen": chosen,
            "truth": scaled.astype(np.float32),
            "patch_truth": patch_truth,
            "patch_of": patch_of,
            "normals": normals.reshape(seeds.shape).astype(np.float32),
        }

    def loss(self, network: nn.Module, example: dict[str, Tensor]) -> dict[str, Tensor]:
        around = tuple(example[name] for name in NEIGHBORHOODS)
        planes, patches, points, turns = network(
            example["points"], around, example["cells"], example["low"], example["scale"], example["chosen"]
        )
        there, back = (step.square().sum(dim=1) for step in matched(points, example["truth"]))
        # In the unit of the patches: in its own it would be a tenth of theirs, and what learns would keep to its patch,
        # where the truth of the neighbour counts for nothing.
        cloud = (there.mean() + back.mean()) / example["scale"] ** 2
        patch = _patch_chamfer(patches, example)
        loss = cloud + PATCH_WEIGHT * patch
        terms = {"cloud": cloud, "patch": patch}
        if turns is not None:
            terms["plane"] = _patch_chamfer(planes, example)
            loss = loss + PLANE_WEIGHT * terms["plane"]
            turned = turns.float()
            off = turned.transpose(-1, -2) @ turned - torch.eye(3, device=turned.device)
            terms["turn"] = off.square().sum(dim=(-1, -2)).mean()
            # A plane lies along the first two columns; how far it reaches along them is for the distances to say.
            normals = F.normalize(torch.linalg.cross(turned[..., 0], turned[..., 1]), dim=-1, eps=1e-6)
            terms["face"] = 1 - (normals * example["normals"]).sum(dim=-1).square().mean()
            loss = loss + TURN_WEIGHT * terms["turn"] + FACE_WEIGHT * terms["face"]
        return {"loss": loss, **terms}


def _patch_chamfer(points: Tensor, example: dict[str, Tensor]) -> Tensor:
    """The mean over patches of the Chamfer distance of (P, K, 3) points to the patches' truth."""
    to_truth, from_truth = distances_by_patch(points, example["patch_truth"], example["patch_of"], power=2)
    return (to_truth + from_truth).mean()
