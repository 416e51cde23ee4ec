"""Random numbers decided by integer coordinates alone: the same on every machine, in any order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Words = NDArray[np.uint64]

_FIRST, _SECOND, _STEP = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB), np.uint64(0x9E3779B97F4A7C15)


def hashed(*cells: ArrayLike) -> Words:
    """64 well-mixed bits from integers (scalars or (N,) arrays, negative ones too), by their order."""
    return _mixed(_absorbed(np.full(1, _STEP), *cells))


def uniform(*cells: ArrayLike) -> Floats:
    """Numbers in [0, 1) from integers, by their order."""
    return _fraction(hashed(*cells))


def _absorbed(state: Words, *cells: ArrayLike) -> Words:
    for cell in cells:
        state = _stirred(state, np.atleast_1d(np.asarray(cell)).astype(np.int64, copy=False).view(np.uint64) * _STEP)
    return state


def _stirred(state: Words, word: Words) -> Words:
    stirred = state ^ word
    stirred *= _FIRST
    stirred ^= stirred >> np.uint64(29)
    return stirred


def _mixed(state: Words) -> Words:
    """The finalizer of SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014)."""
    mixed = state ^ (state >> np.uint64(30))
    mixed *= _FIRST
    mixed ^= mixed >> np.uint64(27)
    mixed *= _SECOND
    mixed ^= mixed >> np.uint64(31)
    return mixed


def _fraction(state: Words) -> Floats:
    fraction = (state >> np.uint64(11)).astype(np.float64)
    fraction *= 2.0**-53
    return fraction


def value_noise(coordinates: Floats, *seeds: ArrayLike) -> Floats:
    """(N,) smooth noise in [0, 1) at (N, D) coordinates, one independent value a unit cell corner."""
    return _noise(coordinates, _absorbed(np.full(1, _STEP), *seeds))


def fractal_noise(coordinates: Floats, *seeds: ArrayLike, octaves: int = 3) -> Floats:
    """(N,) noise in [0, 1) with detail at half, a quarter, ... of the unit, each half as strong."""
    total, weight = np.zeros(len(coordinates)), 0.0
    seeded = _absorbed(np.full(1, _STEP), *seeds)
    for octave in range(octaves):
        total += _noise(coordinates * 2.0**octave, _absorbed(seeded, octave)) * 0.5**octave
        weight += 0.5**octave
    return total / weight


def _noise(coordinates: Floats, state: Words) -> Floats:
    """(N,) smooth noise at (N, D) coordinates, of one state or one a point."""
    axes = []
    for coordinate in coordinates.T:
        base = np.floor(coordinate)
        share = coordinate - base
        word = base.astype(np.int64).view(np.uint64) * _STEP
        axes.append((share * share * (3.0 - 2.0 * share), word, word + _STEP))
    return _interpolated(state, axes)


def _interpolated(state: Words, axes: Sequence[tuple[Floats, Words, Words]]) -> Floats:
    """Noise between the corners along the first axis of what lies between them along the others.

    Args:
        axes: how far along each axis a point is between its cell's two ends, 0 to 1, and the words of these ends.
    """
    if not axes:
        return _fraction(state)
    (share, low, high), others = axes[0], axes[1:]
    below = _interpolated(_stirred(state, low), others)
    above = _interpolated(_stirred(state, high), others)
    above -= below
    above *= share
    above += below
    return above
