"""Which test scenes a completer was trained on, by what its model card says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from typing import Any

from pcdbench.errors import PcdbenchError
from pcdbench.leaderboard.board import BoardData
from pcdbench.runner.selection import select_recorded


def seen_in_training(card: Mapping[str, Any] | None, boards_data: Iterable[BoardData]) -> str:
    """What of the board's data a completer was trained on, for people; empty where nothing, or nothing is known.

    Args:
        card: a model card (see `pcdbench.Completer.model_card`). Its `trained_on` lists what was seen, each a
            `dataset` with a `split`, with `scenes` (names of scenes, or of environments, which begin the names
            of theirs), or with neither: all of it.
    """
    told = []
    for data in boards_data:
        seen: set[str] = set()
        for entry in (card or {}).get("trained_on", ()):
            if entry["dataset"] == data.dataset:
                seen |= _seen(entry, data)
        if seen:
            told.append(f"{len(seen)} of {len(data.scenes)} scenes of {data.dataset} {data.split}")
    return ", ".join(told)


def _seen(entry: Mapping[str, Any], data: BoardData) -> set[str]:
    scenes = set(data.scenes)
    if entry.get("scenes"):
        return {scene for scene in scenes if any(_is_of(scene, name) for name in entry["scenes"])}
    if not entry.get("split") or entry["split"] == data.split:
        return scenes
    return scenes & _scenes_of_split(data.dataset, data.options, entry["split"])


def _is_of(scene: str, name: str) -> bool:
    return scene == name or scene.startswith((f"{name}_", f"{name}-", f"{name}/"))


def _scenes_of_split(dataset: str, options: Mapping[str, Any], split: str) -> Set[str]:
    """The scenes of another split, which may share some with the board's; none where they cannot be listed."""
    try:
        return frozenset(select_recorded("dataset", dataset, options).build().scene_names(split))
    except PcdbenchError:
        return frozenset()
