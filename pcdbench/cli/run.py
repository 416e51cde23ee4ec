"""`pcdbench run`: completers on tasks over a data set, with a table at its end."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

Format = Literal["table", "json", "csv", "markdown"]


def names(text: str) -> list[str]:
    """The comma-separated names of an option."""
    return [name.strip() for name in text.split(",") if name.strip()]


def levels(text: str) -> list[float]:
    """The comma-separated levels of an option.

    Raises:
        PcdbenchError: for what is not a number.
    """
    from pcdbench.errors import PcdbenchError

    try:
        return [float(level) for level in names(text)]
    except ValueError:
        raise PcdbenchError(f"--level {text!r} must be numbers between 0 and 1, like 0.1,0.3,0.5") from None


def run(
    completer: Annotated[str, typer.Option(help="Completers, separated by commas, or all.")],
    task: Annotated[str, typer.Option(help="Tasks, separated by commas, or all.")],
    dataset: Annotated[str, typer.Option(help="A data set, NAME or NAME:PATH.")] = "indoor",
    split: Annotated[str | None, typer.Option(help="A split of it, else its default.")] = None,
    incompleteness: Annotated[str, typer.Option(help="Ways to take points away, separated by commas.")] = "holes",
    level: Annotated[str, typer.Option(help="Shares of points to take away.")] = "0.1,0.3,0.5",
    seed: Annotated[int, typer.Option(help="Decides every random draw.")] = 0,
    jobs: Annotated[int | None, typer.Option(help="Worker processes, else one for each core.")] = None,
    timeout: Annotated[float, typer.Option(help="Seconds for making, completing or evaluating a case.")] = 600.0,
    memory_limit: Annotated[float | None, typer.Option(help="GB a worker may hold, else no limit.")] = None,
    retries: Annotated[int, typer.Option(help="How often a step is tried again whose worker died.")] = 1,
    option: Annotated[
        list[str] | None, typer.Option(help="NAME.KEY=VALUE: an option of a plugin (see pcdbench show NAME).")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The run's folder, else runs/ and a name of its own.")] = None,
    format: Annotated[Format, typer.Option(help="How to print the summary.")] = "table",
    figures: Annotated[bool, typer.Option("--figures", help="Write the figures of the tasks, too.")] = False,
) -> None:
    """Run completers on tasks over a data set, and summarize what comes out.

    The reference completers are added to every run. The same command takes an interrupted run up again and
    does only what is missing.
    """
    from pcdbench.cli.results import print_summary
    from pcdbench.runner.jobs import Limits
    from pcdbench.runner.plan import Request, plan
    from pcdbench.runner.run import carry_out, local_processes

    executor = local_processes(jobs, Limits(timeout, memory_limit, retries))
    planned = plan(
        Request(
            completers=names(completer),
            tasks=names(task),
            dataset=dataset,
            split=split,
            incompletenesses=names(incompleteness),
            levels=levels(level),
            seed=seed,
            options=option or (),
        )
    )
    for name, reason in planned.left_out.items():
        typer.echo(f"pcdbench: {name} is left out: {reason}", err=True)
    try:
        ended = carry_out(planned, out, executor)
    except KeyboardInterrupt:
        typer.echo("pcdbench: stopped; finished cells are stored, and the same command goes on from there", err=True)
        raise typer.Exit(130) from None

    from pcdbench.leaderboard.figures import write_case_picture, write_task_figures

    print_summary(ended.rows, ended.folder, format)
    typer.echo(f"rows: {ended.folder / 'rows.jsonl'}", err=True)
    picture = write_case_picture(planned, ended.rows, ended.folder)
    if picture is not None:
        typer.echo(f"one case side by side: {picture}", err=True)
    if figures:
        written, problems = write_task_figures(planned, ended.rows, ended.folder / "figures")
        for problem in problems:
            typer.echo(f"pcdbench: {problem}", err=True)
        typer.echo(f"figures: {len(written)} in {ended.folder / 'figures'}", err=True)
    if ended.failed:
        typer.echo(f"pcdbench: {len(ended.failed)} rows failed; the same command tries them again", err=True)
        raise typer.Exit(3)
