"""`pcdbench complete`: one's own scan completed, whatever its size, with a report of what to scan again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pcdbench.cloud import PointCloud


def complete(
    scan: Annotated[
        Path, typer.Argument(metavar="IN", help="The scan: PLY, PCD, XYZ, PTS, TXT, CSV, LAS, LAZ, E57 or NPZ.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="OUT", help="The file to write, any of these formats.")],
    completer: Annotated[str, typer.Option(help="A completer from `pcdbench list`.")],
    option: Annotated[
        list[str] | None, typer.Option(help="NAME.KEY=VALUE: an option of the completer (see pcdbench show NAME).")
    ] = None,
    up: Annotated[str, typer.Option(help="The scan's up axis: z, y, x, -z, -y or -x.")] = "z",
    added_only: Annotated[bool, typer.Option("--added-only", help="Write the added points alone.")] = False,
    report: Annotated[Path | None, typer.Option(help="Write a report of what to scan again into this folder.")] = None,
    tile_m: Annotated[float | None, typer.Option(help="Edge of a tile in metres (unless given: by density).")] = None,
    runs: Annotated[int, typer.Option(help="Ask the completer so often; where answers differ, confidence falls.")] = 1,
    jobs: Annotated[int, typer.Option(help="Worker processes.")] = 1,
    seed: Annotated[int, typer.Option(help="Decides every random draw.")] = 0,
) -> None:
    """Complete a scan, of a room or a building, and mark what was added.

    Observed points are written as they were. Added ones come after them, with the fields `added` (0 or 1) and
    `confidence` (0 to 1; 1 for observed points).
    """
    import warnings

    from pcdbench.completion import CompletionWarning
    from pcdbench.completion import complete as completed_of
    from pcdbench.completion.completed import name_beside_marks
    from pcdbench.completion.progress import TileProgress
    from pcdbench.completion.report import require_report_folder, write_report
    from pcdbench.errors import CloudError, PcdbenchError
    from pcdbench.formats import MARKS, carries_fields, read_observed
    from pcdbench.paths import require_writable
    from pcdbench.runner.selection import option_targets, parse_options, select

    marked = carries_fields(out)
    if out.exists() and scan.exists() and out.samefile(scan):
        raise PcdbenchError(f"{out} is the scan itself; name another file, so that the scan is kept")
    if out.is_dir():
        raise PcdbenchError(f"{out} is a folder; name a file in it")
    require_writable(out.parent)
    if report is not None:
        require_report_folder(report)
    options = parse_options(option or [])
    option_targets(options, {"completer": [completer]})
    select("completer", completer, options.get(completer, {}))
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        # What reading warns of names the file already.
        warnings.showwarning = lambda message, kind, *_: typer.echo(
            f"pcdbench: {f'{scan}: ' if issubclass(kind, CompletionWarning) else ''}{message}", err=True
        )
        cloud, fields = read_observed(scan, with_fields=True)
        try:
            with TileProgress() as progress:
                completed = completed_of(
                    cloud,
                    completer,
                    options=options.get(completer, {}),
                    up=up,
                    tile_m=tile_m,
                    runs=runs,
                    jobs=jobs,
                    seed=seed,
                    progress=progress.done,
                )
        except CloudError as error:
            raise CloudError(f"{scan}: {error}") from error
    added = int(completed.added.sum())
    if added_only and not added:
        raise PcdbenchError(f"{completer} added nothing to {scan}: {_likely_reason(cloud)}; {out} is not written")
    completed.write(out, added_only=added_only, fields=fields, like=scan)
    if not marked and not added_only:
        typer.echo(
            f"pcdbench: {out.suffix} cannot mark points: the last {added:,} of {out} are the added ones; "
            "PLY, PCD, LAS, text and NPZ can, and --added-only needs no mark",
            err=True,
        )
    taken = [name for name in MARKS if name in fields]
    if marked and taken and not added_only:
        told = ", ".join(f"{name} is written as {name_beside_marks(name, fields)}" for name in taken)
        typer.echo(f"pcdbench: of the fields of {scan} {told}", err=True)
    if not marked and fields and not added_only:
        typer.echo(f"pcdbench: {out.suffix} cannot hold {', '.join(fields)} of {scan}: left out", err=True)
    if added_only:
        typer.echo(f"{out}: the {added:,} points that {completer} added to {len(cloud):,} observed ones", err=True)
    else:
        typer.echo(f"{out}: {len(cloud):,} points observed, {added:,} added by {completer}", err=True)
    if not added:
        typer.echo(f"pcdbench: {completer} added nothing: {_likely_reason(cloud)}", err=True)
    if report is not None:
        regions = write_report(completed, report, scan.name, completer)
        typer.echo(f"{report / 'report.md'}: {len(regions)} region{'s' * (len(regions) != 1)} to scan again", err=True)


def _likely_reason(cloud: PointCloud) -> str:
    """Why nothing was added to a cloud."""
    from pcdbench.completion.tiles import too_thin

    return too_thin(cloud.points) or "it found no gap that it fills"
