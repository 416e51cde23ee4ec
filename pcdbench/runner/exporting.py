"""The incomplete clouds of a plan as files, for completers that work elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pcdbench.external import cloud_tag
from pcdbench.incompleteness import MEASURED
from pcdbench.paths import file_name
from pcdbench.runner.completions import CompletionCache
from pcdbench.runner.execute import Executor, Failure
from pcdbench.runner.plan import Cell, Plan


@dataclass(frozen=True)
class Exported:
    """A case that was to be written.

    Attributes:
        path: its file; None where there is none, for this `problem`.
        new: whether it was not there before.
    """

    cell: Cell
    path: Path | None
    new: bool = False
    problem: str = ""


def cases(plans: Iterable[Plan]) -> list[tuple[Plan, Cell]]:
    """A cell of each case of these plans, those of one scene next to one another."""
    return list({cell.case: (plan, cell) for plan in plans for cell in plan.cells}.values())


def exported(of: Iterable[tuple[Plan, Cell]], folder: Path, extension: str) -> Iterator[Exported]:
    """Write the incomplete cloud of each case that `folder` does not have yet, and nothing else of it.

    Files are named `SCENE-INCOMPLETENESS-LEVEL-DIGEST`, the digest being that of the cloud (`cloud_tag`).

    Raises:
        CloudError: where a file cannot be written.
    """
    executors: dict[str, Executor] = {}
    for plan, cell in of:
        executor = executors.setdefault(plan.dataset.identity, Executor(plan.dataset, CompletionCache()))
        try:
            case = executor.case(cell)
        except Failure as failure:
            yield Exported(cell, None, problem=failure.error)
            continue
        level = [] if cell.level == MEASURED else [f"{cell.level:g}"]
        name = "-".join([file_name(cell.scene), cell.incompleteness.name, *level, cloud_tag(case.cloud)])
        path = folder / f"{name}.{extension}"
        new = not path.is_file()
        if new:
            case.cloud.write(path)
        yield Exported(cell, path, new)
