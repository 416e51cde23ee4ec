"""Rows read from their file one by one are those that a plain reader holds all at once."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pcdbench.errors import PcdbenchError
from pcdbench.runner.stored_rows import StoredRows


def plainly_read(path: Path) -> list[dict]:
    newest: dict[str, dict] = {}
    for line in path.read_bytes().decode().split("\n")[:-1]:
        row = json.loads(line)
        newest[row["key"]] = row
    return list(newest.values())


ROW = st.fixed_dictionaries(
    {
        "key": st.sampled_from("abcdefg"),
        "status": st.sampled_from(["ok", "failed", "skipped", "timeout"]),
        "value": st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**63), 2**63 - 1),
        "text": st.text(st.characters(exclude_categories=["Cs"])),
    }
)


@settings(max_examples=60, deadline=None)
@given(rows=st.lists(ROW, max_size=20), ascii=st.booleans(), torn=st.sampled_from([b"", b'{"key": "z"', b"\x00\x00"]))
def test_rows_are_those_of_a_plain_reader(
    tmp_path_factory: pytest.TempPathFactory, rows: list[dict], ascii: bool, torn: bytes
) -> None:
    path = tmp_path_factory.mktemp("rows") / "rows.jsonl"
    lines = "".join(json.dumps(row, ensure_ascii=ascii) + "\n" for row in rows)
    path.write_bytes(lines.encode() + torn)
    stored, plain = StoredRows(path), plainly_read(path)
    assert list(stored) == plain and len(stored) == len(plain)
    assert [stored[index] for index in range(-len(plain), len(plain))] == plain + plain
    assert stored[1:4] == plain[1:4]
    assert stored.finished_keys == {row["key"] for row in plain if row["status"] in ("ok", "skipped")}


def test_rows_appended_later_are_seen_by_the_next_reader(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    assert list(StoredRows(path)) == []
    path.write_text('{"key": "a", "status": "ok"}\n')
    before = StoredRows(path)
    with path.open("a") as stream:
        stream.write('{"key": "a", "status": "failed"}\n')
    assert [row["status"] for row in before] == ["ok"]
    assert [row["status"] for row in StoredRows(path)] == ["failed"]


@pytest.mark.parametrize("line", [b"nonsense", b"[1]", b"{}", b"7", b'{"key": NaN}', b'{"key": []}', b"[" * 10**5])
def test_a_damaged_line_is_named(tmp_path: Path, line: bytes) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_bytes(b'{"key": "a", "status": "ok"}\n' + line + b"\n")
    with pytest.raises(PcdbenchError, match=r"rows\.jsonl, line 2, is damaged"):
        StoredRows(path)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "rows.jsonl").mkdir()
    with pytest.raises(PcdbenchError, match=r"rows\.jsonl cannot be read \(Is a directory\)"):
        StoredRows(tmp_path / "rows.jsonl")


def test_a_large_file_is_not_held_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    with path.open("w") as stream:
        for number in range(1000):
            stream.write(json.dumps({"key": f"{number:064}", "status": "ok", "trace": "x" * 4000}) + "\n")
    tracemalloc.start()
    count = sum(1 for _ in StoredRows(path))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count == 1000
    assert peak < path.stat().st_size / 5
