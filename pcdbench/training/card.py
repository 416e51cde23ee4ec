"""The model card of trained weights: what made them, as JSON beside the file."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pcdbench.keys import file_digest
from pcdbench.runner.cards import seen_along
from pcdbench.runner.provenance import provenance
from pcdbench.runner.store import write_text
from pcdbench.training.curve import Curve
from pcdbench.training.loop import Progress
from pcdbench.training.stream import PairStream
from pcdbench.training.trainee import Preset
from pcdbench.weights import CARD_SUFFIX

CURVE_POINTS = 30
LICENSE = "Apache-2.0"


def write_card(weights: Path, name: str, stream: PairStream, preset: Preset, progress: Progress) -> dict[str, Any]:
    """Write the card of a weights file beside it and return it.

    Its keys: completer, sha256, bytes, license, trained_on (data set, version, split; then what the weights it
    began from were trained on), augmentation, seed, preset, options (of the completer, those that are not at their
    default), steps, pairs, hours, begun_from (what is known of the weights it began from), validation (with what it
    means), curve (step, hours, loss, validation), date, and what `run.json` says of code, packages and machine.
    """
    from accelerate import PartialState

    from pcdbench.datasets.synthetic import Indoor

    seen = {"dataset": "indoor", "version": Indoor.version, "split": "train"}
    card: dict[str, Any] = {
        "completer": name,
        "sha256": file_digest(weights),
        "bytes": weights.stat().st_size,
        "license": LICENSE,
        "trained_on": seen_along({"trained_on": [seen], "begun_from": progress.begun_from}, str(weights)),
        "augmentation": asdict(stream.recipe),
        "seed": stream.seed,
        "preset": asdict(preset),
        "options": progress.options or {},
        "steps": progress.step,
        "pairs": progress.step * preset.batch * PartialState().num_processes,
        "hours": round(progress.seconds / 3600, 3),
        "begun_from": progress.begun_from,
        "validation": {
            "chd_ratio": progress.validation,
            "meaning": "median ChD over that of doing nothing, rooms of indoor's split val, holes, 30 %",
        },
        "curve": _curve(weights.parent),
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
        **provenance(),
    }
    write_text(weights.with_suffix(CARD_SUFFIX), json.dumps(card, indent=2) + "\n")
    return card


def _curve(folder: Path) -> list[dict[str, float | None]]:
    """The training curve at a few steps."""
    table = Curve(folder).table()
    lines = np.linspace(0, len(table) - 1, min(CURVE_POINTS, len(table))).round().astype(int)
    return [
        {
            "step": int(line["step"]),
            "hours": round(line["seconds"] / 3600, 3),
            "loss": _rounded(line["loss"], 5),
            "validation": _rounded(line["validation_chd"], 4),
        }
        for _, line in table.iloc[lines].iterrows()
    ]


def _rounded(value: float, digits: int) -> float | None:
    """None where it is not finite, which JSON has no word for."""
    return round(value, digits) if np.isfinite(value) else None
