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
        records,
        summary_tables,
    )
    from pcdbench.leaderboard.summary import foreknowledge, reasons, summarize, unseen_shares

    summary = summarize(rows)
    # Real pairs alone have such shares, and rows are read from disk.
    told = unseen_shares(rows) if (summary["level"] == MEASURED).any() else []
    foreknown = foreknowledge(rows)
    told += [f"{name}: {what}" for name, what in foreknown.items()]
    if format == "json":
        content = {"run": str(folder), "summary": records(summary), "reasons": reasons(rows), "foreknown": foreknown}
        typer.echo(json.dumps(content, indent=2))
    elif format == "csv":
        typer.echo(summary.to_csv(index=False), nl=False)
    elif format == "markdown":
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
