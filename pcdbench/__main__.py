"""Where the command line begins, as `pcdbench` and `python -m pcdbench`: Ctrl-C is one line from its first moment."""

import os
import sys


def main() -> None:
    """Run the command line."""
    _occupy_closed_streams()
    # A worker starts as `python -c`, which would take modules, those of Python itself too, from the working folder
    # first: from a stranger's run, say. Workers drop it again (see `begin_worker`), for what plugins start.
    os.environ.setdefault("PYTHONSAFEPATH", "pcdbench")
    try:
        from pcdbench.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        print("pcdbench: stopped", file=sys.stderr)
        sys.exit(130)


def _occupy_closed_streams() -> None:
    """A file or pipe that was given the number of a closed standard stream would be printed to, here and in workers."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # The lowest number that is free is this one.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


if __name__ == "__main__":
    main()
