"""Keys are the same on every machine and in every release; threads follow the share a worker was given."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pcdbench.cli import app
from pcdbench.errors import PcdbenchError
from pcdbench.keys import canonical_json, digest, file_digest, seed_from
from pcdbench.paths import cache_dir
from pcdbench.threads import at_once, children_limited, limit_threads, thread_count

VALUE = {"b": [1, 2.5, True, None], "a": {"ü": "text"}}


def test_the_canonical_text_is_pinned() -> None:
    assert canonical_json(VALUE) == '{"a":{"ü":"text"},"b":[1,2.5,true,null]}'


def test_digests_are_pinned_because_stored_results_are_found_by_them() -> None:
    # From `printf '%s' TEXT | sha256sum` of the canonical texts.
    assert digest(VALUE) == "bed412df2cc1cbb9fe743eca107e4479a1a72773c364ee73265ff6aceebb8811"
    assert digest([]) == "4f53cda18c2baa0c0354bb5f9a3ecbe5ed12ab4d8e11ba873c2f11161202b945"


def test_seeds_are_pinned_and_fit_63_bits() -> None:
    # The first 16 hex digits of the digest of ["case", 3, 0.1], halved.
    assert seed_from("case", 3, 0.1) == 6582458657496472809
    assert all(0 <= seed_from(part) < 2**63 for part in range(1000))
    assert len({seed_from(part) for part in range(1000)}) == 1000


def test_keys_do_not_depend_on_the_order_of_a_mapping_but_on_that_of_a_list() -> None:
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    assert digest([1, 2]) != digest([2, 1])
    assert seed_from("a", "b") != seed_from("ab")
    assert digest({"level": 1}) != digest({"level": "1"})


def test_paths_that_are_not_utf8_have_keys_of_their_own() -> None:
    assert len({digest(os.fsdecode(name)) for name in (b"B\xfcro", b"B\xf6ro", b"B?ro", "Büro".encode())}) == 4


def test_nan_has_no_key() -> None:
    with pytest.raises(ValueError):
        digest({"x": float("nan")})


def test_a_files_digest_is_that_of_its_bytes(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"abc")
    assert file_digest(path) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_the_cache_is_where_the_variable_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "here"))
    assert cache_dir() == tmp_path / "here"
    monkeypatch.delenv("PCDBENCH_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_dir() == tmp_path / "pcdbench"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_dir() == tmp_path / ".cache" / "pcdbench"


def test_without_a_share_all_cores_of_the_process_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PCDBENCH_THREADS", raising=False)
    assert thread_count() == len(os.sched_getaffinity(0))


def test_a_share_is_kept_and_passed_to_the_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("PCDBENCH_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(variable, "7")
    monkeypatch.setenv("NUMEXPR_NUM_THREADS", "7")
    limit_threads(3)
    assert thread_count() == 3
    assert os.environ["OMP_NUM_THREADS"] == os.environ["OPENBLAS_NUM_THREADS"] == os.environ["MKL_NUM_THREADS"] == "3"


def test_children_find_their_share_and_the_parent_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PCDBENCH_THREADS", "7")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with children_limited(1):
        code = "import os; print(os.environ['PCDBENCH_THREADS'], os.environ['OMP_NUM_THREADS'])"
        assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "1 1\n"
    assert os.environ["PCDBENCH_THREADS"] == "7"
    assert "OMP_NUM_THREADS" not in os.environ


def test_an_empty_share_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PCDBENCH_THREADS", "")
    assert thread_count() == len(os.sched_getaffinity(0))


@pytest.mark.parametrize("nonsense", ["many", "-1", "0", "\N{SUPERSCRIPT TWO}"])
def test_a_share_that_is_no_count_is_refused_by_every_command(monkeypatch: pytest.MonkeyPatch, nonsense: str) -> None:
    monkeypatch.setenv("PCDBENCH_THREADS", nonsense)
    with pytest.raises(PcdbenchError, match="must be a number of threads"):
        thread_count()
    ended = CliRunner().invoke(app, ["list"])
    assert (ended.exit_code, ended.stdout) == (2, "")
    assert ended.stderr.startswith(f"pcdbench: PCDBENCH_THREADS={nonsense} must be") and ended.stderr.count("\n") == 1


@pytest.mark.parametrize("share", ["1", "2", "8"])
def test_work_done_at_once_returns_in_order_and_raises(monkeypatch: pytest.MonkeyPatch, share: str) -> None:
    monkeypatch.setenv("PCDBENCH_THREADS", share)
    found = at_once(*(lambda number=number: (number, threading.get_ident()) for number in range(5)))
    assert [number for number, _ in found] == [0, 1, 2, 3, 4]
    assert (share == "1") == ({thread for _, thread in found} == {threading.get_ident()})
    assert at_once() == []
    with pytest.raises(ZeroDivisionError):
        at_once(lambda: 1, lambda: 1 // 0)


def test_work_done_at_once_overlaps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PCDBENCH_THREADS", "2")
    both = threading.Barrier(2, timeout=30)
    assert sorted(at_once(both.wait, both.wait)) == [0, 1]
