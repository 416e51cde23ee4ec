"""What every format shares: columns of numbers that become points and colours, and colours that become bytes."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.errors import CloudError

# Float colours may overshoot 1 by rounding, by no more.
_ROUNDING = 1e-3
_COORDINATE_NAMES = (
    ("x", "y", "z"),
    ("points:0", "points:1", "points:2"),
    ("points_0", "points_1", "points_2"),
    ("easting", "northing", "elevation"),
    ("easting", "northing", "height"),
)
_COLOR_NAMES = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("rf", "gf", "bf"),
    *((f"{name}{mark}0", f"{name}{mark}1", f"{name}{mark}2") for name in ("rgb", "rgba") for mark in ":_"),
)
# What may follow a coordinate's name: X[m], x (ft), X_m, x coord.
_UNIT = re.compile(r"[ _]?[\[(]\w+[\])]$|[ _](?:mm|cm|m|ft|coord)$")
_PACKED_COLORS = ("rgb", "rgba")
LARGEST_FLOAT32_ERROR_M = 5e-5
# Compressed points that repeat each other take next to no room, and a small file could fill any memory. Real ones take
# more than a byte each; files of fewer points than this are small whatever they hold.
_ALWAYS_READ = 1_000_000

# Further numbers of each point, by name: (N,) or (N, K) of any numeric type.
Fields = Mapping[str, NDArray[Any]]
NO_FIELDS: Fields = {}


class _Everything:
    def __contains__(self, name: object) -> bool:
        return True


# Which fields are to be read.
EVERYTHING: Container[str] = _Everything()
NOTHING: Container[str] = ()


class CloudWarning(UserWarning):
    """Something about a file that its owner should know; reading went on. One line."""


@dataclass(frozen=True)
class Columns:
    """What a file holds: (N, 3) float64 coordinates, maybe not finite, (N, 3) float32 colours or None, and fields."""

    points: NDArray[np.float64]
    colors: NDArray[np.float32] | None
    fields: dict[str, NDArray[Any]] = field(default_factory=dict)


def coordinate_and_color_names(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Which of a file's column names are x, y, z and red, green, blue, as written there; [] where they are missing."""
    written = {name.strip("\"' ").lower(): name for name in reversed(names)}
    # Of one unit all three: x and y may be pixels where X_m, Y_m and Z_m follow.
    units = dict.fromkeys(["", *(unit.group() for unit in map(_UNIT.search, written) if unit)])
    by_unit = ({name.removesuffix(unit): written[name] for name in written if name.endswith(unit)} for unit in units)
    xyz = next(filter(None, (_first_of(_COORDINATE_NAMES, of_unit) for of_unit in by_unit)), [])
    return xyz, _first_of(_COLOR_NAMES, written)


def unit_of(name: str) -> str:
    """The unit in a coordinate's name, as written there; empty where there is none."""
    found = _UNIT.search(name.strip("\"' ").lower())
    return "" if found is None else found.group().strip(" _[]()").replace("coord", "")


def _first_of(candidates: Sequence[tuple[str, ...]], written: Mapping[str, str]) -> list[str]:
    """The first of the candidates that is there completely, as written; [] where none is."""
    found = (candidate for candidate in candidates if all(name in written for name in candidate))
    return [written[name] for name in next(found, ())]


