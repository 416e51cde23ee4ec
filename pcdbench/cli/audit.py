"""`pcdbench audit`: whether a task can tell the truth from half of it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pcdbench.cli.run import STOPPED, Incompletenesses, Levels, levels, names

if TYPE_CHECKING:
    from pcdbench.leaderboard.audit import Audit

_FEW_SCENES = 10
# Where a data set has it, this split is large enough for intervals and small enough to wait for.
_SPLIT = "test-small"


def audit(
    task: Annotated[str, typer.Argument(help="Tasks, separated by commas, or all.")],
    dataset: Annotated[str, typer.Option(help="A data set, NAME or NAME:PATH.")] = "indoor",
    split: Annotated[str | None, typer.Option(help=f"A split of it (unless given: {_SPLIT} or its default).")] = None,
    incompleteness: Incompletenesses = None,
    level: Levels = None,
    seed: Annotated[int, typer.Option(help="Decides every random draw.")] = 0,
    jobs: Annotated[int | None, typer.Option(help="Worker processes (unless given: one for each core).")] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="NAME.KEY=VALUE: an option of a plugin (see pcdbench show NAME).")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The run's folder (unless given: one of its own in runs/).")] = None,
    format: Annotated[Literal["table", "json"], typer.Option(help="How to print the audit.")] = "table",
) -> None:
    """Check that tasks measure something: each must tell the truth from what is left of it.

    The references alone are run. The truth must be at least as good as another sample of it. That sample must be
    better than what is left at the lowest level, that better than at the next, and so on, and the intervals of the
    sample and of the highest level must not touch. Exit code 1 where this does not hold.
    """
    from pcdbench.leaderboard.audit import CEILING, FLOOR, TRUTH, audits
    from pcdbench.runner.plan import DEFAULT_LEVELS, Request, default_split, plan
    from pcdbench.runner.run import carry_out, local_processes

    planned = plan(
        Request(
            completers=(TRUTH, CEILING, FLOOR),
            tasks=names([task]),
            dataset=dataset,
            split=split or default_split(dataset, option or (), preferred=_SPLIT),
            incompletenesses=names(incompleteness or ["holes"]),
            levels=levels(level) if level else DEFAULT_LEVELS,
            seed=seed,
            options=option or (),
            references=False,
        )
    )
    for name, reason in planned.left_out.items():
        typer.echo(f"pcdbench: {name} is left out: {reason}", err=True)
    try:
        ended = carry_out(planned, out, local_processes(jobs))
    except KeyboardInterrupt:
        typer.echo(STOPPED, err=True)
        raise typer.Exit(130) from None
    found = audits(ended.rows)
    if format == "json":
        content = {"run": str(ended.folder), "dataset": planned.dataset.name, "split": planned.split}
        typer.echo(json.dumps(content | {"audits": [its.as_json() for its in found]}, indent=2))
    else:
        _print_audits(found, ended.rows)
    typer.echo(f"rows: {ended.folder / 'rows.jsonl'}", err=True)
    broken = [f"{its.task} ({its.incompleteness}): {name}" for its in found for name in its.broken]
    if broken:
        typer.echo(f"pcdbench: the audit does not hold: {'; '.join(broken)}", err=True)
        raise typer.Exit(1)
    if ended.failed:
        typer.echo(f"pcdbench: {len(ended.failed)} rows failed; the same command tries them again", err=True)
        raise typer.Exit(3)


def _print_audits(found: list[Audit], rows: Sequence[dict[str, Any]]) -> None:
    from rich.markup import escape

    from pcdbench.cli.results import print_reasons, table_console
    from pcdbench.leaderboard.audit import TRUTH
    from pcdbench.leaderboard.render import audit_table, estimate_text, print_tables
    from pcdbench.leaderboard.summary import reasons

    console = table_console()
    for its in found:
        print_tables([audit_table(its)], console)
        for check in its.checks:
            verdict = "[green]holds[/]" if check.holds else "[bold red]does not hold[/]"
            advantage = "" if check.advantage is None else f"  better by {estimate_text(check.advantage, its.unit)}"
            told = escape(f"{check.name}{advantage}  {check.note}")
            console.print(f"  {verdict}  {told}", soft_wrap=True)
        if its.ceiling == TRUTH:
            console.print("  No second sample of these scenes exists: the ceiling is the truth itself.")
        if 0 < its.scenes < _FEW_SCENES:
            scenes = "1 scene says" if its.scenes == 1 else f"{its.scenes} scenes say"
            console.print(f"  {scenes} little; take a larger --split.")
        console.print()
    print_reasons(reasons(rows), console)
