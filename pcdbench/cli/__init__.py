"""The command line: one module a command, and one line on stderr for whatever the user can mend."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Annotated

import typer
from typer.core import TyperGroup

from pcdbench import __version__
from pcdbench.cli import (
    audit,
    check,
    complete,
    data,
    doctor,
    leaderboard,
    list_,
    paper,
    results,
    run,
    show,
    train,
    view,
)
from pcdbench.errors import PcdbenchError, warn_in_one_line
from pcdbench.threads import thread_count

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
# What asking whether a file is there may end in, where the answer is neither yes nor no.
_OUT_OF_REACH = (errno.EACCES, errno.EPERM, errno.ENAMETOOLONG)


class _Commands(TyperGroup):
    """Commands whose expected ends are one line each: an error the user can mend, a full disk, and Ctrl-C."""

    def invoke(self, ctx: typer.Context) -> object:  # type: ignore[override]  # typer keeps its own name for it
        try:
            return super().invoke(ctx)
        except PcdbenchError as error:
            typer.echo(f"pcdbench: {error}", err=True)
            raise typer.Exit(2) from error
        except OSError as error:
            if error.errno in _OUT_OF_REACH and error.filename is not None:
                told = f"{error.filename}: {error.strerror}; check the path and its permissions"
                typer.echo(f"pcdbench: {told}", err=True)
                raise typer.Exit(2) from error
            if error.errno not in _FULL:
                raise
            _give_up_printing()
            what = error.filename or "what is printed"
            typer.echo(f"pcdbench: {what} cannot be written ({error.strerror}); make room there", err=True)
            raise typer.Exit(2) from error
        except KeyboardInterrupt:
            typer.echo("pcdbench: stopped", err=True)
            raise typer.Exit(130) from None


def _give_up_printing() -> None:
    """Nothing goes to standard output any more, nor what waits in its buffer until the end."""
    printed = sys.__stdout__
    if printed is not None and printed is sys.stdout:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, printed.fileno())
        os.close(nowhere)


app = typer.Typer(cls=_Commands, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
app.command("run")(run.run)
app.command("results")(results.results)
app.command("audit")(audit.audit)
app.add_typer(data.app, name="data")
app.add_typer(leaderboard.app, name="leaderboard")
app.command("check")(check.check)
app.command("complete")(complete.complete)
app.command("paper")(paper.paper)
app.command("doctor")(doctor.doctor)
app.command("list")(list_.list_plugins)
app.command("show")(show.show)
app.command("train")(train.train)
app.command("view")(view.view)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pcdbench {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """How much does completing an indoor point cloud help what you want to do with it?

    Exit codes: 0 fine, 1 a check or an audit failed, 2 wrong use, 3 the run has failed cells.
    """
    thread_count()  # a share that is none is refused before anything runs


def main() -> None:
    """The console script `pcdbench`."""
    warn_in_one_line()
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Not every locale has the characters of tables and file names; standard error escapes them of itself.
        sys.stdout.reconfigure(errors="backslashreplace")
    app()
