"""A publication's experiments carried out: a run each, with weights of its own where it needs them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pcdbench.errors import PcdbenchError
from pcdbench.paper.publication import Experiment, Publication
from pcdbench.plugins import registry
from pcdbench.runner.jobs import CellExecutor
from pcdbench.runner.plan import Plan, plan
from pcdbench.runner.rows import Row
from pcdbench.runner.run import carry_out
from pcdbench.runner.store import RunStore, read_rows, read_run
from pcdbench.suite import requests

if TYPE_CHECKING:
    from pcdbench.training.loop import Budget


@dataclass(frozen=True)
class Place:
    """Where experiments are carried out, and with what.

    Attributes:
        out: receives a run's folder for each experiment, in `runs/`, and what is trained, in `trained/`.
        dataset: `NAME` or `NAME:PATH`; split: None for its default.
        weights: holds `NAME/weights.safetensors` for each experiment with weights of its own; None for none.
        budget: how long to train those that are not there; None leaves their experiments out.
        taken_from: runs whose rows count where they are of the same cells, tasks and code.
        report: takes a line now and then.
    """

    out: Path
    dataset: str
    split: str | None
    weights: Path | None
    budget: Budget | None
    taken_from: Sequence[Path]
    executor: CellExecutor
    report: Callable[[str], None]


@dataclass(frozen=True)
class Outcome:
    """What became of an experiment: its rows, or why there are none.

    Attributes:
        planned: None where it could not be planned.
        trained: of weights of its own, what their model card says.
    """

    planned: Plan | None
    rows: Sequence[Row]
    left_out: str = ""
    trained: Mapping[str, Any] | None = None


def outcomes(publication: Publication, place: Place) -> dict[str, Outcome]:
    """Carry out the experiments, in their order; what is there already is not done again.

    Raises:
        PcdbenchError: where none of them measured anything.
    """
    found = {}
    for name, experiment in publication.runs.items():
        place.report(f"{name}")
        found[name] = _outcome(name, experiment, place)
        if found[name].left_out:
            place.report(f"{name} is left out: {found[name].left_out}")
    if not any(row["status"] == "ok" for its in found.values() for row in its.rows):
        reasons = [its.left_out or next((row["error"] for row in its.rows), "") for its in found.values()]
        raise PcdbenchError(f"nothing was measured, so there is no page: {next(iter(reasons), 'it has no runs')}")
    return found


def _outcome(name: str, experiment: Experiment, place: Place) -> Outcome:
    own, card = [], None
    try:
        if experiment.trained:
            weights, card = _weights(experiment, place)
            own = [f"{experiment.completers[0].name}.weights={weights}"]
        planned = _planned(experiment, own, place)
    except PcdbenchError as error:
        return Outcome(None, [], str(error))
    folder = place.out / "runs" / name
    _take(planned, folder, place)
    return Outcome(planned, carry_out(planned, folder, place.executor).rows, trained=card)


def _planned(experiment: Experiment, options: Sequence[str], place: Place) -> Plan:
    """The plan of an experiment; the options of its data set count where the data set has them."""
    dataset = place.dataset.partition(":")[0]
    known = registry().get("dataset", dataset).load().Options.model_fields
    for option in experiment.dataset_options:
        if option not in known:
            raise PcdbenchError(f"the data set {dataset} has no option {option}")
    asked = requests(experiment, Path(), dataset=place.dataset)
    if len(asked) != 1:
        raise PcdbenchError("it names a completer twice, or several seeds; make it two runs")
    given = [f"{dataset}.{key}={value}" for key, value in experiment.dataset_options.items()]
    return plan(replace(asked[0], split=place.split, options=[*asked[0].options, *given, *options]))


def _weights(experiment: Experiment, place: Place) -> tuple[Path, Mapping[str, Any] | None]:
    """The weights of an experiment that has its own, trained where they are not there; and their model card.

    Raises:
        PcdbenchError: where they are not there and not to be trained.
    """
    from pcdbench.weights import model_card

    folders = [place.out / "trained", *([place.weights] if place.weights else [])]
    for folder in folders:
        path = folder / experiment.trained / "weights.safetensors"
        card = model_card(path)
        if path.is_file() and (card is not None or folder != folders[0]):
            return path.resolve(), card
    if place.budget is None:
        raise PcdbenchError(
            f"it needs weights of its own: give --weights FOLDER with {experiment.trained}/weights.safetensors, or "
            "--train-steps or --train-hours"
        )
    return _trained(experiment, place.out / "trained" / experiment.trained, place)


def _trained(experiment: Experiment, out: Path, place: Place) -> tuple[Path, Mapping[str, Any]]:
    from pcdbench.training.card import write_card
    from pcdbench.training.loop import train
    from pcdbench.training.stream import PairStream
    from pcdbench.training.trainee import load_trainee
    from pcdbench.training.validation import Validation

    entry = experiment.completers[0]
    completer = registry().get("completer", entry.name).load()
    if completer.trainee is None:
        raise PcdbenchError(f"{entry.name} learns nothing, so there is nothing to train")
    options = completer.Options.model_validate(entry.options)
    trainee = load_trainee(entry.name, completer.trainee, options)
    stream, preset = PairStream(), trainee.presets["default"]
    place.report(f"training {experiment.trained}")
    assert place.budget is not None
    progress = train(
        trainee,
        out,
        place.budget,
        preset=preset,
        stream=stream,
        resume=True,
        name=entry.name,
        options=options,
        validate=Validation(),
        report=lambda line: place.report(f"{experiment.trained}: {line}"),
    )
    path = (out / "weights.safetensors").resolve()
    return path, write_card(path, entry.name, stream, preset, progress)


def _take(planned: Plan, folder: Path, place: Place) -> None:
    """Put rows of other runs into the folder, where they are those that the plan would give."""
    if not place.taken_from:
        return
    wanted = {cell.row_key(task) for cell in planned.cells for task in planned.tasks}
    with RunStore(folder, planned.configuration, {"taken_from": [str(run) for run in place.taken_from]}) as store:
        wanted -= store.rows().finished_keys
        for run in place.taken_from:
            theirs = read_run(run)["configuration"]
            if theirs["dataset"].get("code") != planned.configuration["dataset"]["code"]:
                continue
            different = _other_code(theirs, planned.configuration)
            taken = [
                row
                for row in read_rows(run)
                if row["key"] in wanted
                and row["status"] in ("ok", "skipped")
                and not different & {row["completer"]["name"], row["task"]["name"], row["incompleteness"]["name"]}
            ]
            store.append(taken)
            wanted -= {row["key"] for row in taken}
            if taken:
                place.report(f"{len(taken)} rows are taken from {run}")


def _other_code(theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> set[str]:
    """Names of completers, tasks and incompletenesses whose code is another one in the two configurations."""
    kinds = ("completers", "tasks", "incompletenesses")
    code = {(kind, its["name"]): its["code"] for kind in kinds for its in theirs.get(kind, ())}
    return {
        its["name"] for kind in kinds for its in ours[kind] if code.get((kind, its["name"]), its["code"]) != its["code"]
    }
