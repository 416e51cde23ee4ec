"""What notebooks show of values: small pictures inside the HTML, so that a saved notebook shows them anywhere."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from pcdbench.errors import told

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from pcdbench.cloud import PointCloud

_DRAWN_POINTS = 40_000
_FIGURE_DPI = 100


def cloud_html(cloud: PointCloud, description: str = "") -> str:
    """A cloud from above without its ceiling and at a slant, above its one-line description (its `repr` unless given).

    Points that lie far from nearly all others are left out of the pictures, as the viewer leaves them out.
    A picture and no viewer: a notebook may hold dozens of clouds, each would be megabytes and want a graphics
    context. `pcdbench.view(cloud)` turns.
    """
    caption = f"<figcaption>{escape(description or repr(cloud))}</figcaption>"
    if not len(cloud):
        return f'<figure style="margin:0">{caption}</figure>'
    from pcdbench.viewing.picture import at_a_slant, from_above
    from pcdbench.viewing.shown import core

    low, high = core([cloud.points])
    near = np.flatnonzero(((cloud.points >= low) & (cloud.points <= high)).all(axis=1))
    if len(near) > _DRAWN_POINTS:
        near = np.random.default_rng(0).choice(near, _DRAWN_POINTS, replace=False)
    drawn = cloud.select(near)
    above = _picture_html(from_above(drawn, drawn), "from above")
    slant = _picture_html(at_a_slant(drawn, drawn), "at a slant")
    return f'<figure style="margin:0">{above}{slant}{caption}</figure>'


def figures_html(figures: Iterable[tuple[str, Figure]]) -> str:
    """Named figures, one below the other; one that cannot be drawn is a line that says why."""
    parts = []
    for name, figure in figures:
        png = io.BytesIO()
        caption = name
        try:
            figure.savefig(png, format="png", dpi=_FIGURE_DPI, facecolor="white")
            image = _image_html(png.getvalue(), name)
        except Exception as error:
            # Much of matplotlib fails only here, and a task of a third party may have built the figure.
            image, caption = "", f"{name} cannot be drawn: {told(error)}"
        parts.append(f'<figure style="margin:0 0 1em">{image}<figcaption>{escape(caption)}</figcaption></figure>')
    return "".join(parts)


def _picture_html(image: NDArray[np.float64], name: str) -> str:
    """An (H, W, 3) picture in [0, 1] at half its size: the mean of four pixels smooths the dots' edges."""
    from matplotlib.image import imsave

    height, width = image.shape[0] // 2, image.shape[1] // 2
    halved = image[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
    png = io.BytesIO()
    imsave(png, np.clip(halved, 0, 1), format="png")
    return _image_html(png.getvalue(), name)


def _image_html(png: bytes, name: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return f'<img alt="{escape(name)}" style="max-width:100%;margin-right:8px" src="data:image/png;base64,{data}">'
