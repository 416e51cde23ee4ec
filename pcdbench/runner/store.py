"""Where a run's rows live: a folder with `run.json` and `rows.jsonl`, appended and synced, never rewritten."""

from __future__ import annotations

import contextlib
import json
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from filelock import FileLock, Timeout

from pcdbench.errors import PcdbenchError, RunWarning
from pcdbench.files import UNFINISHED, whole_file
from pcdbench.runner.rows import SCHEMA_VERSION, Row
from pcdbench.runner.stored_rows import StoredRows

ROWS = "rows.jsonl"
RUN = "run.json"
# In `run.json`: how many rows it will have when it is finished.
PLANNED_ROWS = "planned_rows"
# Likewise: the circumstances of rows measured elsewhere than where the run began, by the `host` of those rows.
ELSEWHERE = "elsewhere"
_LOCK = ".lock"
# Paths that are not UTF-8, and what is said of them, hold lone surrogates: no reason to lose a row.
_UNENCODABLE = "replace"
_SHOWN_DIFFERENCES = 3
_SHOWN_RUNS = 12
_KINDS = {
    "completers": "completer",
    "tasks": "task",
    "incompletenesses": "incompleteness",
    "scenes": "scene",
}


class RunStore:
    """A run's folder, held by this process alone while the `with` block lasts.

    Args:
        folder: made where it does not exist.
        configuration: everything that decides the run's rows (see `Plan.configuration`).
        facts: what else `run.json` says of the run, whether or not anything is measured: its command, say.

    Raises:
        PcdbenchError: where the folder cannot be written, is in use, or holds another run.
    """

    def __init__(self, folder: Path, configuration: Mapping[str, Any], facts: Mapping[str, Any]) -> None:
        self.folder = folder
        self._configuration = configuration
        self._facts = facts

    def __enter__(self) -> RunStore:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock = claimed(self.folder)
        except OSError as error:
            raise PcdbenchError(f"{self.folder} cannot be written ({error.strerror}); give another --out") from error
        try:
            self._claim()
            _drop_torn_line(self.folder / ROWS)
            self._rows = (self.folder / ROWS).open("ab", buffering=0)
        except OSError as error:
            self._lock.release()
            raise PcdbenchError(
                f"{self.folder} cannot be written ({error.strerror}); make room there, or give another --out"
            ) from error
        except BaseException:
            self._lock.release()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._rows.close()
        self._lock.release()

    def append(self, rows: Iterable[Row]) -> None:
        """Add rows; they are on the disk when this returns.

        Raises:
            PcdbenchError: where they cannot be written (a full disk, say). None of them is in the file then, and
                all earlier ones are.
        """
        lines = "".join(json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n" for row in rows)
        whole = self._rows.seek(0, os.SEEK_END)
        try:
            left = memoryview(lines.encode(errors=_UNENCODABLE))
            while left:
                left = left[self._rows.write(left) or 0 :]
            os.fsync(self._rows.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):
                self._rows.truncate(whole)
            raise PcdbenchError(
                f"{self.folder / ROWS} cannot be written ({error.strerror}); all cells before are stored: make room "
                "there and give the same command again"
            ) from error

    def rows(self) -> StoredRows:
        """The rows so far."""
        return read_rows(self.folder)

    def record(self, host: str, circumstances: Mapping[str, Any]) -> None:
        """Have `run.json` say how the rows to come are measured, beside what it says of those of other hosts.

        Args:
            host: of this machine, as in its rows.
            circumstances: time, machine, its calibration and the like; always the same names.
        """
        if self._rows.seek(0, os.SEEK_END) == 0 or self._facts.get("host") == host:
            self._facts = {**self._facts, "host": host, **circumstances}
        else:
            self._facts = {**self._facts, ELSEWHERE: {**self._facts.get(ELSEWHERE, {}), host: dict(circumstances)}}
        self._write_run()

    def _claim(self) -> None:
        if (self.folder / RUN).exists():
            told = read_run(self.folder)
            held = told.pop("configuration", {})
            # Not by digests: the order in which completers or tasks were named decides nothing.
            if differences := _differences(held, self._configuration):
                shown = "; ".join(differences[:_SHOWN_DIFFERENCES])
                more = f"; and {len(differences) - _SHOWN_DIFFERENCES} more" * (len(differences) > _SHOWN_DIFFERENCES)
                raise PcdbenchError(f"{self.folder} holds another run ({shown}{more}); give another --out")
            self._facts = {**told, **self._facts}
        elif (self.folder / ROWS).exists():
            raise PcdbenchError(f"{self.folder} has {ROWS} but no {RUN}; give another --out")
        for torn in self.folder.glob(UNFINISHED):
            torn.unlink()
        self._write_run()

    def _write_run(self) -> None:
        content = {**self._facts, "schema_version": SCHEMA_VERSION, "configuration": self._configuration}
        write_text(self.folder / RUN, json.dumps(content, indent=2, ensure_ascii=False) + "\n")


def claimed(folder: Path) -> FileLock:
    """The lock of a folder that is there: until it is released, or this process ends, no other one gets it.

    Raises:
        PcdbenchError: where another one has it.
        OSError: where the folder cannot be written.
    """
    lock = FileLock(folder / _LOCK)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise PcdbenchError(
            f"{folder} is in use by another pcdbench; wait for it to end or give another --out"
        ) from None
    return lock


def read_run(folder: Path) -> dict[str, Any]:
    """What `run.json` of a run's folder says.

    Raises:
        PcdbenchError: where there is no run, or one of a newer pcdbench.
    """
    path = folder / RUN
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError("it holds no JSON object")
        version = content.get("schema_version", 0)
        if not isinstance(version, int) or not isinstance(content.get("configuration", {}), dict):
            raise ValueError("its schema_version or configuration is of another kind")
    except (FileNotFoundError, NotADirectoryError):
        held = sorted(str(its.parent) for its in folder.glob(f"*/{RUN}"))
        if held:
            more = ", ..." if len(held) > _SHOWN_RUNS else ""
            shown = ", ".join(held[:_SHOWN_RUNS]) + more
            raise PcdbenchError(f"{folder} is not a run but holds some: {shown}; give one of them") from None
        raise PcdbenchError(f"{folder} is not a run: it has no {RUN}; runs lie in runs/ or where --out said") from None
    except (OSError, ValueError, RecursionError) as error:
        raise PcdbenchError(f"{path} cannot be read ({error}); run its command again into another folder") from None
    if version > SCHEMA_VERSION:
        raise PcdbenchError(f"{path} was written by a newer pcdbench; update this one (pip install -U pcdbench)")
    return content


def read_rows(folder: Path) -> StoredRows:
    """The rows of a run, in the order of their first appearance; of two with one key the newest counts.

    Raises:
        PcdbenchError: where a line is damaged. A last line without its end is a write that was cut off:
            it is left out.
    """
    return StoredRows(folder / ROWS)


def warn_of_missing_rows(folder: Path, facts: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    """`RunWarning` where a run has fewer rows than it was to have: its figures are of other cases than they seem."""
    planned = facts.get(PLANNED_ROWS)
    if isinstance(planned, int) and len(rows) < planned:
        told = f"{folder} has {len(rows):,} of its {planned:,} rows: it is not finished; its command (in {RUN}) goes on"
        warnings.warn(told, RunWarning, stacklevel=3)


def write_text(path: Path, text: str) -> None:
    """Write a file so that it appears complete or not at all; what UTF-8 cannot say becomes a question mark."""
    with whole_file(path, sync=True) as unfinished:
        unfinished.write_text(text, encoding="utf-8", errors=_UNENCODABLE)


def _drop_torn_line(path: Path) -> None:
    """Cut off a last line whose writing was interrupted: its cell runs again."""
    if not path.exists():
        return
    with path.open("rb+") as stream:
        end = stream.seek(0, os.SEEK_END)
        kept = end
        while kept > 0:
            start = max(0, kept - 65536)
            stream.seek(start)
            newline = stream.read(kept - start).rfind(b"\n")
            if newline >= 0:
                kept = start + newline + 1
                break
            kept = start
        if kept < end:
            stream.truncate(kept)


def _differences(held: Any, wanted: Any, *where: str) -> list[str]:
    """What that run has and this one does not, and the reverse, in words: one text for each difference.

    Args:
        where: the keys that lead to both.
    """
    if isinstance(held, dict) and isinstance(wanted, dict):
        return [
            difference
            for key in {**held, **wanted}
            for difference in _differences(held.get(key), wanted.get(key), *where, key)
        ]
    if (
        isinstance(held, list)
        and isinstance(wanted, list)
        and all(isinstance(its, dict) and "name" in its for its in held + wanted)
    ):
        return _differences({its["name"]: its for its in held}, {its["name"]: its for its in wanted}, *where)
    if json.dumps(held) == json.dumps(wanted):
        return []
    if len(where) == 2 and where[0] in _KINDS and (held is None or wanted is None):
        has, has_not = ("this run", "that one") if held is None else ("that run", "this one")
        return [f"{has} has the {_KINDS[where[0]]} {where[1]}, {has_not} does not"]
    if where[-1] == "code" and len(where) > 1:
        owner = "the data set" if where[-2] == "dataset" else where[-2]
        return [f"the code of {owner} has changed"]
    owner, *keys = where[1:] if where[0] in _KINDS and len(where) > 1 else where
    what = f"{' '.join(keys)} of {owner}" if keys else owner
    return [f"{what}: {_short(held)} in that run, {_short(wanted)} in this one"]


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return str(value.get("name", "given"))
    text = "none" if value is None else json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
