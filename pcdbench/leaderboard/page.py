"""The page of a board: one file that works offline, with tables, figures, rows and the clouds of some cases."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from html import escape
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING

from pcdbench import __version__
from pcdbench.leaderboard.page_data import page_payload
from pcdbench.viewing.page import (
    embedded_json,
    page_policy,
    viewer_assets,
    viewer_element,
    viewer_script,
    viewer_style,
)

if TYPE_CHECKING:
    from pcdbench.leaderboard.board import Board
    from pcdbench.leaderboard.case_clouds import CaseClouds

_SCRIPTS = (
    *("elements.js", "board.js", "choice.js", "axes.js", "figures.js"),
    *("ranges.js", "tables.js", "rows.js", "one_case.js", "main.js"),
)
_REASONS_SHOWN = 20


def board_page(board: Board, clouds: Sequence[CaseClouds] = (), *, case_command: str) -> str:
    """The whole page: no network, no file beside it, and a policy that forbids it to load anything.

    Args:
        clouds: of the cases that can be turned on the page; the others name the command that shows them.
        case_command: what, followed by a row's key, makes its case and its completions again.
    """
    content = page_payload(board) | {
        "case_command": case_command,
        "clouds": {
            str(its.case): [-1 if label is None else _place(board, label) for label in its.labels] for its in clouds
        },
    }
    elements = "\n".join(
        f'<template id="clouds-{its.case}">{viewer_element(its.shown, its.title)}</template>' for its in clouds
    )
    style, script = _file("page.css"), _script()
    return Template(_file("page.html")).substitute(
        policy=page_policy([style, viewer_style()], [script, viewer_script()]),
        version=__version__,
        title=escape(board.name),
        facts=escape(_facts(board)),
        assets=viewer_assets(),
        about=_about(board),
        clouds=elements,
        data=embedded_json(content),
        style=style,
        script=script,
    )


def _place(board: Board, label: str) -> int:
    return next(place for place, completer in enumerate(board.completers) if completer.label == label)


def _facts(board: Board) -> str:
    """What the board is of, in one line."""
    parts = [
        f"{its.dataset} {its.version}, split {its.split}: {_counted(len(its.scenes), 'scene')}" for its in board.data
    ]
    methods = sum(not completer.reference for completer in board.completers)
    parts += [_counted(len(board.cases), "case"), _counted(methods, "completer"), _counted(len(board.tasks), "task")]
    times = [str(run.facts["time"]) for run in board.runs if run.facts.get("time")]
    if times:
        parts.append(f"measured until {max(times)[:10]}")
    return " · ".join(parts)


def _about(board: Board) -> str:
    """How to read the numbers, and why some are not there; HTML."""
    parts = [
        "<p>Values are of all samples of all cases; [95 %] is their bootstrap interval over scenes. <em>The truth</em> "
        "is the complete cloud, <em>the ceiling</em> another sample of it, the best that a method can honestly reach "
        "which makes the whole cloud anew, and <em>the floor</em> what doing nothing scores. References have no "
        "rank.</p>",
        "<p>A rank is one more than the number of completers shown to be better: by paired differences over the same "
        "cases, with simultaneous 95 % intervals over all pairs of a table. Completers that cannot be told apart share "
        "a rank, but for those with fewer cases, who come after. For its rank, a case on which a completer failed "
        "counts with the worst value that anyone has; the values are of what was measured, and how many cases failed "
        "stands beside them. Of one case, a number is the mean of its samples.</p>",
    ]
    flagged = [completer for completer in board.completers if completer.saw_test]
    if flagged:
        lines = "".join(
            f"<li><bdi>{escape(its.label)}</bdi>: <bdi>{escape(its.saw_test)}</bdi></li>" for its in flagged
        )
        parts.append(f"<p>Trained on scenes of this board, so to be read with care:</p><ul>{lines}</ul>")
    lost = board.unmeasured()
    if lost:
        lines = "".join(
            f"<li>{count} {status}: <bdi>{escape(completer)}</bdi> on <bdi>{escape(task)}</bdi>: "
            f"<bdi>{escape(error)}</bdi></li>"
            for (status, completer, task, error), count in lost.most_common(_REASONS_SHOWN)
        )
        more = f"<p>And {len(lost) - _REASONS_SHOWN} reasons more.</p>" if len(lost) > _REASONS_SHOWN else ""
        parts.append(f"<p>Without measurements ({_counted(lost.total(), 'row')}):</p><ul>{lines}</ul>{more}")
    return "\n".join(parts)


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


@cache
def _script() -> str:
    """The whole script; its names stay its own."""
    return '(() => {\n"use strict";\n' + "\n".join(map(_file, _SCRIPTS)) + "})();"


@cache
def _file(name: str) -> str:
    return (files("pcdbench.leaderboard") / "web" / name).read_text(encoding="utf-8")
