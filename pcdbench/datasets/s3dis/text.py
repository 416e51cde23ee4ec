"""The text files of S3DIS as numbers: `x y z red green blue` a line, lines with stray bytes mended or dropped."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pcdbench.dataset import Finding
from pcdbench.errors import CloudError

COLUMNS = 6
_NUMBER = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_STRAY = re.compile(rb"[^-+0-9.eE \t]")
# Every line of a wrong file is not told: the first few, and how many more.
_TOLD = 5


def read_rows(path: Path, shown: str) -> tuple[NDArray[np.float64], list[Finding]]:
    """The rows of a file, (N, 6), or (N, 3) where it has no colours, and what was wrong with it.

    Commas are read as decimal points. Bytes that belong to no number are taken out of a line, or stand for a blank
    where the line has too few numbers otherwise; a line that still does not hold its numbers, all finite, is dropped.

    Args:
        shown: what findings call the file.

    Raises:
        CloudError: where the file cannot be read at all.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CloudError(f"{path} cannot be read: {error.strerror}; check the file") from error
    columns = _columns(data)
    good = re.compile(rb"[ \t]*" + rb"[ \t]+".join([_NUMBER] * columns) + rb"[ \t\r]*")
    if not data.translate(None, b"0123456789.- \t\r\n"):
        rows = _parsed(data)
        if rows is not None and rows.shape[1] == columns and np.isfinite(rows).all():
            return rows, []
    lines = data.split(b"\n")
    kept, places, mended, dropped = [], [], [], []
    for number, line in enumerate(lines, 1):
        if good.fullmatch(line):
            kept.append(line)
            places.append(number)
        elif line.strip():
            repaired = _repaired(line, columns)
            if repaired is None:
                dropped.append((number, line))
            else:
                kept.append(repaired)
                places.append(number)
                mended.append((number, line))
    rows = _parsed(b"\n".join(kept)) if kept else None
    if rows is not None:
        # A number of 400 digits looks like any other.
        finite = np.isfinite(rows).all(axis=1)
        dropped = sorted(dropped + [(places[at], lines[places[at] - 1]) for at in np.flatnonzero(~finite)])
        rows = rows[finite]
    findings = [
        *_told(shown, [its for its in mended if b"," not in its[1]], "a stray byte in {}", "taken out"),
        *_told(
            shown, [its for its in mended if b"," in its[1]], "a comma in {}", "read as a decimal point, or a blank"
        ),
        *_told(shown, dropped, f"no {columns} finite numbers in {{}}", "the line is dropped"),
    ]
    return np.empty((0, columns)) if rows is None else rows, findings


def _columns(data: bytes) -> int:
    """Six where one of the first lines has six numbers or more, else three."""
    first = data[: 1 << 14].split(b"\n")[:100]
    return COLUMNS if any(len(line.split()) >= COLUMNS for line in first) else 3


def _parsed(data: bytes) -> NDArray[np.float64] | None:
    """The numbers of lines that hold as many each; None where they do not."""
    try:
        frame = pd.read_csv(io.BytesIO(data), sep=r"\s+", header=None, dtype=np.float64, engine="c")
    except (ValueError, pd.errors.EmptyDataError, pd.errors.ParserError):
        return None
    return frame.to_numpy()


def _repaired(line: bytes, columns: int) -> bytes | None:
    """The line with its stray bytes taken out, or made blanks; None where neither gives the numbers it should hold."""
    # Taken out, a decimal comma would make a thousand metres of one.
    with_points = line.rstrip(b"\r").replace(b",", b".")
    for words in (_STRAY.sub(b"", with_points).split(), _STRAY.sub(b" ", line.rstrip(b"\r")).split()):
        # Text that spells a number (nan, inf) is no stray byte.
        if re.search(rb"nan|inf", line, re.IGNORECASE) or len(words) != columns:
            continue
        try:
            if all(math.isfinite(float(word)) for word in words):
                return b" ".join(words)
        except ValueError:
            continue
    return None


def _told(shown: str, lines: list[tuple[int, bytes]], problem: str, done: str) -> list[Finding]:
    findings = [
        Finding(f"{shown}:{number}", problem.format(repr(line.decode("latin-1").strip(" \r")[:60])), done)
        for number, line in lines[:_TOLD]
    ]
    if len(lines) > _TOLD:
        findings.append(Finding(shown, f"{len(lines) - _TOLD:,} more lines like these", done))
    return findings
