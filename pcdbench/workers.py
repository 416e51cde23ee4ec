"""How every worker process begins: its share of threads, a process group and an end of its own, output apart.

Nothing heavy is imported here: threads are limited before numpy is first imported.
"""

from __future__ import annotations

import ctypes
import faulthandler
import multiprocessing
import os
import secrets
import shutil
import signal
import sys
import tempfile
import threading
from multiprocessing.process import BaseProcess
from typing import NoReturn

from pcdbench.errors import warn_in_one_line
from pcdbench.threads import limit_threads

_OUT_OF_MEMORY_SCORE = 500
_LINE_BUFFERED = 1  # _IOLBF of stdio.h, on Linux and macOS

_temporary: str | None = None


def begin_worker(threads: int, output: int | None = None, temporary: str | None = None) -> None:
    """Set up this process, a spawned worker, before it does anything else.

    Args:
        threads: how many it may use.
        output: a file descriptor that takes all that is printed, by native libraries too; standard error
            unless given. Warnings meant for the user go to standard error in any case.
        temporary: where its temporary folders go (see `temporary_place`).
    """
    global _temporary
    _temporary = temporary
    limit_threads(threads)
    if os.environ.get("PYTHONSAFEPATH") == "pcdbench":
        del os.environ["PYTHONSAFEPATH"]
    console = os.fdopen(os.dup(2), "w", buffering=1)
    take_output(2 if output is None else output)
    _flush_line_by_line()
    warn_in_one_line(console)
    end_as_a_group()
    faulthandler.enable(file=2 if output is None else output, all_threads=False)
    if output is not None:
        # SIGTERM ends a step that hangs: where it hung is printed first, even if native code holds the interpreter.
        faulthandler.register(signal.SIGTERM, file=output, all_threads=False, chain=True)
    _be_killed_before_the_parent()


def take_output(descriptor: int) -> None:
    """Have all that is printed from now on go to this file, whatever a plugin has done to standard output and error.

    Native libraries print to standard output, where the parent's tables and JSON go.
    """
    for name, taken in (("stdout", 1), ("stderr", 2)):
        os.dup2(descriptor, taken)
        own = getattr(sys, f"__{name}__")
        if own is None or own.closed:
            own = os.fdopen(taken, "w", buffering=1, closefd=False)
            setattr(sys, f"__{name}__", own)
        setattr(sys, name, own)


def temporary_place() -> str | None:
    """A folder for the temporary ones of workers, made when one needs it; whoever started them is to remove it.

    A worker that is killed cannot. None where the system has no place for temporary files.
    """
    try:
        return os.path.join(tempfile.gettempdir(), f"pcdbench-{secrets.token_hex(8)}")
    except OSError:
        return None


def remove_temporary(place: str | None) -> None:
    """Remove what workers left in their place for temporary folders, and the place."""
    if place is not None:
        shutil.rmtree(place, ignore_errors=True)


def temporary_folder() -> tempfile.TemporaryDirectory[str]:
    """A temporary folder; one of a worker's goes with it, however that ends."""
    if _temporary is not None:
        os.makedirs(_temporary, mode=0o700, exist_ok=True)
    return tempfile.TemporaryDirectory(prefix="pcdbench-", dir=_temporary, ignore_cleanup_errors=True)


def end_group(pid: int) -> None:
    """Kill a worker and the processes that it started, at once."""
    try:
        os.killpg(pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        return


def _flush_line_by_line() -> None:
    """What was printed before a crash must not be lost in a buffer."""
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    try:
        libc = ctypes.CDLL(None)
        libc.setvbuf(ctypes.c_void_p.in_dll(libc, "stdout"), None, _LINE_BUFFERED, ctypes.c_size_t(0))
    except (OSError, ValueError, AttributeError, TypeError):
        return  # a system whose C library has other names


def end_as_a_group() -> None:
    """This process leads a group: when it is ended, or its parent is gone, all it started goes with it."""
    if os.getpgrp() != os.getpid():
        os.setpgid(0, 0)
    signal.signal(signal.SIGTERM, lambda *_: _end_own_group())
    # By this signal a pool of processes ends its own: what a plugin forked ends alone, and not with its worker.
    os.register_at_fork(after_in_child=lambda: signal.signal(signal.SIGTERM, signal.SIG_DFL))
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    """End this process when its parent is gone, killed even."""
    parent.join()
    remove_temporary(_temporary)
    _end_own_group()


def _end_own_group() -> NoReturn:
    os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _be_killed_before_the_parent() -> None:
    """When memory runs out, Linux takes the worker, whose cell is at fault, and not the run."""
    try:
        with open("/proc/self/oom_score_adj", "w") as score:
            score.write(str(_OUT_OF_MEMORY_SCORE))
    except OSError:
        return
