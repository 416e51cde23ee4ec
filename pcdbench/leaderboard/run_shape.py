"""What runs must say of their plugins and of themselves for a board to be made of them: they may be a stranger's."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError

from pcdbench.errors import PcdbenchError, first_problem
from pcdbench.keys import canonical_json
from pcdbench.runner.cards import CardShape

_KEY = re.compile(r"[0-9a-f]{16,64}")
_LARGEST_DRAW = 65_535  # pages count draws in two bytes
_Number = Annotated[float, Field(ge=0, le=1e300)]
_Text = Annotated[str, Field(min_length=1)]


class _Plugin(BaseModel):
    name: _Text
    version: _Text
    options: dict[str, Any]


class _Data(_Plugin):
    digest: _Text


class _Completer(_Plugin):
    weights: str | None
    card: CardShape | None = None
    code: str | None = None
    reference: bool = False


class _Named(BaseModel):
    name: _Text


class _Configuration(BaseModel):
    split: _Text
    dataset: _Named | None = None
    seed: int = 0
    completers: list[_Completer] = []


class _Circumstances(BaseModel):
    time: str | None = None
    calibration_seconds: _Number | None = None
    machine: dict[str, Any] = {}
    git: dict[str, Any] | None = None


class _Facts(_Circumstances):
    configuration: _Configuration
    dataset_path: str | None = None
    elsewhere: dict[str, _Circumstances] = {}


_PLUGINS: Mapping[str, type[_Plugin]] = {
    "dataset": _Data,
    "incompleteness": _Plugin,
    "completer": _Completer,
    "task": _Plugin,
}


def require_sound_facts(facts: Mapping[str, Any], path: Path) -> None:
    """Refuse a `run.json` that lacks what boards say of a run, or holds another kind of value there.

    Raises:
        PcdbenchError: naming the file and the first thing that is wrong.
    """
    _require(_Facts, facts, f"{path}")


def require_sound_keys(row: Mapping[str, Any], path: Path) -> None:
    """Refuse a row whose keys or draw are none.

    Raises:
        PcdbenchError: naming the file.
    """
    keys = _KEY.fullmatch(row["key"]) and _KEY.fullmatch(row["cell"])
    if not (keys and 0 <= row["draw"] <= _LARGEST_DRAW):
        raise PcdbenchError(f"{path}: the key, cell or draw of a row is none (key {row['key'][:16]!r}); run it again")


def require_sound_plugin(kind: str, plugin: Any, path: Path) -> None:
    """Refuse what a row says of its `dataset`, `incompleteness`, `completer` or `task` unless boards can use it.

    Raises:
        PcdbenchError: naming the file and the first thing that is wrong.
    """
    _require(_PLUGINS[kind], plugin, f"{path}: the {kind} of a row")


def _require(model: type[BaseModel], value: Any, what: str) -> None:
    try:
        model.model_validate(value)
        canonical_json(value).encode()
    except ValidationError as error:
        raise PcdbenchError(f"{what} is not as runs have it ({first_problem(error)}); run it again") from None
    except ValueError as error:
        raise PcdbenchError(f"{what} holds what JSON cannot say ({error}); run it again") from None
