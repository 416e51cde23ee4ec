"""Files that are whole or not there, and a cache that takes nothing and costs a warning alone."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from pcdbench.errors import CacheWarning
from pcdbench.files import UNFINISHED, keep, read_arrays, whole_file, write_arrays


def test_a_file_is_the_old_one_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), whole_file(path) as unfinished:
        unfinished.write_text("ne")
        raise KeyboardInterrupt
    assert [(its.name, its.read_text()) for its in tmp_path.iterdir()] == [("cloud.ply", "old")]
    with whole_file(path) as unfinished:
        unfinished.write_text("new")
        assert unfinished.match(UNFINISHED) and unfinished.suffix == ".ply" and path.read_text() == "old"
    assert [(its.name, its.read_text()) for its in tmp_path.iterdir()] == [("cloud.ply", "new")]


def test_what_fails_while_a_file_is_written_names_it(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    with pytest.raises(OSError, match=rf"No space left on device: '{path}'$"), whole_file(path):
        raise OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(OSError, match=r"^handle is closed$"), whole_file(path):
        raise OSError("handle is closed")


def test_a_file_is_synced_before_it_takes_the_old_ones_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.json"
    path.write_text("old")
    synced = []
    monkeypatch.setattr("os.fsync", lambda descriptor: synced.append((os.fstat(descriptor).st_size, path.read_text())))
    for sync in (True, False):
        with whole_file(path, sync=sync) as unfinished:
            unfinished.write_text("newer")
    assert synced == [(5, "old")]


def test_a_folder_that_cannot_be_made_costs_a_warning(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.warns(CacheWarning, match=r"is not kept: .*file/deep cannot be written \(Not a directory\)"):
        keep(tmp_path / "file" / "deep" / "digest", lambda path: path.write_text("x"))


def test_arrays_come_back_and_a_torn_file_is_none(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "scene.npz"
    write_arrays(path, {"points": np.arange(6.0).reshape(2, 3)})
    arrays = read_arrays(path)
    assert arrays is not None
    assert arrays["points"].tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    whole = path.read_bytes()
    path.write_bytes(whole[:-10])
    assert read_arrays(path) is None
    entry = whole.index(b"PK\x01\x02")
    for what, flipped in (("encrypted", entry + 8), ("compressed otherwise", entry + 10)):
        path.write_bytes(whole[:flipped] + b"\x01" + whole[flipped + 1 :])
        assert read_arrays(path) is None, what


def test_a_full_disk_costs_a_warning_and_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.warns(CacheWarning, match="No space left"):
        write_arrays(tmp_path / "scene.npz", {"points": np.zeros(3)})
    assert list(tmp_path.iterdir()) == []
