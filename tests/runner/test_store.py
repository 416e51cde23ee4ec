"""A run's folder: rows outlive crashes, and one run at a time writes to it."""

import errno
import json
import os

import pytest

from pcdbench.errors import PcdbenchError
from pcdbench.runner.store import RunStore, read_rows, read_run

CONFIGURATION = {"levels": [0.1], "completers": [{"name": "a", "version": "1", "code": "x"}]}


def row(key: str, status: str = "ok", value: int = 0) -> dict:
    return {"key": key, "status": status, "value": value}


def test_rows_and_run_come_back(tmp_path):
    with RunStore(tmp_path / "run", CONFIGURATION, {"command": "pcdbench run"}) as store:
        store.append([row("a"), row("b", "skipped")])
        store.append([row("c", "failed")])
        assert store.rows().finished_keys == {"a", "b"}
    assert [found["key"] for found in read_rows(tmp_path / "run")] == ["a", "b", "c"]
    assert read_run(tmp_path / "run")["configuration"] == CONFIGURATION


def test_what_utf8_cannot_say_is_stored_with_question_marks(tmp_path):
    unread = row("a", "failed") | {"error": "caf\udce9.ply has no points"}
    with RunStore(tmp_path, CONFIGURATION, {"command": "pcdbench run --out caf\udce9"}) as store:
        store.append([unread, row("b")])
    assert list(read_rows(tmp_path)) == [row("a", "failed") | {"error": "caf?.ply has no points"}, row("b")]
    assert read_run(tmp_path)["command"] == "pcdbench run --out caf?"


def test_the_newest_row_of_a_key_counts_and_older_ones_stay_in_the_file(tmp_path):
    with RunStore(tmp_path, CONFIGURATION, {}) as store:
        store.append([row("a", "failed", 1), row("b")])
        store.append([row("a", "ok", 2)])
    assert list(read_rows(tmp_path)) == [row("a", "ok", 2), row("b")]
    assert len((tmp_path / "rows.jsonl").read_text().splitlines()) == 3


@pytest.mark.parametrize("torn", [b'{"key": "c", "sta', b'{"key": "c", "status": "ok"}', b"\x00" * 70000])
def test_a_torn_last_line_is_left_out_and_healed(tmp_path, torn):
    with RunStore(tmp_path, CONFIGURATION, {}) as store:
        store.append([row("a"), row("b")])
    with (tmp_path / "rows.jsonl").open("ab") as stream:
        stream.write(torn)
    assert [found["key"] for found in read_rows(tmp_path)] == ["a", "b"]
    with RunStore(tmp_path, CONFIGURATION, {}) as store:
        store.append([row("d")])
    assert [json.loads(line)["key"] for line in (tmp_path / "rows.jsonl").read_text().splitlines()] == ["a", "b", "d"]


def test_a_file_that_is_one_torn_line_is_healed_to_nothing(tmp_path):
    with RunStore(tmp_path, CONFIGURATION, {}):
        pass
    (tmp_path / "rows.jsonl").write_bytes(b'{"key"')
    with RunStore(tmp_path, CONFIGURATION, {}):
        assert (tmp_path / "rows.jsonl").read_bytes() == b""


def test_a_damaged_line_is_named(tmp_path):
    with RunStore(tmp_path, CONFIGURATION, {}) as store:
        store.append([row("a")])
    with (tmp_path / "rows.jsonl").open("ab") as stream:
        stream.write(b"nonsense\n" + json.dumps(row("b")).encode() + b"\n")
    with pytest.raises(PcdbenchError, match=r"rows\.jsonl, line 2, is damaged"):
        read_rows(tmp_path)


def test_a_second_run_is_refused_while_the_first_lasts(tmp_path):
    second = RunStore(tmp_path, CONFIGURATION, {})
    with RunStore(tmp_path, CONFIGURATION, {}), pytest.raises(PcdbenchError, match="is in use by another"), second:
        pass
    with RunStore(tmp_path, CONFIGURATION, {}):
        pass


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        ({"levels": [0.1, 0.3]}, r"\(levels: \[0\.1\] in that run, \[0\.1, 0\.3\] in this one\); give"),
        (
            {"completers": [{"name": "b", "version": "1", "code": "x"}]},
            r"\(that run has the completer a, this one does not; this run has the completer b, that one does not\)",
        ),
        ({"seed": 1}, r"\(seed: none in that run, 1 in this one\)"),
        (
            {"completers": [{"name": "a", "version": "2", "code": "x"}]},
            r'\(version of a: "1" in that run, "2" in this one\)',
        ),
        ({"completers": [{"name": "a", "version": "1", "code": "y"}]}, "the code of a has changed"),
    ],
)
def test_another_run_is_not_mixed_in_and_the_difference_is_named(tmp_path, change, difference):
    with RunStore(tmp_path, CONFIGURATION, {}) as store:
        store.append([row("a")])
    with pytest.raises(PcdbenchError, match=difference), RunStore(tmp_path, CONFIGURATION | change, {}):
        pass
    with RunStore(tmp_path, CONFIGURATION, {}) as store:
        assert store.rows().finished_keys == {"a"}


