"""The viewer as HTML: a page of its own, or a part of any other page."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcdbench import __version__
from pcdbench.cloud import PointCloud
from pcdbench.errors import PcdbenchError
from pcdbench.geometry.frames import Frame
from pcdbench.viewing.payload import MODES, payload
from pcdbench.viewing.shown import Shown, shown_clouds

FLUENT_POINTS = 200_000
_NOTEBOOK_HEIGHT_PX = 560


@dataclass(frozen=True)
class View:
    """Clouds side by side, ready to be looked at: a notebook shows it, `write` makes a page of it.

    Attributes:
        shown: what is shown of each cloud.
        title: of the page; any text.
    """

    shown: Sequence[Shown]
    title: str

    @property
    def html(self) -> str:
        """A whole page that needs nothing else: no network, no file beside it."""
        assets = viewer_assets()
        return Template(_file("page.html")).substitute(
            policy=page_policy([viewer_style(), _file("page.css")], [viewer_script()]),
            version=__version__,
            title=escape(self.title),
            style=_file("page.css"),
            assets=assets,
            viewer=viewer_element(self.shown, self.title),
        )

    def write(self, path: str | Path) -> Path:
        """Write the page; it appears complete or not at all.

        Raises:
            PcdbenchError: where the file is not called *.html, or cannot be written.
        """
        from pcdbench.runner.store import write_text

        path = Path(path)
        require_page(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, self.html)
        except OSError as error:
            raise PcdbenchError(f"{path} cannot be written: {error.strerror or error}; choose another place") from error
        return path

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.html)}" sandbox="allow-scripts" loading="lazy" title="{escape(self.title)}"'
            f' style="width:100%;height:{_NOTEBOOK_HEIGHT_PX}px;border:0"></iframe>'
        )


def view(
    clouds: PointCloud | Mapping[str, PointCloud],
    *,
    added: Mapping[str, NDArray[np.bool_]] | None = None,
    confidence: Mapping[str, NDArray[np.floating[Any]]] | None = None,
    reference: PointCloud | None = None,
    points: int = FLUENT_POINTS,
    up: str = "z",
) -> View:
    """Clouds side by side with linked cameras; a notebook shows what this returns.

    Args:
        clouds: one cloud, or several by name, all in one frame.
        added: by name, (N,) which points a completer added. Unless given, a point of a later cloud counts as
            added that is no point of the first cloud, where that one is largely contained in it.
        confidence: by name, (N,) in [0, 1], how far each point can be trusted; only what was added is coloured by it.
        reference: colours points by their distance to the nearest one of its points.
        points: of a cloud at most; larger clouds are thinned, and their caption says so.
        up: the axis of all clouds and the reference that is up: z, y, x, -z, -y or -x.

    Raises:
        PcdbenchError: where there is no cloud, one without points, a mask or a confidence that does not fit its
            cloud, or an unknown axis.
    """
    frame = Frame.with_up(up)
    named = dict(clouds) if isinstance(clouds, Mapping) else {"cloud": clouds}
    marks, trust = dict(added or {}), dict(confidence or {})
    if not named:
        raise PcdbenchError("there is no cloud to view; give at least one")
    if points < 1:
        raise PcdbenchError(f"{points} points cannot be viewed; show at least 1 of each cloud")
    for name, cloud in [*named.items(), ("the reference", reference)]:
        if cloud is not None and not len(cloud):
            raise PcdbenchError(f"{name} has no points, so there is nothing to view; leave it out")
    _require_fit("added", marks, named)
    _require_fit("confidence", trust, named)
    for name, values in trust.items():
        if not ((np.asarray(values) >= 0) & (np.asarray(values) <= 1)).all():
            raise PcdbenchError(f"confidence of {name} is not within [0, 1]; scale it, or leave it out")
    known = [np.asarray(marks[name], dtype=bool) if name in marks else None for name in named]
    upright = [(name, _upright(cloud, frame)) for name, cloud in named.items()]
    sure = {name: np.asarray(values, np.float64) for name, values in trust.items()}
    seen_from = None if reference is None else _upright(reference, frame)
    return View(shown_clouds(upright, known, seen_from, points, sure), " · ".join(named))


def _require_fit(what: str, given: Mapping[str, NDArray[Any]], named: Mapping[str, PointCloud]) -> None:
    for name, values in given.items():
        if name not in named:
            raise PcdbenchError(f"{what} names {name!r}, which is no cloud here; use one of {', '.join(named)}")
        if np.shape(values) != (len(named[name]),):
            raise PcdbenchError(
                f"{what} of {name} has shape {np.shape(values)}; give one value for each of {len(named[name]):,} points"
            )


def _upright(cloud: PointCloud, frame: Frame) -> PointCloud:
    return PointCloud(frame.upright(cloud.points), cloud.colors)


def viewer_assets() -> str:
    """The style and the script of the viewer, once for each page, however many viewers it has."""
    return f"<style>{viewer_style()}</style>\n<script>{viewer_script()}</script>"


def viewer_style() -> str:
    """The style of the viewer alone, as `viewer_assets` has it."""
    return _file("viewer.css")


@cache
def viewer_script() -> str:
    """The script of the viewer alone, as `viewer_assets` has it; its names stay out of the page that it is put into."""
    return f'(() => {{\n"use strict";\n{_file("renderer.js")}\n{_file("viewer.js")}}})();'


def page_policy(styles: Sequence[str], scripts: Sequence[str]) -> str:
    """A content security policy: these styles and scripts alone, nothing from anywhere else."""
    allowed = f"script-src {' '.join(map(_hash, scripts))}; style-src {' '.join(map(_hash, styles))}"
    return f"default-src 'none'; {allowed}; img-src data:"


def embedded_json(content: Any) -> str:
    """JSON to stand within a script element, where nothing is escaped: no "<" of a string begins a tag."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def viewer_element(shown: Sequence[Shown], title: str) -> str:
    """A viewer to put anywhere into a page that has `viewer_assets()`."""
    content = payload(shown)
    panels = "\n".join(_panel(its) for its in shown)
    return Template(_file("viewer.html")).substitute(
        title=escape(title),
        modes="".join(_mode(name, name == content["mode"]) for name in content["modes"]),
        legends="".join(_legend(name, content, shown) for name in content["modes"]),
        low=f"{content['low'][2]:.4f}",
        top=f"{content['top_m']:.4f}",
        cut=f"{content['top_m'] if content['cut_m'] is None else content['cut_m']:.4f}",
        panels=panels,
        data=embedded_json(content),
    )


