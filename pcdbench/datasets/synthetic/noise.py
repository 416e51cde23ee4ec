"""Random numbers decided by integer coordinates alone: the same on every machine, in any order."""

from __future__ import annotations

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
        word = np.atleast_1d(np.asarray(cell)).astype(np.int64, copy=False).view(np.uint64)
        state = (state ^ (word * _STEP)) * _FIRST
        state = state ^ (state >> np.uint64(29))
    return state


def _mixed(state: Words) -> Words:
    """The finalizer of SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014)."""
    state = (state ^ (state >> np.uint64(30))) * _FIRST
    state = (state ^ (state >> np.uint64(27))) * _SECOND
    return state ^ (state >> np.uint64(31))


def _fraction(state: Words) -> Floats:
    return (state >> np.uint64(11)).astype(np.float64) * 2.0**-53


def value_noise(coordinates: Floats, *seeds: ArrayLike) -> Floats:
    """(N,) smooth noise in [0, 1) at (N, D) coordinates, one independent value a unit cell corner."""
    return _interpolated(_absorbed(np.full(1, _STEP), *seeds), coordinates)


def _interpolated(state: Words, coordinates: Floats) -> Floats:
    """Noise between the corners along the first axis of what lies between them along the others."""
    if coordinates.shape[1] == 0:
        return _fraction(state)
    base = np.floor(coordinates[:, 0])
    weight = coordinates[:, 0] - base
    weight = weight * weight * (3.0 - 2.0 * weight)
    cell = base.astype(np.int64)
    below = _interpolated(_absorbed(state, cell), coordinates[:, 1:])
    above = _interpolated(_absorbed(state, cell + 1), coordinates[:, 1:])
    return below + weight * (above - below)


def fractal_noise(coordinates: Floats, *seeds: ArrayLike, octaves: int = 3) -> Floats:
    """(N,) noise in [0, 1) with detail at half, a quarter, ... of the unit, each half as strong."""
    total, weight = np.zeros(len(coordinates)), 0.0
    for octave in range(octaves):
        total += value_noise(coordinates * 2.0**octave, *seeds, octave) * 0.5**octave
        weight += 0.5**octave
    return total / weight
