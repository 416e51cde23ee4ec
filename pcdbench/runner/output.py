"""What a worker prints, natively too, kept in a file without a name: its last lines explain a failure."""

from __future__ import annotations

import os
import tempfile
from multiprocessing.connection import Connection

_KEPT_LINES = 40
_KEPT_CHARACTERS = 8_000
_READ_BYTES = 32_000
_LARGEST_BYTES = 1_000_000


class Output:
    """A file in memory (on disk where the system has none) that both processes write to and read.

    Attributes:
        handle: hands the file to a process that is being spawned; its `fileno()` is the file there.
    """

    def __init__(self) -> None:
        if hasattr(os, "memfd_create"):
            descriptor = os.memfd_create("pcdbench-output")
        else:
            with tempfile.TemporaryFile() as file:
                descriptor = os.dup(file.fileno())
        # Cleared by one process while another writes to it, the file must not keep a hole.
        _append_only(descriptor)
        self.handle = Connection(descriptor)

    def last_lines(self) -> str | None:
        """See `last_lines`."""
        return last_lines(self.handle.fileno())

    def clip(self) -> None:
        """Forget the beginning of what has become too long."""
        descriptor = self.handle.fileno()
        if os.fstat(descriptor).st_size > _LARGEST_BYTES:
            kept = _end(descriptor)
            os.ftruncate(descriptor, 0)
            os.write(descriptor, kept)


def clear(descriptor: int) -> None:
    """Forget what was printed."""
    os.ftruncate(descriptor, 0)


def last_lines(descriptor: int) -> str | None:
    """The last 40 lines printed, at most 8,000 characters of them; None where nothing was."""
    lines = _end(descriptor).decode(errors="replace").splitlines()
    # faulthandler's long list of all native modules would push out the stack.
    told = [line for line in lines if not line.startswith("Extension modules: ")]
    return "\n".join(told[-_KEPT_LINES:]).strip("\n")[-_KEPT_CHARACTERS:] or None


def _append_only(descriptor: int) -> None:
    import fcntl

    fcntl.fcntl(descriptor, fcntl.F_SETFL, fcntl.fcntl(descriptor, fcntl.F_GETFL) | os.O_APPEND)


def _end(descriptor: int) -> bytes:
    size = os.fstat(descriptor).st_size
    return os.pread(descriptor, _READ_BYTES, max(0, size - _READ_BYTES))