def require_page(path: Path) -> None:
    """Refuse a page's name that is none: a slip of the hand must not overwrite a scan.

    Raises:
        PcdbenchError: unless it ends in .html.
    """
    if path.suffix.lower() not in (".html", ".htm"):
        raise PcdbenchError(f"{path} is no name for a page; let it end in .html")


def _panel(its: Shown) -> str:
    facts = [f"{its.total:,} points" if its.total != 1 else "1 point"]
    left = its.total - its.far
    if len(its.cloud) < left:
        facts.append(f"thinned to {len(its.cloud):,}")
    if its.far:
        facts.append(f"{its.far:,} far away left out")
    if its.cloud.colors is None:
        facts.append("no colour")
    if its.added is not None:
        where = "added" if its.compared_with is None else f"not in {escape(its.compared_with)}"
        facts.append(f"{its.added_total:,} {where} ({its.added_total / its.total:.0%})")
    lines = [" · ".join(facts)]
    if its.distance_m is not None:
        median, high = np.quantile(its.distance_m, [0.5, 0.95])
        lines.append(f"to the reference: median {median:.3f} m, 95 % within {high:.3f} m")
    name = escape(its.name)
    return (
        f'<figure class="panel"><canvas tabindex="0" role="img" aria-label="point cloud {name}"></canvas>'
        f"<figcaption><strong>{name}</strong>{''.join(f'<span>{line}</span>' for line in lines)}</figcaption></figure>"
    )


def _mode(name: str, checked: bool) -> str:
    # Radio buttons of one name exclude each other within their form, so that viewers of one page do not mix.
    mark = " checked" if checked else ""
    return f'<label><input type="radio" name="mode" data-mode="{name}"{mark}>{MODES[name]}</label>'


def _legend(mode: str, content: Mapping[str, Any], shown: Sequence[Shown]) -> str:
    if mode == "added":
        inside = '<i class="swatch observed"></i>observed <i class="swatch added"></i>added'
    elif mode == "confidence":
        inside = '<i class="swatch observed"></i>observed, added with confidence 0 '
        inside += '<canvas class="bar" data-map="confidence"></canvas> 1'
    elif mode == "height":
        inside = f'0 <canvas class="bar" data-map="height"></canvas> {content["high"][2] - content["low"][2]:.2f} m'
        inside += " above the floor"
    elif mode == "distance":
        most = content["distance_max_m"]
        clipped = any(its.distance_m is not None and (its.distance_m > most).any() for its in shown)
        inside = f'0 <canvas class="bar" data-map="distance"></canvas> {most:g} m{" or more" if clipped else ""}'
        inside += " from the reference"
    else:
        return ""
    return f'<span class="legend" data-legend="{mode}" hidden>{inside}</span>'


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _file(name: str) -> str:
    return (files("pcdbench.viewing") / name).read_text(encoding="utf-8")
