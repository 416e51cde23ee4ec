"""A summary as text: tables for a terminal and for Markdown, records for JSON and CSV."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pcdbench.leaderboard.statistics import Estimate
from pcdbench.leaderboard.summary import level_text

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console
    from rich.table import Table as RichTable

    from pcdbench.leaderboard.audit import Audit

HEADER = ("level", "completer", "median [95 %]", "90th percentile [95 %]", "mean [95 %]", "cases", "seconds")
AUDIT_HEADER = ("level", "reference", "mean of cases [95 %]", "cases")
_STATISTICS = {"median": 2, "p90": 3, "mean": 4}  # their columns
_LEFT_COLUMNS = (1,)
_FOLDING_COLUMNS = (1, 5)  # names, and cases that failed and were skipped: as long as they may be
_ANY_WIDTH = 10_000
LEGEND = (
    "Bold: the best of a level's completers with the most cases. Italic: references, not methods. "
    "[95 %]: bootstrap interval over scenes. Seconds: median time of completing."
)
MARKED_LEGEND = LEGEND.replace("Bold", "**Bold**").replace("Italic", "*Italic*")


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
        return self._marked(escaped_markdown(self.text) if self.named else self.text)

    @property
    def plain(self) -> str:
        """For text without styles: marked as in Markdown."""
        return self._marked(self.text)

    def _marked(self, text: str) -> str:
        return f"**{text}**" if self.bold else f"*{text}*" if self.italic else text


@dataclass(frozen=True)
class Table:
    """A titled table in blocks: one a level.

    Attributes:
        spare: the columns that a terminal too narrow for all can do without.
    """

    title: str
    header: Sequence[str]
    blocks: Sequence[Sequence[Sequence[Cell]]]
    spare: Sequence[int] = ()


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
        declared = measured.iloc[0]["summary"] if len(measured) else "median"
        spare = [column for name, column in _STATISTICS.items() if name != declared]
        found.append(Table(title, HEADER, blocks, spare))
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
    """Print tables on a terminal; what stands out is marked where the console has no styles (a file, a pipe)."""
    from rich.measure import Measurement
    from rich.text import Text

    widest = 0
    for table in tables:
        console.print(Text(table.title, "bold"), soft_wrap=True)
        shown = _rich_table(table, (), has_styles(console))
        width = Measurement.get(console, console.options.update(max_width=_ANY_WIDTH), shown).maximum
        if table.spare and width > console.width:
            widest = max(widest, width)
            shown = _rich_table(table, table.spare, has_styles(console))
        console.print(shown)
    if widest:
        console.print(
            f"Here are {console.width} columns and the whole takes {widest}: each table has the statistic that its "
            "metric declares; --format markdown has all.",
            highlight=False,
        )


def _rich_table(table: Table, left_out: Sequence[int], styled: bool) -> RichTable:
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    shown = RichTable(box=box.SIMPLE_HEAD)
    columns = [column for column in range(len(table.header)) if column not in left_out]
    for column in columns:
        shown.add_column(
            table.header[column],
            justify="left" if column in _LEFT_COLUMNS else "right",
            no_wrap=not (left_out and column in _FOLDING_COLUMNS),
            overflow="fold",
        )
    for block in table.blocks:
        for line in block:
            cells = [line[column] for column in columns]
            shown.add_row(*(Text(cell.text if styled else cell.plain, cell.style) for cell in cells))
        shown.add_section()
    return shown


def has_styles(console: Console) -> bool:
    """Whether bold and italic show on it."""
    return console.color_system is not None


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
    return [
        {name: None if isinstance(value, float) and not math.isfinite(value) else value for name, value in line.items()}
        for line in frame.to_dict("records")
    ]


def number(value: float, unit: str = "") -> str:
    """A number for people: `3.9e-4`, `0.893`, `12.4`; metres with three decimals."""
    if math.isnan(value):
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
            for name in _STATISTICS
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
