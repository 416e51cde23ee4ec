"""Where the command line begins, as `pcdbench` and `python -m pcdbench`: Ctrl-C is one line from its first moment."""

import sys


def main() -> None:
    """Run the command line."""
    try:
        from pcdbench.cli import main as command_line

        command_line()
    except KeyboardInterrupt:
        print("pcdbench: stopped", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
