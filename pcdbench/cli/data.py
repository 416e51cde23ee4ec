"""`pcdbench data`: what is there and what is wrong with it; incomplete clouds as files, for who completes elsewhere."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pcdbench.cli.bar import with_bar
from pcdbench.cli.run import Incompletenesses, Levels, requests_of

if TYPE_CHECKING:
    from pcdbench.dataset import Dataset, Finding
    from pcdbench.runner.plan import Request

app = typer.Typer(no_args_is_help=True, help="Check a data set, or write the incomplete clouds of a run as files.")


@app.callback()
def _data() -> None:
    """Check a data set, or write the incomplete clouds of a run as files."""


@app.command("check")
def check(
    dataset: Annotated[str, typer.Argument(help="A data set, NAME:PATH.")],
    split: Annotated[str | None, typer.Option(help="A split of it (unless given: all that it can list).")] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="NAME.KEY=VALUE: an option of the data set (see pcdbench show NAME).")
    ] = None,
    format: Annotated[Literal["text", "json"], typer.Option(help="How to print what is found.")] = "text",
) -> None:
    """Open every scene, and say what is wrong with it and what was done about it.

    Exit code 1 where a scene cannot be used.
    """
    from pcdbench.errors import PcdbenchError
    from pcdbench.runner.selection import parse_options, select, whose_data_set

    name, _, path = dataset.partition(":")
    options = parse_options(option or ())
    others = sorted(set(options) - {name})
    if others:
        raise PcdbenchError(f"--option {others[0]}.…: {others[0]!r} is not the data set {name!r}")
    plugin = select("dataset", name, options.get(name, {}), path=path or None)
    with whose_data_set(plugin):
        opened = plugin.build()
        splits = _splits(opened) if split is None else {split: list(opened.scene_names(split))}
    scenes = list(dict.fromkeys(scene for of_split in splits.values() for scene in of_split))
    checked = []
    for scene, findings in _checked(opened, scenes):
        checked.append((scene, findings))
        if format == "text":
            for finding in findings:
                typer.echo(f"{scene}: {finding}" if scene not in finding.where else str(finding))
    unusable = [scene for scene, findings in checked if not all(its.usable for its in findings)]
    if format == "json":
        typer.echo(json.dumps(_as_json(dataset, splits, checked, unusable), indent=2))
    else:
        typer.echo(_verdict(dataset, splits, checked, unusable))
    if unusable:
        raise typer.Exit(1)


@app.command("export")
def export(
    suite: Annotated[Path | None, typer.Argument(help="A suite: the TOML file of a run.")] = None,
    dataset: Annotated[str | None, typer.Option(help="A data set, NAME or NAME:PATH (unless given: indoor).")] = None,
    split: Annotated[str | None, typer.Option(help="A split of the data set (unless given: its default).")] = None,
    incompleteness: Incompletenesses = None,
    level: Levels = None,
    seed: Annotated[int | None, typer.Option(help="Decides every random draw (unless given: 0).")] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="NAME.KEY=VALUE: an option of a plugin (see pcdbench show NAME).")
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder of the clouds.")] = Path("incomplete"),
    format: Annotated[Literal["ply", "pcd", "xyz", "npz"], typer.Option(help="The format of the files.")] = "ply",
) -> None:
    """Write the incomplete clouds of a run as files, to complete them elsewhere (see pcdbench.FolderCompleter).

    Options are those of the run. What is there already is not written again. Exit code 3 where a case cannot be made.
    """
    from pcdbench.runner.exporting import cases, exported
    from pcdbench.runner.plan import plan, reference_names

    references, tasks = (None, None) if suite else (reference_names(), ["all"])
    asked = requests_of(suite, references, tasks, dataset, split, incompleteness, level, seed, option or ())
    to_write = cases(plan(_without_completers(request)) for request in asked)
    written = list(exported(with_bar(to_write, "exporting"), out, format))
    problems = [its for its in written if its.path is None]
    for its in problems:
        typer.echo(f"pcdbench: {its.cell.scene} at level {its.cell.level:g}: {its.problem}", err=True)
    there = len(written) - len(problems)
    typer.echo(f"{out}: {there} incomplete clouds, {sum(its.new for its in written)} of them new")
    if problems:
        raise typer.Exit(3)


def _without_completers(request: Request) -> Request:
    """The same cases, of a request whose own completers may not be usable yet."""
    from pcdbench.plugins import registry
    from pcdbench.runner.plan import reference_names

    others = {its.name for kind in ("completer", "task") for its in registry().all(kind)}
    options = [option for option in request.options if option.partition(".")[0].strip() not in others]
    return replace(request, completers=reference_names(), references=False, tasks=("all",), options=options)


def _splits(dataset: Dataset) -> dict[str, list[str]]:
    """The scenes of each split that can be listed: an endless one cannot."""
    from pcdbench.errors import PcdbenchError

    found: dict[str, list[str]] = {}
    problem: PcdbenchError | None = None
    for split in dataset.splits():
        try:
            found[split] = list(dataset.scene_names(split))
        except PcdbenchError as error:
            problem = error
    if not found and problem is not None:
        raise problem
    return found


def _checked(dataset: Dataset, scenes: Sequence[str]) -> Iterator[tuple[str, Sequence[Finding]]]:
    """Each scene with its findings; on a terminal, with a bar."""
    from pcdbench.dataset import Finding
    from pcdbench.errors import told

    for scene in with_bar(scenes, "checking"):
        try:
            findings = dataset.check(scene)
        except Exception as error:
            # A plugin's data set may raise anything; the rest of its scenes are still to be checked.
            findings = [Finding(scene, told(error), usable=False)]
        yield scene, findings


def _verdict(
    dataset: str,
    splits: dict[str, list[str]],
    checked: Sequence[tuple[str, Sequence[Finding]]],
    unusable: Sequence[str],
) -> str:
    count = sum(len(findings) for _, findings in checked)
    scenes = "1 scene" if len(checked) == 1 else f"{len(checked)} scenes"
    findings = "1 finding" if count == 1 else f"{count} findings"
    lines = [f"{dataset}: {scenes}, {len(checked) - len(unusable)} come out, {findings}"]
    if len(splits) > 1:
        lines.append("splits: " + ", ".join(f"{split} ({len(scenes)})" for split, scenes in splits.items()))
    if unusable:
        lines.append("cannot be used: " + ", ".join(unusable))
    return "\n".join(lines)


def _as_json(
    dataset: str,
    splits: dict[str, list[str]],
    checked: Sequence[tuple[str, Sequence[Finding]]],
    unusable: Sequence[str],
) -> dict[str, Any]:
    return {
        "dataset": dataset,
        "splits": splits,
        "scenes": {scene: [asdict(finding) for finding in findings] for scene, findings in checked},
        "usable": [scene for scene, _ in checked if scene not in unusable],
        "unusable": list(unusable),
    }
