"""Task `tagging`: are the tagged objects still there? Six-face similarity of the region of each object's box."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from pcdbench import options
from pcdbench.case import Case
from pcdbench.cloud import PointCloud
from pcdbench.errors import Skipped
from pcdbench.geometry.projection import six_face_similarity
from pcdbench.geometry.voxels import MAX_VOXELS_A_SIDE, VoxelGrid, edge_from_density, voxelize
from pcdbench.scene import Box
from pcdbench.task import Measurements, Metric, Task

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Tagging(Task):
    """Each tagged object, found or not, by how it looks from its box's six sides (docs/tasks/tagging.md)."""

    class Options(options.Options):
        voxel_spacings: float = Field(
            6.0, gt=0, description="voxel edge, in median nearest-neighbour distances of the complete cloud"
        )
        found_above: float = Field(0.9, gt=0, lt=1, description="SSIM above which an object counts as found")
        margin_m: float = Field(
            0.05, ge=0, description="how far the region reaches beyond the box on each side, metres"
        )
        min_points: int = Field(
            30,
            ge=1,
            description="objects of fewer points in the complete cloud are left out: even the truth hides them",
        )

    options: Options
    needs_color = True
    metrics = (
        Metric(
            "failure_rate", "share of objects", "lower", "share of objects whose SSIM is not above found_above", "mean"
        ),
        Metric(
            "object_ssim", "SSIM, at most 1", "higher", "mean SSIM of the object's region from six sides of its box"
        ),
    )

    def evaluate(self, case: Case, completed: PointCloud, rng: np.random.Generator) -> Measurements:
        """One sample an object, labelled; nothing is random."""
        complete = case.scene.complete
        if not case.scene.objects:
            raise Skipped("no tagged objects")
        if complete.colors is None or completed.colors is None:
            raise Skipped("tagging compares colours, and the cloud has none")
        edge_m = edge_from_density(complete.points, self.options.voxel_spacings)
        if not edge_m > 0:
            raise Skipped("the complete cloud has no two distinct points, so no resolution to look at it")
        labels, similarities = [], []
        for tagged in case.scene.objects:
            truth = _region(complete, tagged.box, self.options.margin_m)
            if len(truth) < self.options.min_points:
                continue
            answer = _region(completed, tagged.box, self.options.margin_m)
            labels.append(tagged.label)
            similarities.append(_similarity(answer, truth, tagged.box, self.options.margin_m, edge_m))
        if not labels:
            raise Skipped(f"no tagged object has {self.options.min_points} points in the complete cloud")
        failures = [float(similarity <= self.options.found_above) for similarity in similarities]
        return Measurements(
            {"failure_rate": failures, "object_ssim": similarities},
            labels={"failure_rate": labels, "object_ssim": labels},
        )

    def figures(self, rows: pd.DataFrame) -> Mapping[str, Figure]:
        """The failure rate by label, one figure a level, completers side by side."""
        from matplotlib.figure import Figure

        from .pose_figures import missing_text

        flat = rows.assign(
            label=[labels["failure_rate"] for labels in rows["labels"]],
            failed=[samples["failure_rate"] for samples in rows["samples"]],
        ).explode(["label", "failed"])
        flat["failed"] = flat["failed"].astype(float)
        figures = {}
        for level, at_level in flat.groupby("level"):
            rates = at_level.pivot_table(index="label", columns="completer", values="failed", aggfunc="mean")
            figure = Figure(figsize=(7.0, 1.5 + 0.18 * rates.size), layout="constrained")
            axes = figure.subplots()
            rates.plot.barh(ax=axes, width=0.8)
            for label in axes.get_yticklabels():
                label.set_parse_math(False)  # a label may hold dollar signs
            axes.set(xlim=(0, 1), xlabel="failure rate (share of objects)", ylabel="")
            axes.set_title(f"tagging by label, {missing_text(level, rows[rows.level == level])}")
            axes.invert_yaxis()
            figures[f"failure_rate_by_label_{100 * level:.12g}_percent"] = figure
        return figures


def _region(cloud: PointCloud, box: Box, margin_m: float) -> PointCloud:
    """The points of `cloud` within `margin_m` of the box, in the box's own frame."""
    inside = cloud.select(box.contains(cloud.points, margin_m))
    return PointCloud(box.to_local(inside.points), inside.colors)


def _similarity(answer: PointCloud, truth: PointCloud, box: Box, margin_m: float, edge_m: float) -> float:
    """Six-face SSIM of two coloured regions in the frame of `box`, 1 where they look alike."""
    half = np.asarray(box.size) / 2 + margin_m
    # A box larger than its scene: images of more pixels would show nothing and cost gigabytes.
    grid = VoxelGrid.covering(-half, half, max(edge_m, 2 * half.max() / MAX_VOXELS_A_SIDE))
    assert answer.colors is not None and truth.colors is not None
    return six_face_similarity(voxelize(answer.points, answer.colors, grid), voxelize(truth.points, truth.colors, grid))
