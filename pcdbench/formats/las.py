"""LAS and LAZ, by laspy and lazrs."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench.cloud import PointCloud
from pcdbench.errors import CloudError
from pcdbench.formats.columns import (
    NO_FIELDS,
    NOTHING,
    Columns,
    Fields,
    beyond_double,
    flat_fields,
    own_name,
    unit_colors,
)
from pcdbench.formats.las_header import extended_records, sound_point_bytes

_EXTENSIONS = (".las", ".laz")
_FORMATS, _COLORED_FORMATS = (0, 1, 6), (2, 3, 7, 8)
_COLORS = ("red", "green", "blue")
# Waveforms are stored elsewhere.
_WAVEFORMS = (
    "wavepacket_index",
    "wavepacket_offset",
    "wavepacket_size",
    "return_point_wave_location",
    "x_t",
    "y_t",
    "z_t",
)
_READ_OTHERWISE = ("X", "Y", "Z", *_COLORS, "withheld", *_WAVEFORMS)
_REFERENCE_SYSTEM = "LASF_Projection"  # user of its records (LAS 1.4, 2.5 and 2.6)
_LONGEST_NAME = 31
_MOST_EXTRA = 341  # of 192 bytes each, in a record of 65,535
_SCALE_M = 1e-4
_EXACT_SCALES_M = (1e-4, 1e-5, 1e-6, 1e-7)
_BYTES_A_PIECE = 1 << 25


def read(path: Path, wanted: Container[str] = NOTHING) -> Columns:
    """The points of a LAS or LAZ file; colours where it has them.

    Colours that are all zero are none: point formats reserve room for them, and many programs leave it empty. So the
    format's own dimensions of a point (`intensity`) are fields only where they are not all zero; extra ones always
    are. What is marked as withheld is deleted (LAS 1.4, table 8) and becomes NaN.
    """
    points: list[NDArray[np.float64]] = []
    colors: list[NDArray[Any]] = []
    found: dict[str, list[NDArray[Any]]] = {}
    for piece in _pieces(path):
        own = list(piece.point_format.standard_dimension_names)
        xyz = np.stack([np.asarray(piece[name], dtype=np.float64) for name in "xyz"], axis=1)
        xyz[np.asarray(piece["withheld"]) != 0] = np.nan
        points.append(xyz)
        if "red" in own:
            colors.append(np.stack([np.asarray(piece[name]) for name in _COLORS], axis=1))
        for name in piece.point_format.dimension_names:
            if name in wanted and not (name in own and name in _READ_OTHERWISE):
                found.setdefault(name, []).append(np.asarray(piece[name]))
    if not points:
        return Columns(np.empty((0, 3)), None)
    fields = {name: np.concatenate(columns) for name, columns in found.items()}
    fields = {name: column for name, column in fields.items() if name not in own or column.any()}
    all_colors = np.concatenate(colors) if colors else None
    if all_colors is None or not all_colors.any():
        return Columns(np.concatenate(points), None, fields)
    return Columns(np.concatenate(points), unit_colors(all_colors, path), fields)


def _pieces(path: Path) -> Iterator[Any]:
    """The points of a file in pieces, so that memory grows with what is there and not with what the header promises.

    Raises:
        CloudError: where the header does not fit the file, points are missing or their compression is damaged.
    """
    import laspy

    points_a_piece = max(1, _BYTES_A_PIECE // sound_point_bytes(path))
    # What may follow the points (extended records) is not needed, and its number cannot be trusted.
    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader:
        promised, present = reader.header.point_count, 0
        try:
            for piece in reader.chunk_iterator(points_a_piece):
                present += len(piece)
                yield piece
        except BaseException as error:
            # lazrs panics on damaged data, and a panic is no Exception.
            if type(error).__name__ != "PanicException":
                raise
            raise CloudError(f"{path}: its compressed points are damaged; copy or export it again") from error
    if present < promised:
        raise CloudError(f"{path} is cut off: {present:,} of {promised:,} points are there; copy it again")


def write(
    cloud: PointCloud, path: Path, fields: Fields = NO_FIELDS, exact: bool = False, like: Path | None = None
) -> str | None:
    """Write LAS with coordinates of 0.1 mm from a whole-metre offset near the cloud, and 16-bit colours.

    Clouds farther apart than 400 km, by a stray or two, have coarser coordinates; what is returned says so.

    Fields of the names of LAS's own dimensions are these, in the smallest point format that holds them (LAS 1.2, or 1.4
    from format 6 on); all others are extra dimensions. Where it must be exact, coordinates are as fine as it takes,
    down to 100 nm. The coordinate reference system is that of `like`.
    """
    import laspy

    offset = np.floor(cloud.points.min(axis=0) / 2 + cloud.points.max(axis=0) / 2)
    scale_m = _finest_needed(cloud.points - offset) if exact else _SCALE_M
    while np.abs(cloud.points - offset).max() / scale_m > np.iinfo(np.int32).max:
        scale_m *= 10
    told = _description(like)
    columns = flat_fields(_by_dimension(fields), _LONGEST_NAME)
    point_format, own = _smallest_point_format(columns, cloud.colors is not None)
    header = laspy.LasHeader(version="1.4" if point_format >= 6 or told.is_wkt else "1.2", point_format=point_format)
    header.scales = np.full(3, scale_m)
    header.offsets = offset
    header.vlrs.extend(told.records)
    header.global_encoding.wkt = told.is_wkt or (point_format >= 6 and not told.records)
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType(int(told.is_adjusted_gps_time))
    # What has the name of one of LAS's own dimensions and does not fit into it, intensities from 0 to 1, stands beside.
    named = (*header.point_format.dimension_names, *(header.point_format.dtype().names or ()))
    taken = {name.lower() for name in named}
    extra = {name: own_name(name, taken, _LONGEST_NAME) for name in columns if name not in own}
    if len(extra) > _MOST_EXTRA:
        raise CloudError(f"{path}: LAS holds up to {_MOST_EXTRA} further fields, not {len(extra)}; write PLY instead")
    header.add_extra_dims([laspy.ExtraBytesParams(shown, columns[name].dtype) for name, shown in extra.items()])
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.points.T
    if cloud.colors is not None:
        las.red, las.green, las.blue = np.rint(cloud.colors * np.float64(65535)).astype(np.uint16).T
    for name, column in columns.items():
        las[extra.get(name, name)] = (
            _as_dimension(column, las.point_format.dimension_by_name(name)) if name in own else column
        )
    with path.open("wb") as stream:
        las.write(stream, do_compress=path.suffix.lower() == ".laz", laz_backend=laspy.LazBackend.Lazrs)
    if scale_m <= _SCALE_M:
        return None
    return (
        f"LAS holds points so far apart in steps of {scale_m:.3g} m, which moves them by up to half of that; leave out "
        "strays, or write PLY"
    )


@dataclass(frozen=True)
class _Description:
    """What a LAS file says of its coordinates and times: records of its reference system, and how to read them."""

    records: tuple[Any, ...] = ()
    is_wkt: bool = False
    is_adjusted_gps_time: bool = False


def _description(path: Path | None) -> _Description:
    import laspy

    if path is None or path.suffix.lower() not in _EXTENSIONS:
        return _Description()
    sound_point_bytes(path)
    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as reader:
        header = reader.header
        records = tuple(record for record in header.vlrs if record.user_id == _REFERENCE_SYSTEM)
        # From LAS 1.4 on they may lie behind the points.
        records += tuple(
            laspy.VLR(user, number, "", content)
            for user, number, content in extended_records(path)
            if user == _REFERENCE_SYSTEM
        )
        return _Description(records, header.global_encoding.wkt, bool(header.global_encoding.gps_time_type.value))


def _by_dimension(fields: Fields) -> dict[str, NDArray[Any]]:
    """Fields by LAS's own names where other programs spell these otherwise: `Intensity`, `scalar_ReturnNumber`."""
    import laspy

    own = {
        _plain(dimension.name): dimension.name
        for number in _FORMATS
        for dimension in laspy.PointFormat(number).dimensions
        if dimension.name not in _READ_OTHERWISE
    }
    # Of two spellings that of LAS has the dimension.
    named = {name: values for name, values in fields.items() if name in own.values()}
    for name, values in fields.items():
        dimension = own.get(_plain(name), name)
        if name not in named:
            named[name if dimension in named else dimension] = values
    return named


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower().removeprefix("scalar_"))


