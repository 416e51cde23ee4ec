"""Mutations of files: bytes, numbers in text and in binary headers, lengths, pieces of itself and of other files."""

from __future__ import annotations

import copy
import json
import re
import struct
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

# Headers decide most: every second mutation strikes here.
_HEADER_BYTES = 400
_NUMBER = re.compile(rb"\d+")
_TEXT_NUMBERS = (
    b"0", b"-1", b"1", b"255", b"65536", b"2147483647", b"2147483648", b"4294967295", b"1000000000000",
    b"9223372036854775807", b"18446744073709551616", b"1e308", b"1e999", b"nan", b"inf", b"9" * 400, b"9" * 5000,
)  # fmt: skip
_BINARY_NUMBERS = (
    0,
    1,
    -1,
    127,
    128,
    255,
    256,
    2**15,
    2**16 - 1,
    2**24,
    2**31 - 1,
    2**31,
    2**32 - 1,
    10**12,
    2**63 - 1,
)
_PIECES = (
    b"\0",
    b"\n",
    b"\r\n",
    b" ",
    b"..",
    b"/",
    b"<!DOCTYPE x>",
    b'"',
    b"{",
    b"[" * 3000,
    b"<a>" * 3000,
    b"\xff" * 16,
)


_JSON_VALUES = (
    None, True, 0, 1, -1, 2, 0.3, 1e308, -1e-320, 10**12, 10**400, float("nan"), float("inf"), "", "a", "../../x", "\n",
    "<b>", "\ud800", "ok", "all", "x" * 3000, [], [[]], [None], ["a", 1], {}, {"a": {}}, {"name": "a"}, {"": None},
)  # fmt: skip


def mutated(data: bytes, rng: np.random.Generator, others: Sequence[bytes] = ()) -> bytes:
    """One mutation of a file, now and then several, some with pieces of `others`."""
    for _ in range(int(rng.geometric(0.6))):
        if not data:
            return data
        data = _MUTATIONS[int(rng.integers(len(_MUTATIONS)))](data, rng, others)
    return data


def damaged(path: Path, data: bytes, rng: np.random.Generator, others: Sequence[bytes] = ()) -> bytes:
    """A mutation of a file that knows its format, or one that knows nothing: most of those end at the first look."""
    if path.suffix == ".e57" and rng.random() < 0.9:
        return mutated_e57(data, rng, others)
    if path.suffix in (".json", ".jsonl") and rng.random() < 0.7:
        return mutated_json(data, rng)
    if path.suffix == ".toml" and rng.random() < 0.7:
        return mutated_toml(data, rng)
    return mutated(data, rng, others)


def _place(data: bytes, rng: np.random.Generator) -> int:
    return int(rng.integers(min(_HEADER_BYTES, len(data)) if rng.random() < 0.5 else len(data)))


def _cut(data: bytes, rng: np.random.Generator, _: Sequence[bytes]) -> bytes:
    return data[: int(rng.integers(len(data)))]


def _bit(data: bytes, rng: np.random.Generator, _: Sequence[bytes]) -> bytes:
    at = _place(data, rng)
    return data[:at] + bytes([data[at] ^ 1 << int(rng.integers(8))]) + data[at + 1 :]


def _noise(data: bytes, rng: np.random.Generator, _: Sequence[bytes]) -> bytes:
    at = _place(data, rng)
    noise = rng.bytes(int(rng.integers(1, 9)))
    return data[:at] + noise + data[at + len(noise) :]


def _removed(data: bytes, rng: np.random.Generator, _: Sequence[bytes]) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + int(rng.integers(1, 40)) :]


def _repeated(data: bytes, rng: np.random.Generator, _: Sequence[bytes]) -> bytes:
    at = _place(data, rng)
    piece = data[at : at + int(rng.integers(1, 200))]
    return data[:at] + piece * int(rng.integers(2, 20)) + data[at:]


def _inserted(data: bytes, rng: np.random.Generator, _: Sequence[bytes]) -> bytes:
    at = _place(data, rng)
    return data[:at] + _PIECES[int(rng.integers(len(_PIECES)))] + data[at:]


def _text_number(data: bytes, rng: np.random.Generator, _: Sequence[bytes]) -> bytes:
    found = list(_NUMBER.finditer(data, 0, 1500)) or list(_NUMBER.finditer(data))
    if not found:
        return data
    number = found[int(rng.integers(len(found)))]
    return data[: number.start()] + _TEXT_NUMBERS[int(rng.integers(len(_TEXT_NUMBERS)))] + data[number.end() :]


