"""`pcdbench check NAME`: whether a plugin keeps its contract, tried on a small generated room."""

from __future__ import annotations

from typing import Annotated

import typer


def check(
    name: Annotated[str, typer.Argument(help="A completer or a task, from `pcdbench list`.")],
    option: Annotated[
        list[str] | None, typer.Option(help="NAME.KEY=VALUE: an option of the plugin (see pcdbench show NAME).")
    ] = None,
) -> None:
    """Check that a completer or a task keeps its contract, with a line for each thing that holds.

    It is what `pcdbench.testing` checks, with these options. Exit code 1 where something does not hold.
    """
    from pcdbench.errors import PcdbenchError
    from pcdbench.plugins import registry
    from pcdbench.runner.selection import option_targets, parse_options, select
    from pcdbench.testing import called, check_completer, check_task

    options = parse_options(option or ())
    kinds = [found.kind for found in registry().find(name)]
    if not {"completer", "task"} & set(kinds):
        raise PcdbenchError(
            f"{name}: no completer and no task has this name; only these are checked (data sets by pcdbench data check)"
        )
    option_targets(options, {kinds[0]: [name]})
    broken = 0
    for kind in kinds:
        checked = {"completer": check_completer, "task": check_task}.get(kind)
        if checked is None:
            continue
        plugin = select(kind, name, options.get(name, {}))
        try:
            checked(called(f"{name}()", plugin.build), report=lambda line: typer.echo(f"holds: {line}"))
        except AssertionError as problem:
            typer.echo(f"does not hold: {problem}")
            broken += 1
    if broken:
        raise typer.Exit(1)
