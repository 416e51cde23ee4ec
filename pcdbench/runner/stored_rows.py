"""The rows of a run, read from their file one by one: a run may have more of them than memory holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, overload

import orjson

from pcdbench.errors import PcdbenchError
from pcdbench.runner.rows import Row

_FINISHED = ("ok", "skipped")


class _Place(NamedTuple):
    """Where in the file a row is, and whether its cell need not run again."""

    offset: int
    length: int
    finished: bool


class StoredRows(Sequence[Row]):
    """The rows of a file as they are when this is made, in the order of their first appearance.

    Of two rows with one key the newest counts. Only where they lie is remembered; each look at a row reads it.

    Args:
        path: a `rows.jsonl`; rows may be appended to it meanwhile. Where there is none, there are no rows.

    Raises:
        PcdbenchError: where the file cannot be read or a line is damaged. A last line without its end is a write
            that was cut off: it is left out.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._places = _places(path)
        except FileNotFoundError:
            self._places = {}
        except OSError as error:
            raise PcdbenchError(f"{path} cannot be read ({error.strerror}); check the file and its folder") from None
        self._in_order = tuple(self._places.values())

    @property
    def finished_keys(self) -> set[str]:
        """Keys of the rows that need not run again: those measured, and those skipped for a reason."""
        return {key for key, place in self._places.items() if place.finished}

    def __len__(self) -> int:
        return len(self._in_order)

    def __iter__(self) -> Iterator[Row]:
        return self._read(self._in_order)

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> list[Row]: ...
    def __getitem__(self, index: int | slice) -> Row | list[Row]:
        if isinstance(index, slice):
            return list(self._read(self._in_order[index]))
        return next(self._read((self._in_order[index],)))

    def _read(self, places: Sequence[_Place]) -> Iterator[Row]:
        if places:
            with self._path.open("rb") as stream:
                for place in places:
                    stream.seek(place.offset)
                    yield orjson.loads(stream.read(place.length))


def _places(path: Path) -> dict[str, _Place]:
    """Where the newest row of each key is, in the order in which keys first appear."""
    places: dict[str, _Place] = {}
    offset = 0
    with path.open("rb") as stream:
        for number, line in enumerate(stream, start=1):
            if not line.endswith(b"\n"):
                break
            try:
                row = orjson.loads(line)
                places[row["key"]] = _Place(offset, len(line), row.get("status") in _FINISHED)
            except (ValueError, KeyError, TypeError, AttributeError):
                raise PcdbenchError(f"{path}, line {number}, is damaged; delete that line and run again") from None
            offset += len(line)
    return places
