"""`pcdbench paper`: a publication's experiments, run again, and a page with ours beside the published numbers."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from pcdbench.errors import PcdbenchError


def paper(
    publication: Annotated[
        str | None,
        typer.Argument(help="A completer with a publication.toml in its package, or the path of such a file."),
    ] = None,
    out: Annotated[Path, typer.Option(help="The folder for runs, trained weights and the page.")] = Path("runs/paper"),
    page: Annotated[Path | None, typer.Option(help="The page to write (unless given: paper.md in --out).")] = None,
    dataset: Annotated[str, typer.Option(help="A data set, NAME or NAME:PATH.")] = "indoor",
    split: Annotated[str | None, typer.Option(help="A split of the data set (unless given: its default).")] = None,
    weights: Annotated[
        Path | None, typer.Option(help="A folder with NAME/weights.safetensors for the ablations that need training.")
    ] = None,
    train_steps: Annotated[
        int | None, typer.Option(min=1, help="Train what --weights does not hold, each for so many steps.")
    ] = None,
    train_hours: Annotated[float | None, typer.Option(min=0.0, help="The same, each for so many hours.")] = None,
    take_from: Annotated[
        list[Path] | None, typer.Option(help="A run to take rows from where its cells are the same; repeatable.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(help="Worker processes (unless given: one for each core).")] = None,
) -> None:
    """Run a publication's experiments on a data set, and write its tables and figures, ours beside the published.

    The same command takes an interrupted one up again and does only what is missing.
    """
    from pcdbench.paper.experiments import Place, outcomes
    from pcdbench.paper.page import write_page
    from pcdbench.paper.publication import read_publication, where_publications_are
    from pcdbench.runner.run import local_processes

    if publication is None:
        raise PcdbenchError(f"say which publication: {where_publications_are()}")
    budget = None
    if train_steps is not None or train_hours is not None:
        from pcdbench.training.loop import Budget

        budget = Budget(train_steps, train_hours)
    read = read_publication(publication)
    place = Place(
        out=out,
        dataset=dataset,
        split=split,
        weights=weights,
        budget=budget,
        taken_from=take_from or (),
        executor=local_processes(jobs),
        report=lambda line: typer.echo(line, err=True),
    )
    found = outcomes(read, place)
    written = out / "paper.md" if page is None else page
    write_page(read, found, shlex.join(["pcdbench", *sys.argv[1:]]), written)
    typer.echo(str(written))
