"""A suite: an experiment as a TOML file, which `pcdbench run` carries out and a leaderboard is made of."""

from __future__ import annotations

import os
import re
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from pcdbench.downloads import is_address
from pcdbench.errors import PcdbenchError, problem_text
from pcdbench.plugins import did_you_mean
from pcdbench.runner.plan import ALL, DEFAULT_LEVELS, Request

_Level = Annotated[float, Field(gt=0, lt=1)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Entry(_Table):
    """A plugin of a suite: its name alone, or a table with its options."""

    name: str
    options: dict[str, bool | int | float | str | list[int | float | str]] = {}

    @model_validator(mode="after")
    def _of_one(self) -> Self:
        if self.options and self.name == ALL:
            raise ValueError("options need the name of one plugin")
        return self


class DatasetEntry(Entry):
    """The suite's data set; `path` is relative to the suite's file and may hold environment variables.

    Its name may be `NAME:PATH`, too.
    """

    path: str | None = None


class Check(_Table):
    """What `pcdbench leaderboard check` repeats of the board; what is left out is repeated as the suite has it."""

    scenes: list[str] = []
    levels: list[_Level] = []
    incompletenesses: list[str] = []
    tasks: list[str] = []
    completers: list[str] = []


def _as_entry(value: Any) -> Any:
    return {"name": value} if isinstance(value, str) else value


def _as_dataset(value: Any) -> Any:
    entry = _as_entry(value)
    if not (isinstance(entry, dict) and isinstance(entry.get("name"), str) and ":" in entry["name"]):
        return entry
    if "path" in entry:
        raise ValueError("its path must be there once")
    name, _, path = entry["name"].partition(":")
    return entry | {"name": name, "path": path}


def _require_options_once(entries: list[Entry]) -> list[Entry]:
    times = Counter(entry.name for entry in entries)
    for entry in entries:
        if entry.options and times[entry.name] > 1:
            raise ValueError("one with options must be there once")
    return entries


_Entry = Annotated[Entry, BeforeValidator(_as_entry)]
_Entries = Annotated[list[_Entry], AfterValidator(_require_options_once)]


class Suite(_Table):
    """What a suite's file holds.

    Attributes:
        completers, tasks, incompletenesses: names, `all`, or tables with options. A completer that is there twice,
            with other options, is run twice.
        seeds: each gives cases of its own.
        references: whether the reference completers are added.
    """

    dataset: Annotated[DatasetEntry, BeforeValidator(_as_dataset)] = DatasetEntry(name="indoor")
    split: str | None = None
    incompletenesses: _Entries = [Entry(name="holes")]
    levels: list[_Level] = Field(list(DEFAULT_LEVELS), min_length=1)
    seeds: list[Annotated[int, Field(ge=0)]] = Field([0], min_length=1)
    completers: list[_Entry] = Field(min_length=1)
    tasks: _Entries = Field(min_length=1)
    references: bool = True
    check: Check = Check()


def read_suite(path: Path) -> Suite:
    """The suite in a TOML file.

    Raises:
        PcdbenchError: naming the line, where there is one, and what is wrong with it.
    """
    text, content = read_toml(path, "suite")
    try:
        return Suite.model_validate(content)
    except ValidationError as error:
        raise PcdbenchError(_told(path, text, error)) from None


def read_toml(path: Path, what: str) -> tuple[str, dict[str, Any]]:
    """The text of a TOML file, and what it holds.

    Args:
        what: the file should be, for messages.

    Raises:
        PcdbenchError: where it cannot be read or is not TOML.
    """
    try:
        text = path.read_text(encoding="utf-8")
        return text, tomllib.loads(text)
    except (OSError, UnicodeDecodeError) as error:
        raise PcdbenchError(f"{path} cannot be read ({error}); give the file of a {what}") from None
    # A number of 5,000 digits is a ValueError of another kind than what else is wrong.
    except (ValueError, RecursionError) as error:
        raise PcdbenchError(f"{path} is not TOML: {error}") from None


def requests(suite: Suite, folder: Path, *, dataset: str | None = None) -> list[Request]:
    """What a suite asks for: a request a seed, and more where a completer is in it with several sets of options.

    Args:
        folder: of the suite's file.
        dataset: `NAME` or `NAME:PATH`, instead of the suite's.

    Raises:
        PcdbenchError: where the data set's path holds a variable that is not set, or its options are of another.
    """
    place = _dataset(suite.dataset, folder) if dataset is None else dataset
    name = place.partition(":")[0]
    if suite.dataset.options and name != suite.dataset.name:
        raise PcdbenchError(
            f"the suite has options of {suite.dataset.name}, which --dataset {name} has no use for; "
            f"give --dataset {suite.dataset.name}, or a suite without them"
        )
    common = [suite.dataset, *suite.incompletenesses, *suite.tasks]
    found = []
    for seed in dict.fromkeys(suite.seeds):
        for completers in _rounds(suite.completers):
            found.append(
                Request(
                    completers=[entry.name for entry in completers],
                    tasks=[entry.name for entry in suite.tasks],
                    dataset=place,
                    split=suite.split,
                    incompletenesses=[entry.name for entry in suite.incompletenesses],
                    levels=suite.levels,
                    seed=seed,
                    options=_options([*common, *completers]),
                    references=suite.references,
                )
            )
    return found


def _rounds(entries: Sequence[Entry]) -> list[list[Entry]]:
    """The entries, each once, such that no round names a completer twice; `all` is in the first alone."""
    rounds: list[list[Entry]] = []
    seen: Counter[str] = Counter()
    for number, entry in enumerate(entries):
        if entry in entries[:number]:
            continue
        if seen[entry.name] == len(rounds):
            rounds.append([])
        rounds[seen[entry.name]].append(entry)
        seen[entry.name] += 1
    return rounds


def _options(entries: Sequence[Entry]) -> list[str]:
    """The options of entries as `--option` takes them."""
    return [
        f"{entry.name}.{name}={','.join(map(str, value)) if isinstance(value, list) else value}"
        for entry in entries
        for name, value in entry.options.items()
    ]


def _dataset(entry: DatasetEntry, folder: Path) -> str:
    if not entry.path:
        return entry.name
    expanded = os.path.expandvars(entry.path)
    if "$" in expanded:
        raise PcdbenchError(
            f"the suite's data are at {entry.path}, and that is not set; set it, or give --dataset {entry.name}:PATH"
        )
    return f"{entry.name}:{expanded if is_address(expanded) else folder / Path(expanded).expanduser()}"


def _told(path: Path, text: str, error: ValidationError) -> str:
    """The first problem in one line."""
    problem = error.errors()[0]
    where = [part for part in problem["loc"] if not (isinstance(part, str) and part.startswith("function-"))]
    names = [part for part in where if isinstance(part, str)]
    line = _line(text, names, problem.get("input"))
    at = f"{path}, line {line}" if line else f"{path}"
    shown = ".".join(str(part) for part in where)
    if problem["type"] == "extra_forbidden":
        cure = did_you_mean(names[-1], _fields(names[:-1]))
        return f"{at}: a suite has no {shown!r}; {cure}"
    if problem["type"] == "missing":
        line = _line(text, names[:-1], None)
        return f"{path}{f', line {line}' if line else ''}: it has no {shown!r}; add it (see docs/leaderboards.md)"
    return f"{at}: {shown}: {problem_text(problem['msg'])}, not {problem['input']!r}"


def _fields(names: Sequence[str]) -> list[str]:
    """The keys that may stand where `names` lead."""
    tables: Mapping[str, type[BaseModel]] = {
        "dataset": DatasetEntry,
        "check": Check,
        "completers": Entry,
        "tasks": Entry,
        "incompletenesses": Entry,
    }
    return list((tables.get(names[0], Entry) if names else Suite).model_fields)


def _line(text: str, names: Sequence[str], value: Any) -> int | None:
    """The line of a key, as well as can be told: that of its table's own key, or the first that has it."""
    lines = text.splitlines()
    for name in reversed(names):
        key = re.compile(rf"(^|[\s{{,.\[\"']){re.escape(name)}[\"']?\s*(=|\]|\.)")
        found = [number for number, line in enumerate(lines, start=1) if key.search(line.partition("#")[0])]
        its = [number for number in found if str(value) in lines[number - 1]]
        if its or found:
            return (its or found)[0]
    return None
