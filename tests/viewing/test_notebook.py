"""Clouds and figures show themselves in notebooks: through IPython, as Jupyter asks for it."""

import base64
import io
import re
import time
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure

import pcdbench
from pcdbench import PointCloud, Scene
from pcdbench.leaderboard.results import Figures


def images(html: str) -> list[np.ndarray]:
    found = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
    return [matplotlib.image.imread(io.BytesIO(base64.b64decode(text))) for text in found]


def displayed(value: object) -> dict[str, str]:
    """What Jupyter would show of a value."""
    formatters = pytest.importorskip("IPython.core.formatters")
    shown, _ = formatters.DisplayFormatter().format(value)
    return shown


@pytest.mark.parametrize("colored", [True, False])
def test_a_completion_is_pictures_with_what_was_added_in_orange(room: Scene, colored: bool) -> None:
    class AddsFloor(pcdbench.Completer):
        def complete(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
            low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
            return PointCloud(np.concatenate([cloud.points, rng.uniform(low, [*high[:2], low[2]], (4000, 3))]))

    cloud = room.complete.select(room.complete.points[:, 2] > 0.05)
    done = pcdbench.complete(cloud if colored else cloud.without_colors(), AddsFloor())
    html = displayed(done)["text/html"]
    assert repr(done) in html
    above, _ = images(html)
    orange = (above[..., 0] > above[..., 2] + 0.5) & (above[..., 1] < 0.6)
    assert orange.mean() > 0.05, "the floor is seen from above"


def test_a_cloud_is_two_pictures_and_its_description(room: Scene) -> None:
    cloud = room.complete
    html = displayed(cloud)["text/html"]
    assert html == cloud._repr_html_() and repr(cloud) in html
    pictures = images(html)
    assert len(pictures) == 2
    for picture in pictures:
        ground = (picture[..., :3] > 0.99).all(axis=2).mean()
        assert 0.02 < ground < 0.98 and picture[..., :3].std() > 0.05, "a room on a white ground"
    assert "<script" not in html and len(html) < 400_000


def test_no_points_are_a_description() -> None:
    html = PointCloud(np.empty((0, 3)))._repr_html_()
    assert "PointCloud(0 points, no colour)" in html and images(html) == []


@pytest.mark.parametrize("points", [[[1.0, 2, 3]], [[0, 0, 0], [0, 0, 5]]])
def test_small_clouds_are_shown(points: list[list[float]]) -> None:
    assert len(images(PointCloud(points)._repr_html_())) == 2


@pytest.mark.parametrize("stray", [[20.0, 3.0, -30.0], [1e6, 1e6, -1e6]])
def test_strays_are_left_out_of_the_pictures(room: Scene, stray: list[float]) -> None:
    pictures = images(room.complete._repr_html_())
    with_stray = PointCloud(np.vstack([room.complete.points, [stray]]), np.vstack([room.complete.colors, [[1, 1, 1]]]))
    for picture, expected in zip(images(with_stray._repr_html_()), pictures, strict=True):
        np.testing.assert_array_equal(picture, expected)
    # So many are none, and may hide the others: what is drawn then is little, and costs little.
    many = np.concatenate([room.complete.points, np.tile(stray, (1 + len(room.complete) // 100, 1))])
    assert len(images(PointCloud(many)._repr_html_())) == 2


def test_large_clouds_cost_what_small_ones_do() -> None:
    rng = np.random.default_rng(0)
    cloud = PointCloud(rng.random((1_000_000, 3)) * [6, 5, 3])
    cloud.select(np.arange(100))._repr_html_()
    before = time.process_time()
    html = cloud._repr_html_()
    assert time.process_time() - before < 2
    assert "1,000,000 points" in html


def test_figures_show_themselves_and_tell_of_those_that_cannot() -> None:
    good, bad = Figure(), Figure()
    good.subplots().plot([1, 2])
    bad.subplots().set_title("$\\no_such_symbol$")
    figures = Figures({"<good>": good, "bad": bad})
    html = displayed(figures)["text/html"]
    assert len(images(html)) == 1 and "&lt;good&gt;" in html and "<good>" not in html
    assert "bad cannot be drawn: ValueError" in html
    assert list(figures) == ["<good>", "bad"] and figures["bad"] is bad and repr(figures) == "Figures(<good>, bad)"


def test_the_viewer_knows_neither_the_command_line_nor_the_leaderboard() -> None:
    imports = "".join(
        f"{path.name}: {line.strip()}\n"
        for path in Path(pcdbench.__file__).parent.glob("viewing/*.py")
        for line in path.read_text().splitlines()
        if re.match(r"\s*(from|import) pcdbench", line)
    )
    assert "notebook.py" in imports and "pcdbench.viewing.picture" in imports
    assert not re.search(r"pcdbench\.(cli|leaderboard)|pcdbench import .*(cli|leaderboard)", imports), imports
