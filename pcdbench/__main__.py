"""`python -m pcdbench`: the command line, with the interpreter named."""

from pcdbench.cli import main

main()
