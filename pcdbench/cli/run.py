"""`pcdbench run`: completers on tasks over a data set, with a table at its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pcdbench.cli.results import Format, print_summary, print_together

if TYPE_CHECKING:
    from pcdbench.runner.jobs import CellExecutor, Limits
    from pcdbench.runner.plan import Plan, Request
    from pcdbench.runner.run import Run

STOPPED = "pcdbench: stopped; finished cells are stored, and the same command goes on from there"

Incompletenesses = Annotated[
    list[str] | None, typer.Option(help="Ways to take points away, separated by commas (unless given: holes).")
]
Levels = Annotated[list[str] | None, typer.Option(help="Shares of points taken away (unless given: 0.1,0.3,0.5).")]


def names(texts: Sequence[str]) -> list[str]:
    """The comma-separated names of an option, which may be given several times."""
    return [name.strip() for text in texts for name in text.split(",") if name.strip()]


def levels(texts: Sequence[str]) -> list[float]:
    """The comma-separated levels of an option, which may be given several times.

    Raises:
        PcdbenchError: for what is not a number.
    """
    from pcdbench.errors import PcdbenchError

    try:
        return [float(level) for level in names(texts)]
    except ValueError:
        raise PcdbenchError(f"--level {','.join(texts)!r} must be numbers between 0 and 1, like 0.1,0.3,0.5") from None


def run(
    suite: Annotated[Path | None, typer.Argument(help="A suite: a TOML file that says what to measure.")] = None,
    completer: Annotated[list[str] | None, typer.Option(help="Completers, separated by commas, or all.")] = None,
    task: Annotated[list[str] | None, typer.Option(help="Tasks, separated by commas, or all.")] = None,
    dataset: Annotated[str | None, typer.Option(help="A data set, NAME or NAME:PATH (unless given: indoor).")] = None,
    split: Annotated[str | None, typer.Option(help="A split of the data set (unless given: its default).")] = None,
    incompleteness: Incompletenesses = None,
    level: Levels = None,
    seed: Annotated[int | None, typer.Option(help="Decides every random draw (unless given: 0).")] = None,
    jobs: Annotated[int | None, typer.Option(help="Worker processes (unless given: one for each core).")] = None,
    timeout: Annotated[float, typer.Option(help="Seconds for a step: making a case, completing, a task.")] = 600.0,
    memory_limit: Annotated[float | None, typer.Option(help="GB a worker may hold (unless given: no limit).")] = None,
    retries: Annotated[int, typer.Option(help="How often a step is tried again when its worker died.")] = 1,
    executor: Annotated[Literal["local", "dask"], typer.Option(help="Where cells run.")] = "local",
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler (unless given: workers are started here).")
    ] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="NAME.KEY=VALUE: an option of a plugin (see pcdbench show NAME).")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The run's folder (unless given: one of its own in runs/).")] = None,
    format: Annotated[Format, typer.Option(help="How to print the summary.")] = "table",
    figures: Annotated[bool, typer.Option("--figures", help="Also write the figures that the tasks draw.")] = False,
) -> None:
    """Run completers and tasks over a data set, and print a summary.

    The reference completers are added to every run. The same command takes an interrupted run up again and
    does only what is missing.
    """
    from pcdbench.errors import PcdbenchError
    from pcdbench.runner.jobs import Limits
    from pcdbench.runner.plan import plan
    from pcdbench.runner.run import carry_out

    limits = Limits(timeout, memory_limit, retries)
    asked = requests_of(suite, completer, task, dataset, split, incompleteness, level, seed, option or ())
    plans = [plan(request) for request in asked]
    for line in _left_out({name: reason for planned in plans for name, reason in planned.left_out.items()}):
        typer.echo(f"pcdbench: {line}", err=True)
    failed, measured, reasons = 0, False, []
    untold: dict[Path, Sequence[Mapping[str, Any]]] = {}  # programs are given one document
    with _place_for_cells(executor, scheduler, jobs, limits) as place:
        for number, planned in enumerate(plans, start=1):
            folder = out if out is None or len(plans) == 1 else out / str(number)
            try:
                ended = carry_out(planned, folder, place)
            except KeyboardInterrupt:
                typer.echo(STOPPED, err=True)
                raise typer.Exit(130) from None
            failed += len(ended.failed)
            measured |= any(row["status"] == "ok" for row in ended.rows)
            if not measured:
                reasons += [row["error"] for row in ended.rows if row["status"] == "skipped"]
            if format in ("json", "csv") and len(plans) > 1:
                untold[ended.folder] = ended.rows
            else:
                print_summary(ended.rows, ended.folder, format)
            _tell(planned, ended, figures)
    if untold:
        print_together(untold, "json" if format == "json" else "csv")
    if failed:
        typer.echo(f"pcdbench: {failed} rows failed; the same command tries them again", err=True)
        raise typer.Exit(3)
    if not measured:
        raise PcdbenchError(f"nothing was measured: all {len(reasons)} rows were skipped, the first as {reasons[0]}")


def _left_out(reasons: Mapping[str, str]) -> list[str]:
    """What `all` leaves out, a line each; completers without weights are one line together."""
    from pcdbench.plugins import registry

    untrained = [its.name for its in registry().all("completer") if its.lacks_weights and its.name in reasons]
    lines = [f"{name} is left out: {reason}" for name, reason in reasons.items() if name not in untrained]
    if untrained:
        lines.append(
            f"left out, for want of weights: {', '.join(untrained)} (pcdbench train makes some, "
            "--option NAME.weights=FILE gives them)"
        )
    return lines


def _place_for_cells(
    executor: str, scheduler: str | None, jobs: int | None, limits: Limits
) -> AbstractContextManager[CellExecutor]:
    """Where cells run while its `with` block lasts."""
    from pcdbench.errors import PcdbenchError
    from pcdbench.runner.run import local_processes

    if executor == "local":
        if scheduler is not None:
            raise PcdbenchError("--scheduler needs --executor dask")
        return nullcontext(local_processes(jobs, limits))
    from pcdbench.runner.cluster import dask_cluster

    if scheduler is not None and jobs is not None:
        raise PcdbenchError("--jobs does not go with --scheduler: the cluster has the workers that it has")
    return dask_cluster(scheduler, jobs, limits)


def requests_of(
    suite: Path | None,
    completer: Sequence[str] | None,
    task: Sequence[str] | None,
    dataset: str | None,
    split: str | None,
    incompleteness: Sequence[str] | None,
    level: Sequence[str] | None,
    seed: int | None,
    options: Sequence[str],
) -> list[Request]:
    """What was asked for, by a suite or by options."""
    from pcdbench.errors import PcdbenchError
    from pcdbench.runner.plan import Request
    from pcdbench.suite import read_suite, requests

    given: dict[str, Any] = {"--completer": completer, "--task": task, "--split": split, "--level": level}
    given |= {"--incompleteness": incompleteness, "--seed": seed, "--option": options or None}
    if suite is not None:
        for name, value in given.items():
            if value is not None:
                raise PcdbenchError(
                    f"{name} is what the suite {suite} says; leave it out, or change a copy of the file"
                )
        return requests(read_suite(suite), suite.parent, dataset=dataset)
    if completer is None or task is None:
        raise PcdbenchError("name a --completer and a --task (or all), or give the file of a suite")
    request = Request(completers=names(completer), tasks=names(task), split=split, options=options)
    if dataset is not None:
        request = replace(request, dataset=dataset)
    if incompleteness is not None:
        request = replace(request, incompletenesses=names(incompleteness))
    if level is not None:
        request = replace(request, levels=levels(level))
    return [request if seed is None else replace(request, seed=seed)]


def _tell(planned: Plan, ended: Run, figures: bool) -> None:
    """Say where a run's rows are, and draw one case of it."""
    from pcdbench.leaderboard.figures import write_case_picture, write_task_figures

    typer.echo(f"rows: {ended.folder / 'rows.jsonl'}", err=True)
    try:
        picture = write_case_picture(planned, ended.rows, ended.folder)
    except OSError as error:
        typer.echo(f"pcdbench: the case side by side cannot be written ({error})", err=True)
    else:
        if picture is not None:
            typer.echo(f"one case side by side: {picture}", err=True)
    if figures:
        written, problems = write_task_figures(planned, ended.rows, ended.folder / "figures")
        for problem in problems:
            typer.echo(f"pcdbench: {problem}", err=True)
        typer.echo(f"figures: {len(written)} in {ended.folder / 'figures'}", err=True)
