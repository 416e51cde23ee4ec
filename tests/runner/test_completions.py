"""Cached completions: the same cloud back, a size that holds, and no trust in damaged files."""

import os

import numpy as np
import pytest

from pcdbench.cloud import PointCloud
from pcdbench.runner.completions import Completion, CompletionCache

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


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a zip", None])
def test_a_damaged_file_is_a_completion_to_be_made_again(tmp_path, damage):
    cache = CompletionCache(tmp_path, limit_mb=10)
    cache.put("key", completion(0))
    path = cache._path("key")
    path.write_bytes(path.read_bytes()[:5000] if damage is None else damage)
    assert cache.get("key") is None
    cache.put("key", completion(1))
    assert cache.get("key") is not None
