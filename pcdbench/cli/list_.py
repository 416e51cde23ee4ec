"""`pcdbench list`: everything installed that can be named on the command line, and what could not be loaded."""

from __future__ import annotations

import typer

from pcdbench.plugins import KINDS, Kind, Registration, registry

_HEADING: dict[Kind, str] = {
    "completer": "completers",
    "task": "tasks",
    "dataset": "data sets",
    "incompleteness": "incompletenesses",
}


def list_plugins() -> None:
    """List completers, tasks, data sets and incompletenesses, and plugins that cannot be loaded or clash."""
    installed = registry()
    for kind in KINDS:
        typer.echo(_HEADING[kind])
        for line in _lines(installed.all(kind)):
            typer.echo(f"  {line}")
        typer.echo()
    for origin, error in sorted(installed.broken.items()):
        typer.echo(f"not loaded: {origin}: {error}")
    for clash in installed.clashes():
        typer.echo(f"clash: {clash}")
    typer.echo("More about one of them: pcdbench show NAME")


def _lines(registrations: list[Registration]) -> list[str]:
    """One line each, in columns: name, summary, origin."""
    if not registrations:
        return ["none"]
    summaries = [one.summary + _note(one) for one in registrations]
    name_width = max(len(one.name) for one in registrations)
    summary_width = max(map(len, summaries))
    return [
        f"{one.name:<{name_width}}  {summary:<{summary_width}}  {one.origin}"
        for one, summary in zip(registrations, summaries, strict=True)
    ]


def _note(registration: Registration) -> str:
    if registration.reference:
        return " [reference]"
    return " [weights missing]" if registration.lacks_weights else ""
