"""The XML of an E57 file, looked at before libe57's parser: it follows what documents define and include."""

from __future__ import annotations

import struct
from pathlib import Path

from pcdbench.errors import CloudError

_HEADER_BYTES = 48
_PAGE_BYTES, _CHECKSUM_BYTES = 1024, 4
_DEEPEST = 100


def require_plain_xml(path: Path) -> None:
    """Refuse XML that defines entities, is not UTF-8 or is nested deeper than any scan.

    E57 has none of these (ASTM E2807, 7.1), but a parser that meets entities fetches files and addresses, and fills any
    memory with a few lines that repeat each other.

    Raises:
        CloudError: naming the file.
    """
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
        if len(header) < _HEADER_BYTES or header[:8] != b"ASTM-E57":
            raise CloudError(f"{path} is not an E57 file, or cut off; check its extension or copy it again")
        start, length = struct.unpack_from("<QQ", header, 24)
        if start >= path.stat().st_size or length > path.stat().st_size - start:
            raise CloudError(f"{path} is cut off within its description; copy it again")
        # Every page ends in a checksum, which is no part of the text.
        first = start - start % _PAGE_BYTES
        stream.seek(first)
        pages = stream.read(start - first + length + (length // (_PAGE_BYTES - _CHECKSUM_BYTES) + 2) * _CHECKSUM_BYTES)
    text = b"".join(pages[page : page + _PAGE_BYTES - _CHECKSUM_BYTES] for page in range(0, len(pages), _PAGE_BYTES))[
        start - first :
    ][:length]
    head = text[:200].lower()
    if b"\0" in text or b"<!doctype" in text.lower() or (b"encoding=" in head and b"utf-8" not in head):
        raise CloudError(f"{path}: its description is not plain UTF-8 XML; export it again")
    deepest = depth = 0
    for piece in text.split(b"<")[1:]:
        if piece[:1] == b"/":
            depth -= 1
        elif piece[:1] not in (b"?", b"!") and not piece.split(b">")[0].endswith(b"/"):
            depth += 1
            deepest = max(deepest, depth)
    if deepest > _DEEPEST:
        raise CloudError(f"{path}: its description is nested {deepest:,} levels deep; export it again")