def _as_dimension(column: NDArray[Any], dimension: Any) -> NDArray[Any]:
    """A column as a dimension of LAS's own takes it, which holds its numbers: bits are set by whole ones alone."""
    import laspy

    numbers = np.nan_to_num(column)
    is_floating = dimension.kind is laspy.point.DimensionKind.FloatingPoint
    return numbers if is_floating or numbers.dtype.kind in "iu" else numbers.astype(np.int64)


def _smallest_point_format(columns: dict[str, NDArray[Any]], is_colored: bool) -> tuple[int, set[str]]:
    """The first point format that holds as many of these in its own dimensions as any does, and which it holds."""
    import laspy

    formats = [laspy.PointFormat(number) for number in (_COLORED_FORMATS if is_colored else _FORMATS)]
    named = {dimension.name for its in formats for dimension in its.dimensions} - set(_READ_OTHERWISE)
    # Times in nanoseconds are too large for `gps_time`, which is a double.
    large = {name for name, column in columns.items() if column.dtype.kind in "iu" and beyond_double(column)}
    spans = {name: _whole_span(column) for name, column in columns.items() if name in named - large}
    held = [
        {one.name for one in its.dimensions if one.name in spans and _holds(one, spans[one.name])} for its in formats
    ]
    most = max(held, key=len)
    return formats[held.index(most)].id, most


def _whole_span(column: NDArray[Any]) -> tuple[float, float] | None:
    """The least and the largest of whole numbers, None of others; NaN counts as 0, which it becomes."""
    numbers = np.nan_to_num(column)
    if not np.all(numbers == np.floor(numbers)):
        return None
    return numbers.min(initial=0), numbers.max(initial=0)


def _holds(dimension: Any, span: tuple[float, float] | None) -> bool:
    """Whether a dimension of LAS's own holds numbers of this span."""
    import laspy

    if dimension.kind is laspy.point.DimensionKind.FloatingPoint:
        return True
    return span is not None and bool(dimension.min <= span[0] and span[1] <= dimension.max)


def _finest_needed(points: NDArray[np.float64]) -> float:
    """The coarsest of the scales (metres) at which points survive to the nanometre, else the finest that fits them."""
    largest = float(np.abs(points).max())
    fitting = [scale for scale in _EXACT_SCALES_M if largest / scale < np.iinfo(np.int32).max]
    for scale in fitting:
        steps = points / scale
        if np.abs(steps - np.rint(steps)).max() * scale < 1e-9:
            return scale
    return fitting[-1] if fitting else _SCALE_M
