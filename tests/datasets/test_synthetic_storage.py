"""Generated scenes on disk: whole or not there, and a disk that takes nothing costs a warning alone."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest

from pcdbench.datasets.synthetic.storage import read_arrays, write_arrays
from pcdbench.errors import CacheWarning


def test_arrays_come_back_and_a_torn_file_is_none(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "scene.npz"
    write_arrays(path, {"points": np.arange(6.0).reshape(2, 3)})
    arrays = read_arrays(path)
    assert arrays is not None
    assert arrays["points"].tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    path.write_bytes(path.read_bytes()[:-10])
    assert read_arrays(path) is None


def test_a_full_disk_costs_a_warning_and_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.warns(CacheWarning, match="No space left"):
        write_arrays(tmp_path / "scene.npz", {"points": np.zeros(3)})
    assert list(tmp_path.iterdir()) == []