def unit_colors(values: NDArray[Any], path: Path) -> NDArray[np.float32]:
    """Colours in [0, 1] from (N, 3) numbers: 8 and 16 bit integers by type, all others by their range.

    Raises:
        CloudError: where the values fit none of [0, 1], 0..255 and 0..65535.
    """
    if not values.size:
        return values.astype(np.float32)
    if values.dtype == np.uint8:
        return values.astype(np.float32) / np.float32(255)
    if values.dtype.kind == "f" and np.isnan(values).all():
        return values.astype(np.float32)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    # Many programs put 8-bit colours into 16-bit fields.
    is_integer = np.issubdtype(values.dtype, np.integer)
    if low >= 0 and high <= 1 + _ROUNDING and not is_integer:
        return np.clip(values.astype(np.float32), 0, 1)
    whole = is_integer or bool(np.all((values == np.floor(values)) | np.isnan(values)))
    if low >= 0 and high <= 255 and (whole or high >= 2):
        return values.astype(np.float32) / np.float32(255)
    if low >= 0 and high <= 65535 and whole:
        return values.astype(np.float32) / np.float32(65535)
    raise CloudError(
        f"{path}: its colours run from {low:.4g} to {high:.4g}, which is neither 0 to 1 nor 0 to 255 nor whole "
        "numbers to 65535; export them as 8-bit colours"
    )


def color_bytes(colors: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(N, 3) 8-bit colours; those that came from 8 bits are exactly what they were."""
    return np.rint(colors * np.float32(255)).astype(np.uint8)


def needs_double(points: NDArray[np.float64], exact: bool = False) -> bool:
    """Whether single precision would move a point by more than 0.05 mm, or, where it must be exact, at all."""
    tolerance_m = 0.0 if exact else LARGEST_FLOAT32_ERROR_M
    return bool(np.any(np.abs(points - points.astype(np.float32)) > tolerance_m))


def beyond_double(values: NDArray[Any]) -> bool:
    """Whether some are too large for double precision to hold any whole number: times in nanoseconds, say."""
    return bool(values.size) and values.dtype.itemsize == 8 and max(-float(values.min()), float(values.max())) >= 2**53


def flat_fields(fields: Fields, longest: int = 100) -> dict[str, NDArray[Any]]:
    """Fields as formats of named columns hold them: (N,), of one-byte to eight-byte numbers, little-endian.

    Of (N, K) ones the columns are numbered (`normals_0`). Names are told apart, from those of coordinates and colours
    too, and keep no more than `longest` characters, none of them a blank, a separator or beyond ASCII.
    """
    flat: dict[str, NDArray[Any]] = {}
    taken = {*"xyz", *_PACKED_COLORS, *(name for names in _COLOR_NAMES for name in names)}
    for name, values in fields.items():
        columns = [values] if values.ndim == 1 else list(values.T)
        for number, part in enumerate(columns):
            column = own_name(name if values.ndim == 1 else f"{name}_{number}", taken, longest)
            flat[column] = part.astype(_stored_type(part.dtype), copy=False)
    return flat


def own_name(name: str, taken: set[str], longest: int) -> str:
    """A name that every format can write, and none of those taken (in lower case), which it joins."""
    plain = re.sub(r"[^\x21-\x7e]|[,;/#\"']", "_", name) or "field"
    found, number = plain[:longest], 1
    while found.lower() in taken:
        number += 1
        found = f"{plain[: longest - 5]}_{number}"
    taken.add(found.lower())
    return found


def _stored_type(kind: np.dtype[Any]) -> np.dtype[Any]:
    if kind.kind == "b":
        return np.dtype("u1")
    return np.dtype(f"<{kind.kind}{min(8, max(4 if kind.kind == 'f' else 1, kind.itemsize))}")


def require_bytes(path: Path, promised: int, count: int, present: int) -> None:
    """Refuse a header that promises more points than the file can hold, before anything is allocated.

    Raises:
        CloudError: where `promised` bytes for `count` points are more than the `present` ones.
    """
    if promised > present:
        raise CloudError(
            f"{path} is cut off: its header promises {count:,} points ({promised:,} bytes), "
            f"{present:,} bytes are there; copy it again"
        )


def require_density(path: Path, count: int) -> None:
    """Refuse a compressed file that promises more points than it has bytes, before anything is unpacked.

    Raises:
        CloudError: where `count` is more than that, and more than a million.
    """
    if count > max(_ALWAYS_READ, path.stat().st_size):
        raise CloudError(
            f"{path}: its header promises {count:,} points, more than it has bytes; copy it again, or save it "
            "uncompressed if it is right"
        )
