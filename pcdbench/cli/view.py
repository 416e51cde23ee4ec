"""`pcdbench view`: clouds side by side on one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pcdbench.cloud import PointCloud

_ADDED_FIELD, _CONFIDENCE_FIELD = "added", "confidence"


def view(
    clouds: Annotated[list[Path], typer.Argument(help="Files of clouds in one frame, metres.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The page to write.")] = Path("view.html"),
    reference: Annotated[Path | None, typer.Option(help="A cloud to which the others' distances can be shown.")] = None,
    points: Annotated[int, typer.Option(help="Show at most this many points of each cloud.")] = 200_000,
    up: Annotated[str, typer.Option(help="The clouds' up axis: z, y, x, -z, -y or -x.")] = "z",
) -> None:
    """Write a page that shows clouds side by side: turn, move and zoom them together, in any browser, offline.

    Points show their colour, what a completer added, how sure it was, their height, or their distance to a reference.
    What was added is what a file's field `added` says, else the points that the first cloud does not have.
    """
    from pcdbench.viewing.page import require_page
    from pcdbench.viewing.page import view as view_of
    from pcdbench.viewing.payload import too_coarse

    require_page(out)
    names = _names(clouds)
    read = {name: _read(path) for name, path in zip(names, clouds, strict=True)}
    seen = view_of(
        {name: cloud for name, (cloud, _) in read.items()},
        added={name: fields[_ADDED_FIELD] > 0 for name, (_, fields) in read.items() if _ADDED_FIELD in fields},
        confidence={
            name: fields[_CONFIDENCE_FIELD] for name, (_, fields) in read.items() if _CONFIDENCE_FIELD in fields
        },
        reference=None if reference is None else _read(reference)[0],
        points=points,
        up=up,
    )
    coarse = too_coarse(seen.shown)
    if coarse is not None:
        typer.echo(f"pcdbench: {coarse}", err=True)
    seen.write(out)
    shown = sum(len(its.cloud) for its in seen.shown)
    counted = f"{len(names)} cloud{'s' if len(names) > 1 else ''}, {shown:,} points"
    typer.echo(f"{out}: {counted}, {out.stat().st_size / 1e6:.1f} MB; open it in a browser")


def _names(paths: list[Path]) -> list[str]:
    """What to call the files: by their names, or by their paths where two have one name.

    Raises:
        PcdbenchError: where one file is given twice.
    """
    from pcdbench.errors import PcdbenchError

    # A name that is no UTF-8 must still be shown.
    whole = [str(path).encode(errors="replace").decode() for path in paths]
    for path in paths:
        if paths.count(path) > 1:
            raise PcdbenchError(f"{path} is given twice; give each cloud once")
    names = [Path(text).name for text in whole]
    return names if len(set(names)) == len(names) else whole


def _read(path: Path) -> tuple[PointCloud, dict[str, NDArray[Any]]]:
    """The cloud of a file, and those of its fields that can be shown; what is odd goes to standard error."""
    import warnings

    import numpy as np

    from pcdbench.formats import CloudWarning, read_cloud_and_fields

    with warnings.catch_warnings(record=True) as odd:
        warnings.simplefilter("always", CloudWarning)
        cloud, fields = read_cloud_and_fields(path)
    for one in odd:
        typer.echo(f"pcdbench: {one.message}", err=True)
    added = fields.get(_ADDED_FIELD)
    if added is not None and not (added.ndim == 1 and np.isin(added, (0, 1)).all()):
        typer.echo(f"pcdbench: {path}: its field added is not 0 or 1 of each point, and is not shown", err=True)
        del fields[_ADDED_FIELD]
    trust = fields.get(_CONFIDENCE_FIELD)
    if trust is not None and not (trust.ndim == 1 and ((trust >= 0) & (trust <= 1)).all()):
        typer.echo(
            f"pcdbench: {path}: its field confidence is not one number in [0, 1] of each point, and is not shown",
            err=True,
        )
        del fields[_CONFIDENCE_FIELD]
    return cloud, fields
