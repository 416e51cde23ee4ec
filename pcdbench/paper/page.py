"""The page of a publication: each of its tables and figures, ours beside the published numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pcdbench.leaderboard.statistics import Estimate
from pcdbench.paper.drawing import write_figure
from pcdbench.paper.experiments import Outcome
from pcdbench.paper.numbers import Numbers
from pcdbench.paper.publication import Part, Publication
from pcdbench.runner.store import write_text

_DIGITS = 3
_WEIGHTS_HEAD = (
    "| weights | training pairs | hours | on | ChD in validation, of doing nothing |",
    "|---|---|---|---|---|",
)
_NOTHING = "\N{EN DASH}"


def write_page(publication: Publication, outcomes: Mapping[str, Outcome], command: str, path: Path) -> None:
    """Write the page, and its figures into the folder `<stem>/` beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    numbers = Numbers(outcomes)
    lines = [*_head(publication, outcomes, command)]
    for part in publication.parts:
        lines += [f"## {part.number}: {part.title}", ""]
        lines += _part(part, numbers, path)
    learned = list(_compute(outcomes))
    if learned:
        lines += ["## What they were trained for", "", *_WEIGHTS_HEAD, *learned]
    write_text(path, "\n".join(lines) + "\n")


def _head(publication: Publication, outcomes: Mapping[str, Outcome], command: str) -> Iterator[str]:
    planned = next((its.planned for its in outcomes.values() if its.planned is not None), None)
    yield f"# {publication.title} ({publication.venue}), repeated"
    yield ""
    yield f"    {command}"
    yield ""
    if planned is not None:
        scenes, draws = len(planned.scenes), planned.draws
        yield (
            f"Measured on `{planned.dataset.name}` version {planned.dataset.version}, split `{planned.split}`: "
            f"{scenes} scenes, {scenes * draws} cases at each level. In square brackets: 95 % intervals over scenes. "
            "Every number is from rows that the command writes; none is tuned on these scenes."
        )
        yield ""
    yield "What differs from the publication throughout, and why:"
    yield ""
    for topic, text in publication.differs.items():
        yield f"- **{topic}**: {' '.join(text.split())}"
    yield ""


def _part(part: Part, numbers: Numbers, path: Path) -> Iterator[str]:
    if part.differs:
        yield " ".join(part.differs.split())
        yield ""
    if part.rows:
        yield from _table(part, numbers)
        yield ""
    if part.figure is not None:
        figure = path.parent / path.stem / f"{part.number.lower().replace(' ', '_')}.svg"
        if write_figure(part.figure, numbers, figure):
            yield f"![{part.number}: {part.title}]({path.stem}/{figure.name})"
        else:
            yield "Not measured."
        yield ""
    for run in part.runs:
        reason = numbers.outcomes[run].left_out
        if reason:
            yield f"`{run}` was not run: {reason}."
            yield ""
        failed = numbers.failed(run)
        if failed:
            yield f"{failed} rows of `{run}` failed; they are in none of these numbers."
            yield ""


def _table(part: Part, numbers: Numbers) -> Iterator[str]:
    shown = [column for number, column in enumerate(part.columns) if any(_published(row, number) for row in part.rows)]
    headings = [
        text for column in part.columns for text in (column.heading, *(["published"] if column in shown else []))
    ]
    yield f"| | {' | '.join(headings)} |"
    yield "|---|" + "---|" * len(headings)
    for row in part.rows:
        cells = []
        for number, column in enumerate(part.columns):
            cells.append(_ours(numbers.estimate(row.run, row.completer, row.level, column)))
            if column in shown:
                cells.append(f"{row.published[number]:g}" if _published(row, number) else "")
        yield f"| {row.heading} | {' | '.join(cells)} |"


def _published(row: Any, number: int) -> bool:
    return bool(row.published) and not math.isnan(row.published[number])


def _ours(its: Estimate | None) -> str:
    if its is None:
        return _NOTHING
    value = f"{its.value:.{_DIGITS}g}"
    return f"{value} [{its.low:.{_DIGITS}g}, {its.high:.{_DIGITS}g}]" if its.has_interval else value


def _compute(outcomes: Mapping[str, Outcome]) -> Iterator[str]:
    """A line for each set of weights that was used."""
    told = set()
    for run, its in outcomes.items():
        for plugin in its.planned.completers if its.planned is not None else ():
            card = plugin.card
            if card is None or plugin.weights in told:
                continue
            told.add(plugin.weights)
            where = f"{plugin.name} ({run})" if its.trained is not None else plugin.name
            machine, ratio = card.get("machine") or {}, (card.get("validation") or {}).get("chd_ratio")
            told_of = [where, card.get("pairs"), card.get("hours")]
            told_of += [f"{machine['cores']} cores, {machine['cpu']}" if machine else None, ratio and f"{ratio:.3g}"]
            yield f"| {' | '.join(_NOTHING if one is None else str(one) for one in told_of)} |"
