"""`pcdbench results`: the summary of a run, again."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

Format = Literal["table", "json", "csv", "markdown"]
_WIDTH_OFF_TERMINAL = 150
_REASONS_SHOWN = 12


def results(
    run: Annotated[Path, typer.Argument(help="The folder of a run.")],
    format: Annotated[Format, typer.Option(help="How to print the summary.")] = "table",
) -> None:
    """Print the summary of a run again."""
    from pcdbench.leaderboard.results import rows_of_run

    print_summary(rows_of_run(run), run, format)


def print_summary(rows: Sequence[Mapping[str, Any]], folder: Path, format: Format) -> None:
    """Print what rows add up to on standard output: tables, or records for programs."""
    from pcdbench.incompleteness import MEASURED
    from pcdbench.leaderboard.render import (
        LEGEND,
        MARKED_LEGEND,
        escaped_markdown,
        has_styles,
        markdown,
        print_tables,
        summary_tables,
    )
    from pcdbench.leaderboard.summary import foreknowledge, reasons, summarize, unseen_shares

    if format == "json":
        typer.echo(json.dumps(_record(rows, folder), indent=2))
        return
    summary = summarize(rows)
    if format == "csv":
        typer.echo(summary.to_csv(index=False), nl=False)
        return
    # Real pairs alone have such shares, and rows are read from disk.
    told = unseen_shares(rows) if (summary["level"] == MEASURED).any() else []
    told += [f"{name}: {what}" for name, what in foreknowledge(rows).items()]
    if format == "markdown":
        lost = "".join(f"- {escaped_markdown(reason)}\n" for reason in reasons(rows))
        more = "".join(f"\n{escaped_markdown(line)}\n" for line in told)
        typer.echo(f"{markdown(summary_tables(summary))}\n{LEGEND}\n{more}{lost}", nl=False)
    else:
        console = table_console()
        print_tables(summary_tables(summary), console)
        console.print(LEGEND if has_styles(console) else MARKED_LEGEND, style="dim")
        for line in told:
            console.print(line, markup=False, soft_wrap=True)
        print_reasons(reasons(rows), console)


def print_together(runs: Mapping[Path, Sequence[Mapping[str, Any]]], format: Literal["json", "csv"]) -> None:
    """Print several runs' rows, by folder, as one document: a JSON list, or CSV whose first column is the folder."""
    import pandas as pd

    from pcdbench.leaderboard.summary import summarize

    if format == "json":
        typer.echo(json.dumps([_record(rows, folder) for folder, rows in runs.items()], indent=2))
    else:
        tables = {str(folder): summarize(rows) for folder, rows in runs.items()}
        together = pd.concat(tables, names=["run", None]).reset_index("run")
        typer.echo(together.to_csv(index=False), nl=False)


def _record(rows: Sequence[Mapping[str, Any]], folder: Path) -> dict[str, Any]:
    """What programs are told of a run."""
    from pcdbench.leaderboard.render import records
    from pcdbench.leaderboard.summary import foreknowledge, reasons, summarize

    told = {"summary": records(summarize(rows)), "reasons": reasons(rows), "foreknown": foreknowledge(rows)}
    return {"run": str(folder), **told}


def table_console() -> Any:
    """A console on standard output; tables that go to a file or a pipe are not squeezed to 80 columns."""
    from rich.console import Console

    # Plugins' errors may hold what rich takes for an emoji: `:key:`.
    console = Console(highlight=False, emoji=False)
    return console if console.is_terminal else Console(highlight=False, emoji=False, width=_WIDTH_OFF_TERMINAL)


def print_reasons(found: Sequence[str], console: Any) -> None:
    """Print why rows have no measurements, the first dozen reasons."""
    for reason in found[:_REASONS_SHOWN]:
        console.print(reason, markup=False, soft_wrap=True)
    if len(found) > _REASONS_SHOWN:
        console.print(f"and {len(found) - _REASONS_SHOWN} reasons more: --format json", markup=False)
