"""Colours for new points: those of the surface around, continued smoothly across it, and what a network predicts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import cg
from scipy.spatial import cKDTree

from pcdbench.geometry.neighbors import loose_tree
from pcdbench.threads import thread_count

NEIGHBORS = 8
ANCHOR_WEIGHT = 1e-3
TOLERANCE = 1e-3
MAX_ITERATIONS = 400
# Spacings over which, e-fold, the nearest observed colour fades into the observed ones' smooth continuation, and that
# into the predicted one.
NEAREST_REACH, CONTINUED_REACH = 3.0, 40.0


def inpainted_colors(
    new_points: NDArray[np.float64],
    points: NDArray[np.float64],
    colors: NDArray[np.float32],
    new_surface: NDArray[np.int64] | None = None,
    surface: NDArray[np.int64] | None = None,
    anchors: NDArray[np.int64] | None = None,
) -> NDArray[np.float32]:
    """(Q, 3) colours of new points: the harmonic continuation of the observed colours along the surface.

    Each new point's colour is the mean of its nearest points' colours, new and observed, weighted by the inverse
    square of the distance: a discrete Laplace equation on the surface, whose boundary values are the observed
    colours at the rim of the hole. It is smooth on purpose: where texture was lost, noise of the right strength
    in the wrong place agrees less with the truth than its local mean does.

    Args:
        new_points: (Q, 3) metres, in the frame of `points`.
        points: (N, 3) observed points, metres, near the origin.
        colors: (N, 3) in [0, 1].
        new_surface: (Q,) which surface each new point is on; colours do not cross from one to another.
        surface: (N,) which surface each observed point is on.
        anchors: (Q,) the row of the observed point nearest to each new one, where that is known already.
    """
    count = len(new_points)
    if count == 0:
        return np.empty((0, 3), np.float32)
    new_places, places, apart = new_points, points, np.inf
    if new_surface is not None and surface is not None:
        # A fourth coordinate far larger than the scene keeps surfaces apart, so that one tree serves them all.
        apart = 10.0 * (np.ptp(np.concatenate([points, new_points]), axis=0).max() + 1.0)
        new_places = np.column_stack([new_points, apart * new_surface])
        places = np.column_stack([points, apart * surface])

    if anchors is None:
        _, anchors = loose_tree(places).query(new_places, workers=thread_count())
    union = np.concatenate([new_places, places])
    k = min(NEIGHBORS + 1, len(union))
    distances, index = loose_tree(union).query(new_places, k=k, workers=thread_count())
    rows = np.repeat(np.arange(count), k - 1)
    columns = index[:, 1:].ravel()
    gaps = distances[:, 1:].ravel()
    same = gaps < apart / 2
    rows, columns, gaps = rows[same], columns[same], gaps[same]
    typical = float(np.median(gaps)) if len(gaps) else 1.0
    weights = 1.0 / np.maximum((gaps / max(typical, 1e-9)) ** 2, 1e-2)

    inner = columns < count
    links = coo_array((weights[inner], (rows[inner], columns[inner])), shape=(count, count)).tocsr()
    links = (links + links.T) / 2
    rim = coo_array((weights[~inner], (rows[~inner], columns[~inner] - count)), shape=(count, len(points))).tocsr()
    degree = links.sum(axis=1) + rim.sum(axis=1) + ANCHOR_WEIGHT
    system = diags_array(degree) - links
    start = colors[anchors].astype(np.float64)
    right = rim @ colors.astype(np.float64) + ANCHOR_WEIGHT * start
    preconditioner = diags_array(1.0 / degree)
    solved = [
        cg(system, right[:, i], x0=start[:, i], rtol=TOLERANCE, maxiter=MAX_ITERATIONS, M=preconditioner)[0]
        for i in range(3)
    ]
    return np.clip(np.column_stack(solved), 0.0, 1.0).astype(np.float32)


def colors_around(
    new_points: NDArray[np.float64],
    points: NDArray[np.float64],
    colors: NDArray[np.float32],
    spacing_m: float,
    predicted: NDArray[np.float32] | None = None,
    tree: cKDTree | None = None,
) -> NDArray[np.float32]:
    """(Q, 3) colours of new points, from the observed ones around and those that a network predicts.

    What a network predicts are means of what may be there. Beside observed surface its own colour, texture and all,
    is the best guess; across a hole the continuation of what is around it (on `val` voxel_unet's own error is half as
    large again).

    Args:
        new_points: (Q, 3) metres, in the frame of `points`.
        points: (N, 3) observed points, metres, near the origin.
        colors: (N, 3) in [0, 1].
        spacing_m: of the observed points.
        predicted: (Q, 3); where there are none the continuation goes on.
        tree: of the observed points, where there is one already.
    """
    tree = loose_tree(points) if tree is None else tree
    distances, rows = tree.query(new_points, workers=thread_count())

    def fading(reach: float) -> NDArray[np.float32]:
        return np.exp(-distances / (reach * spacing_m)).astype(np.float32)[:, None]

    smooth = inpainted_colors(new_points, points, colors, anchors=rows)
    if predicted is not None:
        around = fading(CONTINUED_REACH)
        smooth = around * smooth + (1 - around) * predicted
    beside = fading(NEAREST_REACH)
    return beside * colors[rows] + (1 - beside) * smooth