def _binary_number(data: bytes, rng: np.random.Generator, _: Sequence[bytes]) -> bytes:
    kind = "BHIQ"[int(rng.integers(4))]
    size = struct.calcsize(kind)
    value = _BINARY_NUMBERS[int(rng.integers(len(_BINARY_NUMBERS)))] % (1 << 8 * size)
    at = _place(data, rng)
    return data[:at] + struct.pack("<>"[int(rng.integers(2))] + kind, value) + data[at + size :]


def _spliced(data: bytes, rng: np.random.Generator, others: Sequence[bytes]) -> bytes:
    other = others[int(rng.integers(len(others)))] if others else data
    return data[: _place(data, rng)] + other[_place(other, rng) :] if other else data


_MUTATIONS: tuple[Callable[[bytes, np.random.Generator, Sequence[bytes]], bytes], ...] = (
    _cut, _bit, _bit, _noise, _removed, _repeated, _inserted, _text_number, _text_number, _binary_number,
    _binary_number, _binary_number, _spliced,
)  # fmt: skip


def mutated_json(data: bytes, rng: np.random.Generator) -> bytes:
    """A JSON file, or one of a line each, that is still JSON: of its values one is another, twice there, or gone."""
    lines = [data] if data.startswith(b"{\n") else data.splitlines()
    at = int(rng.integers(len(lines)))
    lines[at] = json.dumps(_changed(json.loads(lines[at]), rng)).encode()
    return b"\n".join(lines) + b"\n"


def mutated_toml(data: bytes, rng: np.random.Generator) -> bytes:
    """A TOML file that is still TOML, changed likewise."""
    changed = _changed(tomllib.loads(data.decode()), rng)
    return "".join(f"{json.dumps(str(key))} = {_toml(value)}\n" for key, value in changed.items()).encode()


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(key))} = {_toml(its)}" for key, its in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return "{}" if value is None else json.dumps(value)


def _changed(value: Any, rng: np.random.Generator) -> Any:
    """A JSON value in which one or some are others, twice there, or gone."""
    for _ in range(int(rng.geometric(0.6))):
        places = list(_places(value))
        holder, key = places[int(rng.integers(len(places)))]
        others = [one[its] for one, its in places]
        kind = int(rng.integers(6))
        if kind == 0:
            del holder[key]
        elif kind == 1 and isinstance(holder, list):
            holder.insert(key, holder[key])
        elif kind == 1:
            holder[str(others[int(rng.integers(len(others)))])[:20]] = holder[key]
        elif kind == 2:
            holder[key] = copy.deepcopy(others[int(rng.integers(len(others)))])
        else:
            holder[key] = copy.deepcopy(_JSON_VALUES[int(rng.integers(len(_JSON_VALUES)))])
        if not value:
            break
    return value


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every (list or object, index or key) in a JSON value, at any depth."""
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield value, key
            yield from _places(value[key])


def with_e57_checksums(logical: bytes) -> bytes:
    """An E57 file in pages of 1,024 bytes with right checksums: without them every mutation ends at the first."""
    pages = [logical[start : start + 1020].ljust(1020, b"\0") for start in range(0, len(logical), 1020)]
    return b"".join(page + struct.pack(">I", _crc32c(page)) for page in pages)


def _crc32c(data: bytes) -> int:
    """CRC-32C (Castagnoli), the checksum of ASTM E2807."""
    value = 0xFFFFFFFF
    for byte in data:
        value = _CRC_TABLE[(value ^ byte) & 255] ^ value >> 8
    return value ^ 0xFFFFFFFF


def _crc_row(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ 0x82F63B78 * (byte & 1)
    return byte


_CRC_TABLE = [_crc_row(byte) for byte in range(256)]


def mutated_e57(data: bytes, rng: np.random.Generator, others: Sequence[bytes] = ()) -> bytes:
    """An E57 file with mutations below its checksums: mostly of its XML, which then still has its place and length."""
    if rng.random() < 0.3:
        return with_e57_checksums(mutated(_without_e57_checksums(data), rng))
    return e57_with_xml(data, lambda xml: mutated(xml, rng, others))


def e57_with_xml(data: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """An E57 file whose XML is changed, with right lengths and checksums."""
    logical = _without_e57_checksums(data)
    xml_at, xml_length = struct.unpack_from("<QQ", data, 24)
    start = xml_at - xml_at // 1024 * 4
    xml = change(logical[start : start + xml_length])
    pages = -(-(start + len(xml)) // 1020)
    head = logical[:16] + struct.pack("<QQQ", pages * 1024, xml_at, len(xml)) + logical[40:start]
    return with_e57_checksums((head + xml).ljust(pages * 1020, b"\0"))


def _without_e57_checksums(data: bytes) -> bytes:
    return b"".join(data[start : start + 1020] for start in range(0, len(data), 1024))