def test_in_which_order_plugins_were_named_makes_no_other_run(tmp_path):
    both = [{"name": name, "version": "1", "code": "x"} for name in "ab"]
    with RunStore(tmp_path, CONFIGURATION | {"completers": both}, {}) as store:
        store.append([row("a")])
    with RunStore(tmp_path, CONFIGURATION | {"completers": both[::-1]}, {}) as store:
        assert store.rows().finished_keys == {"a"}


def test_a_run_that_does_not_say_what_it_is_is_another_one(tmp_path):
    (tmp_path / "run.json").write_text('{"schema_version": 1}')
    with pytest.raises(PcdbenchError, match=r"holds another run \(levels: none in that run"):
        RunStore(tmp_path, {"levels": [0.1]}, {}).__enter__()


def test_another_run_of_a_completer_with_a_model_card_is_told_too(tmp_path):
    def completer(hours: float) -> dict:
        return {"completers": [{"name": "learned", "card": {"curve": [{"step": 1, "hours": hours}]}}]}

    with RunStore(tmp_path, completer(1.0), {}):
        pass
    with pytest.raises(PcdbenchError, match=r"holds another run \(card curve of learned: .* in that run"):
        RunStore(tmp_path, completer(2.0), {}).__enter__()


def test_a_run_without_what_others_have_is_told_too(tmp_path):
    with RunStore(tmp_path, {"code": "1"}, {}):
        pass
    with pytest.raises(PcdbenchError, match=r"holds another run \(code: \"1\" in that run, none in this one; scenes: "):
        RunStore(tmp_path, {"scenes": {"room": "digest"}}, {}).__enter__()


def test_what_is_no_run_is_said(tmp_path):
    with pytest.raises(PcdbenchError, match="is not a run"):
        read_run(tmp_path)
    (tmp_path / "run.json").write_text('{"schema_version": 99}')
    with pytest.raises(PcdbenchError, match="newer pcdbench"):
        read_run(tmp_path)


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PcdbenchError, match="cannot be written"), RunStore(tmp_path / "file" / "run", {}, {}):
        pass


class _FullDisk:
    """A file on a disk that has room for so many bytes."""

    def __init__(self, file, room):
        self._file = file
        self._room = room

    def write(self, data):
        written = self._file.write(bytes(data[: self._room]))
        self._room -= written
        if not written:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return written

    def __getattr__(self, name):
        return getattr(self._file, name)


def test_a_full_disk_is_one_line_and_costs_no_row_that_was_stored(tmp_path):
    with RunStore(tmp_path, CONFIGURATION, {}) as store:
        store.append([row("a"), row("b")])
        whole = (tmp_path / "rows.jsonl").read_bytes()
        store._rows = _FullDisk(store._rows, room=len(whole) - 10)
        with pytest.raises(PcdbenchError, match=r"rows\.jsonl cannot be written \(No space left on device\)") as caught:
            store.append([row("c"), row("d")])
        assert "\n" not in str(caught.value)
        assert (tmp_path / "rows.jsonl").read_bytes() == whole, "nothing torn is left behind"
    with RunStore(tmp_path, CONFIGURATION, {}) as store:
        store.append([row("c")])
    assert [found["key"] for found in read_rows(tmp_path)] == ["a", "b", "c"]


def test_rows_that_the_system_takes_in_pieces_arrive_whole(tmp_path):
    with RunStore(tmp_path, CONFIGURATION, {}) as store:
        file = store._rows
        store._rows = _FullDisk(file, 10**6)
        store._rows.write = lambda data: file.write(bytes(data[:7]))
        store.append([row("a"), row("b")])
    assert list(read_rows(tmp_path)) == [row("a"), row("b")]


def test_what_a_killed_run_left_half_written_is_swept_away(tmp_path):
    (tmp_path / ".unfinished-abcd.json").write_text('{"conf')
    with RunStore(tmp_path, CONFIGURATION, {}):
        assert not list(tmp_path.glob(".unfinished-*"))
