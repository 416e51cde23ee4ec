"""A summary as text: tables for a terminal and for Markdown, records for JSON and CSV."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pcdbench.leaderboard.statistics import Estimate
from pcdbench.leaderboard.summary import level_text

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from pcdbench.leaderboard.audit import Audit

HEADER = ("level", "completer", "median [95 %]", "90th percentile [95 %]", "mean [95 %]", "cases", "seconds")
AUDIT_HEADER = ("level", "reference", "mean of cases [95 %]", "cases")
_LEFT_COLUMNS = (1,)
LEGEND = (
    "Bold: the best of a level's completers with the most cases. Italic: references, not methods. "
    "[95 %]: bootstrap interval over scenes. Seconds: median time of completing."
)


def escaped_markdown(text: str) -> str:
    """Text that Markdown and HTML show as it is, in a table and in a comment too."""
    text = " ".join(text.split()).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    for character in "\\`*[]|#~@":
        text = text.replace(character, f"\\{character}")
    return text


@dataclass(frozen=True)
class Cell:
    """A table's cell: its text and whether it stands out (the best) or back (a reference).

    Attributes:
        named: whether the text is a plugin's, which may hold anything.
    """

    text: str
    bold: bool = False
    italic: bool = False
    named: bool = False

    @property
    def style(self) -> str:
        return "bold green" if self.bold else "italic dim" if self.italic else ""

    @property
    def markdown(self) -> str:
        text = escaped_markdown(self.text) if self.named else self.text
        return f"**{text}**" if self.bold else f"*{text}*" if self.italic else text


@dataclass(frozen=True)
class Table:
    """A titled table in blocks: one a level."""

    title: str
    header: Sequence[str]
    blocks: Sequence[Sequence[Sequence[Cell]]]


def summary_tables(summary: pd.DataFrame) -> list[Table]:
    """One table for each task's main metric and incompleteness."""
    main = summary[summary["main"].astype(bool)]
    found = []
    for (task, incompleteness), lines in main.groupby(["task", "incompleteness"], sort=False):
        measured = lines[lines["metric"] != ""]
        title = f"{task} · {incompleteness}"
        if len(measured):
            first = measured.iloc[0]
            title = f"{task} · {first['metric']} ({first['unit']}; {first['direction']} is better) · {incompleteness}"
        blocks = [_block(of_level) for _, of_level in lines.groupby("level", sort=True)]
        found.append(Table(title, HEADER, blocks))
    return found


def audit_table(audit: Audit) -> Table:
    """What the references scored at each level, a block a reference."""
    title = f"{audit.task} · {audit.incompleteness}: nothing measured"
    if audit.metric:
        title = (
            f"{audit.task} · {audit.metric} ({audit.unit}; {audit.direction} is better) · {audit.incompleteness} · "
            f"{audit.scenes} scenes"
        )
    blocks: dict[str, list[list[Cell]]] = {}
    for standing in audit.standings:
        block = blocks.setdefault(standing.reference, [])
        block.append(
            [
                Cell(level_text(standing.level)),
                Cell("" if block else standing.reference, named=True),
                Cell("-" if standing.mean is None else estimate_text(standing.mean, audit.unit)),
                Cell(_cases(standing.cases, standing.failed, standing.skipped)),
            ]
        )
    return Table(title, AUDIT_HEADER, list(blocks.values()))


def print_tables(tables: Sequence[Table], console: Console) -> None:
    """Print tables on a terminal."""
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    for table in tables:
        console.print(Text(table.title, "bold"), soft_wrap=True)
        shown = RichTable(box=box.SIMPLE_HEAD)
        for number, name in enumerate(table.header):
            shown.add_column(name, justify="left" if number in _LEFT_COLUMNS else "right", no_wrap=True)
        for block in table.blocks:
            for line in block:
                shown.add_row(*(Text(cell.text, cell.style) for cell in line))
            shown.add_section()
        console.print(shown)


def markdown(tables: Sequence[Table]) -> str:
    """The tables in Markdown."""
    parts = []
    for table in tables:
        rules = [":--" if number in _LEFT_COLUMNS else "--:" for number in range(len(table.header))]
        lines = [table.header, rules, *([cell.markdown for cell in line] for block in table.blocks for line in block)]
        body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        parts.append(f"### {escaped_markdown(table.title)}\n\n{body}\n")
    return "\n".join(parts)


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """The lines of a frame as JSON values; what is not a number is null."""
    return json.loads(frame.to_json(orient="records", double_precision=15))


def number(value: float, unit: str = "") -> str:
    """A number for people: `3.9e-4`, `0.893`, `12.4`; metres with three decimals."""
    if value is None or math.isnan(value):
        return "-"
    if value == 0:
        return "0"
    if unit == "m" and abs(value) >= 0.0005:
        return f"{value:.3f}"
    if abs(value) < 0.01:
        mantissa, exponent = f"{value:.1e}".split("e")
        return f"{mantissa}e{int(exponent)}"
    return f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"


def estimate_text(estimate: Estimate, unit: str = "") -> str:
    """A value with its interval: `3.9e-4 [3.1e-4, 4.6e-4]`."""
    if not estimate.has_interval:
        return number(estimate.value, unit)
    return f"{number(estimate.value, unit)} [{number(estimate.low, unit)}, {number(estimate.high, unit)}]"


def _block(lines: pd.DataFrame) -> list[list[Cell]]:
    best = _best(lines)
    block = []
    lines = lines.sort_values(["reference", "completer"], ascending=[False, True])
    for position, (_, line) in enumerate(lines.iterrows()):
        reference = bool(line["reference"])
        estimates = [
            Cell(
                estimate_text(Estimate(line[name], line[f"{name}_low"], line[f"{name}_high"]), line["unit"]),
                bold=bool(line["completer"] in best) and name == line["summary"],
                italic=reference,
            )
            for name in ("median", "p90", "mean")
        ]
        block.append(
            [
                Cell("" if position else level_text(line["level"], lines["missing"].mean())),
                Cell(line["completer"], bold=line["completer"] in best, italic=reference, named=True),
                *estimates,
                Cell(_cases(line["cases"], line["failed"], line["skipped"])),
                Cell("" if math.isnan(line["seconds"]) else f"{line['seconds']:.2f}"),
            ]
        )
    return block


def _best(lines: pd.DataFrame) -> set[str]:
    """The best of the completers that are no references, by the metric's own statistic, over as many cases as any of
    them has; equals share it.
    """
    ranked = lines[(lines["metric"] != "") & ~lines["reference"].astype(bool)]
    if ranked.empty:
        return set()
    ranked = ranked[ranked["cases"] == ranked["cases"].max()]
    first = ranked.iloc[0]
    values = ranked[first["summary"]].astype(float)
    best = values.min() if first["direction"] == "lower" else values.max()
    return set(ranked["completer"][values == best])


def _cases(measured: int, failed: int, skipped: int) -> str:
    lost = [f"{count} {status}" for count, status in ((failed, "failed"), (skipped, "skipped")) if count]
    return f"{measured}" + (f" ({', '.join(lost)})" if lost else "")
