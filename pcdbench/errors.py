"""The exceptions whose message is meant for the user: one line that says what, where and what to do."""

from __future__ import annotations

import sys
import warnings
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing import TextIO

    from pydantic import ValidationError


class PcdbenchError(Exception):
    """Something the user can mend; the command line prints the message alone and exits with code 2."""

    def __str__(self) -> str:
        # Plugins raise it, too, and pydantic words some of it: with several lines, or none.
        return " ".join(line.strip() for line in super().__str__().splitlines()) or type(self).__name__


class PluginError(PcdbenchError):
    """A plugin could not be loaded, clashes with another one or breaks its contract."""


class CloudError(PcdbenchError):
    """A point cloud cannot be read, written or used."""


class Skipped(PcdbenchError):
    """Raised by a task or completer that cannot say anything about this case; the row keeps the reason.

    A skipped measurement is not a failure: a cloud without colour has no SSIM.
    """


class RunWarning(UserWarning):
    """Something about a run that whoever reads its figures should know. One line."""


class CacheWarning(UserWarning):
    """Something that was made could not be kept for next time (a full disk); all goes on without. One line."""


def told(error: BaseException) -> str:
    """`Type: message` in one line, of whatever a plugin raised."""
    try:
        message = " ".join(str(error).split())
    except Exception:
        message = "(its message cannot be shown)"
    return f"{type(error).__name__}: {message}" if message else type(error).__name__


def first_problem(error: ValidationError) -> str:
    """`where: what` of the first thing that a pydantic model found wrong."""
    first = error.errors()[0]
    return f"{'.'.join(map(str, first['loc']))}: {problem_text(first['msg'])}"


def problem_text(message: str) -> str:
    """A message of pydantic's, to go on with in a line."""
    text = message.removeprefix("Value error, ")
    return text[:1].lower() + text[1:]


def warn_in_one_line(console: TextIO | None = None) -> None:
    """From now on this process tells warnings of pcdbench in one line, as errors are, on standard error or there."""
    ordinary = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *where: Any) -> None:
        if category.__module__.partition(".")[0] == "pcdbench":
            print(f"pcdbench: {message}", file=console or sys.stderr)
        else:
            ordinary(message, category, *where)

    warnings.showwarning = show  # type: ignore[assignment]
