"""Cached completions: the same cloud back, a size that holds, and no trust in damaged files."""

import errno
import os
import time
import warnings

import numpy as np
import pytest

from pcdbench.cloud import PointCloud
from pcdbench.errors import CacheWarning, PcdbenchError
from pcdbench.runner.completions import Completion, CompletionCache
from pcdbench.runner.plan import Request, plan
from pcdbench.runner.run import carry_out

FACTS = {"seconds": 1.5, "peak_memory_mb": None, "device": "cpu"}


def completion(seed: int, color: bool = True, count: int = 1000) -> Completion:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3)) * 1e6
    return Completion(PointCloud(points, rng.random((count, 3)) if color else None), FACTS)


@pytest.mark.parametrize("color", [True, False])
def test_a_completion_comes_back_bit_by_bit(tmp_path, color):
    cache = CompletionCache(tmp_path, limit_mb=10)
    stored = completion(0, color)
    cache.put("ab12", stored)
    found = cache.get("ab12")
    assert np.array_equal(found.cloud.points, stored.cloud.points)
    assert (found.cloud.colors is not None) == color
    if color:
        assert np.array_equal(found.cloud.colors, stored.cloud.colors)
    assert found.facts == FACTS
    assert cache.get("ab13") is None


def test_the_longest_unused_is_dropped_beyond_the_limit(tmp_path):
    cache = CompletionCache(tmp_path, limit_mb=10)
    for number in range(4):
        cache.put(f"{number}key", completion(number))
        os.utime(cache._path(f"{number}key"), (number, number))
    assert cache.get("0key") is not None
    size = cache._path("0key").stat().st_size
    CompletionCache(tmp_path, limit_mb=2.5 * size / 1e6).trim()
    assert [cache.get(f"{number}key") is not None for number in range(4)] == [True, False, False, True]


def test_putting_keeps_the_limit_without_being_told(tmp_path):
    cache = CompletionCache(tmp_path, limit_mb=0.2)
    for number in range(30):
        cache.put(f"{number}key", completion(number))
    files = list(tmp_path.rglob("*.npz"))
    assert len(files) >= 1 and sum(file.stat().st_size for file in files) <= 0.25e6


def test_a_limit_of_nothing_keeps_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("PCDBENCH_COMPLETIONS_MB", "0")
    cache = CompletionCache(tmp_path)
    cache.put("key", completion(0))
    assert not list(tmp_path.rglob("*"))


def test_a_limit_of_nothing_drops_nothing_that_others_keep(tmp_path, monkeypatch):
    CompletionCache(tmp_path, limit_mb=10).put("key", completion(0))
    monkeypatch.setenv("PCDBENCH_COMPLETIONS_MB", "0")
    CompletionCache(tmp_path).trim()
    assert CompletionCache(tmp_path, limit_mb=10).get("key") is not None


def test_a_limit_without_end_keeps_everything(tmp_path, monkeypatch):
    monkeypatch.setenv("PCDBENCH_COMPLETIONS_MB", "inf")
    cache = CompletionCache(tmp_path)
    for number in range(3):
        cache.put(f"{number}key", completion(number))
    cache.trim()
    assert all(cache.get(f"{number}key") is not None for number in range(3))


@pytest.mark.parametrize("text", ["nan", "-1", "4 GB"])
def test_a_limit_that_is_none_is_one_line_before_anything_runs(tmp_path, monkeypatch, tiny_plugins, text):
    monkeypatch.setenv("PCDBENCH_COMPLETIONS_MB", text)
    planned = plan(Request(["tiny_fill"], ["tiny_gap"], "tiny", incompletenesses=["slab"]))
    with pytest.raises(PcdbenchError, match=f"PCDBENCH_COMPLETIONS_MB is '{text}'; give megabytes") as error:
        carry_out(planned, tmp_path / "run")
    assert "\n" not in str(error.value) and not (tmp_path / "run").exists()


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a zip", None])
def test_a_damaged_file_is_a_completion_to_be_made_again(tmp_path, damage):
    cache = CompletionCache(tmp_path, limit_mb=10)
    cache.put("key", completion(0))
    path = cache._path("key")
    path.write_bytes(path.read_bytes()[:5000] if damage is None else damage)
    assert cache.get("key") is None
    cache.put("key", completion(1))
    assert cache.get("key") is not None


def test_a_full_disk_costs_the_cache_and_is_told_once(tmp_path, monkeypatch):
    cache = CompletionCache(tmp_path, limit_mb=10)

    def full(stream, **arrays):
        stream.write(b"PK")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "savez", full)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for number in range(3):
            cache.put(f"{number}key", completion(number))
    assert [str(its.message) for its in caught] == [
        f"completed clouds are not kept: {tmp_path} cannot be written (No space left on device)"
    ]
    assert caught[0].category is CacheWarning
    assert cache.get("0key") is None
    assert not [path for path in tmp_path.rglob("*") if path.is_file()], "no half file is left"


def test_what_killed_runs_left_half_written_goes_after_an_hour(tmp_path):
    (tmp_path / "ab").mkdir()
    old, new = (tmp_path / "ab" / f".unfinished-{age}.npz" for age in ("old", "new"))
    for path, age_seconds in ((old, 4000), (new, 10)):
        path.write_bytes(b"PK")
        os.utime(path, (time.time() - age_seconds,) * 2)
    CompletionCache(tmp_path, limit_mb=1e-6).trim()
    assert not old.exists() and new.exists()
