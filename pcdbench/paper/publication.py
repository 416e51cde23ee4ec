"""What a publication's file says: the runs its experiments need, its tables and figures, its published numbers."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from pcdbench.errors import PcdbenchError, first_problem
from pcdbench.paper.names import require_known_names
from pcdbench.plugins import registry
from pcdbench.runner.plan import ALL
from pcdbench.suite import Suite, read_toml

FILE = "publication.toml"
COSTS = ("seconds", "memory_mb", "parameters_mb")

# TOML arrays hold a gap as "", where a publication has no number.
_Published = Annotated[float, BeforeValidator(lambda value: math.nan if value == "" else value)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Experiment(Suite):
    """A suite on whatever data set the page is made of.

    Attributes:
        dataset_options: of the data set, where it has options of these names.
        trained: the name of weights that were trained for this experiment alone, with the options of its one
            completer; empty where the weights in the package do.
    """

    dataset_options: dict[str, int | float | str | bool] = Field({})
    trained: str = ""
    references: bool = False


class Column(_Table):
    """A number of each row of a table.

    Attributes:
        task: empty for what completing costs: then `metric` is one of `COSTS`.
        factor: what numbers are multiplied by, as in "x 1e-4".
    """

    heading: str
    task: str = ""
    metric: str
    statistic: Literal["median", "p90", "mean"] = "median"
    factor: float = 1.0


class Row(_Table):
    """A row of a table: where its numbers are found, and those that were published, a column each."""

    heading: str
    run: str
    completer: str
    level: float
    published: list[_Published] = []


class Distribution(_Table):
    """Cumulative distributions of a task's main metric, a panel a level.

    Attributes:
        completers: those to show; all of the run where there are none.
    """

    kind: Literal["distribution"]
    run: str
    task: str
    levels: list[float]
    completers: list[str] = []


class CurvePoint(_Table):
    """A point of a curve: the run that it is from, and the published value."""

    at: float
    run: str
    published: _Published = math.nan


class ShownCurve(_Table):
    """A statistic against what was varied."""

    kind: Literal["curve"]
    label: str
    completer: str
    level: float
    column: Column
    points: list[CurvePoint]


class PublishedBar(_Table):
    """A published value of a bar."""

    completer: str
    level: float
    value: float


class Bars(_Table):
    """A statistic by completer and level."""

    kind: Literal["bars"]
    run: str
    levels: list[float]
    completers: list[str]
    column: Column
    published: list[PublishedBar] = []


Drawn = Annotated[Distribution | ShownCurve | Bars, Field(discriminator="kind")]


class Part(_Table):
    """A table or a figure of the publication.

    Attributes:
        number: what the publication calls it: "Table 8".
        differs: what differs from the publication in this part alone, and why.
    """

    number: str
    title: str
    differs: str = ""
    columns: list[Column] = []
    rows: list[Row] = []
    figure: Drawn | None = None

    @property
    def runs(self) -> list[str]:
        """The runs it is made of, each once."""
        named = [row.run for row in self.rows]
        if isinstance(self.figure, ShownCurve):
            named += [point.run for point in self.figure.points]
        elif self.figure is not None:
            named.append(self.figure.run)
        return list(dict.fromkeys(named))


class Publication(_Table):
    """A publication: what it is, how our repetition differs, its experiments, its tables and figures.

    Attributes:
        differs: by topic (data, protocol, compute), what differs throughout.
        runs: experiments by name.
    """

    title: str
    venue: str
    differs: dict[str, str]
    runs: dict[str, Experiment]
    parts: list[Part]


def read_publication(place: str) -> Publication:
    """The publication in a TOML file, or that of a completer which has one in its package.

    Args:
        place: a path ending in `.toml`, or a completer's name.

    Raises:
        PcdbenchError: naming the file and what is wrong with it.
    """
    path = Path(place) if place.endswith(".toml") else _of_completer(place)
    try:
        publication = Publication.model_validate(read_toml(path, "publication")[1])
    except ValidationError as error:
        raise PcdbenchError(f"{path}: {first_problem(error)}") from None
    _require_sound(publication, path)
    require_known_names(publication, path)
    return publication


def where_publications_are() -> str:
    """What may be given as a publication, for messages: the completers that have one, or a file."""
    names = []
    for its in registry().all("completer"):
        # A package that cannot be imported is told by those who need it.
        with contextlib.suppress(Exception):
            if _beside(its.target.partition(":")[0]):
                names.append(its.name)
    return " or ".join(filter(None, [f"a completer that has one ({', '.join(names)})" if names else "", f"a {FILE}"]))


def _of_completer(name: str) -> Path:
    found = _beside(registry().get("completer", name).load().__module__)
    if found is None:
        raise PcdbenchError(f"{name} has no {FILE} in its package; give {where_publications_are()}")
    return found


def _beside(module: str) -> Path | None:
    """The publication in the package that a module is in."""
    package = module.rpartition(".")[0]
    path = Path(str(resources.files(package) / FILE)) if package else None
    return path if path is not None and path.is_file() else None


def _require_sound(publication: Publication, path: Path) -> None:
    for part in publication.parts:
        for run in part.runs:
            if run not in publication.runs:
                raise PcdbenchError(f"{path}: {part.number} is made of the run {run!r}, which is not there; add it")
        for row in part.rows:
            if row.published and len(row.published) != len(part.columns):
                raise PcdbenchError(
                    f"{path}: {part.number}, {row.heading}: {len(row.published)} published numbers for "
                    f'{len(part.columns)} columns; give one for each, or ""'
                )
        for column in _columns(part):
            if not column.task and column.metric not in COSTS:
                raise PcdbenchError(f"{path}: {part.number}: {column.heading} has no task; name one, or one of {COSTS}")
    for name, experiment in publication.runs.items():
        given_elsewhere = experiment.model_fields_set & {"dataset", "split", "check"}
        if given_elsewhere:
            raise PcdbenchError(f"{path}: the run {name} says {min(given_elsewhere)}, which the command line does")
        if experiment.trained and len(experiment.completers) != 1:
            raise PcdbenchError(f"{path}: the run {name} has weights of its own and so needs one completer")
        # Rows and figures name a run and a level, which must be one number.
        if [entry.name != ALL for entry in experiment.incompletenesses] != [True]:
            raise PcdbenchError(f"{path}: the run {name} needs one incompleteness; make it a run for each")


def _columns(part: Part) -> Sequence[Column]:
    own = [part.figure.column] if isinstance(part.figure, ShownCurve | Bars) else []
    return [*part.columns, *own]
