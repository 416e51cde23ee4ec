"""The page: self-contained, safe whatever names clouds have, and one line for each mistake."""

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import pcdbench
from pcdbench import PcdbenchError, PointCloud
from pcdbench.viewing.page import viewer_assets, viewer_element

EVIL = "</title></script><script>document.body.dataset.evil=1</script><img src=x onerror=alert(1)>\"'&.ply"


class Elements(HTMLParser):
    """All elements with their attributes, and the text within each kind."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        self.texts.setdefault(self._open[-1] if self._open else "", []).append(data)


def test_names_made_to_break_pages_are_text(cloud: PointCloud) -> None:
    page = Elements(pcdbench.view({EVIL: cloud, "b": cloud}).html)
    assert [tag for tag, _ in page.found].count("script") == 2
    assert "img" not in [tag for tag, _ in page.found]
    assert page.texts["strong"] == [EVIL, "b"] and page.texts["title"] == [f"{EVIL} · b"]
    assert any(f"not in {EVIL}" in text for text in page.texts["span"])
    assert not any(name.startswith("on") for _, attributes in page.found for name in attributes)


def test_the_page_needs_nothing_from_elsewhere_and_allows_nothing(cloud: PointCloud) -> None:
    html = pcdbench.view(cloud).html
    page = Elements(html)
    assert not {"src", "href", "srcset", "action"} & {name for _, attributes in page.found for name in attributes}
    assert "url(" not in html and "@import" not in html and "://" not in html
    (policy,) = (its["content"] for _, its in page.found if its.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None and policy.startswith("default-src 'none'; script-src 'sha256-")
    for kind in ("script", "style"):
        for text in re.findall(rf"<{kind}>(.*?)</{kind}>", html, re.DOTALL):
            digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
            assert f"'sha256-{digest}'" in policy


def test_captions_tell_numbers(cloud: PointCloud) -> None:
    more = PointCloud(np.concatenate([cloud.points, np.add(cloud.points[:25], [0, 0, 0.5])]))
    view = pcdbench.view({"a": cloud, "b": more}, reference=cloud, points=80)
    lines = Elements(view.html).texts["span"]
    assert "100 points · thinned to 80" in lines
    assert "125 points · thinned to 80 · no colour · 25 not in a (20%)" in lines
    assert any(line.startswith("to the reference: median 0.000 m, 95 % within 0.") for line in lines)
    marked = pcdbench.view({"b": more}, added={"b": np.arange(125) >= 100})
    assert "125 points · no colour · 25 added (20%)" in Elements(marked.html).texts["span"]


def test_200_000_points_are_a_page_of_under_three_megabytes() -> None:
    rng = np.random.default_rng(0)
    cloud = PointCloud(rng.random((200_000, 3)), rng.random((200_000, 3)))
    size = len(pcdbench.view({"a": cloud}, added={"a": rng.random(200_000) < 0.5}, reference=cloud).html)
    # Six bytes of position, three of colour, one of distance, a bit; in base64.
    assert 200_000 * (10 + 1 / 8) * 4 / 3 < size < 2.8e6


def test_the_parts_make_another_page_with_several_viewers(cloud: PointCloud) -> None:
    shown = pcdbench.view({"<a>": cloud}).shown
    page = Elements(f"{viewer_assets()}{viewer_element(shown, 'one')}{viewer_element(shown, 'two')}")
    titles = [its["aria-label"] for tag, its in page.found if tag == "section"]
    assert titles == ["one", "two"]
    data = [json.loads(text) for text in page.texts["script"] if text.startswith("{")]
    assert len(data) == 2 and data[0]["clouds"][0]["xyz"]


def test_a_notebook_shows_the_page_in_a_frame_that_can_reach_nothing(cloud: PointCloud) -> None:
    view = pcdbench.view({EVIL: cloud})
    ((tag, attributes),) = Elements(view._repr_html_()).found
    assert tag == "iframe" and attributes["srcdoc"] == view.html
    assert attributes["sandbox"] == "allow-scripts" and attributes["loading"] == "lazy"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"clouds": {}}, "there is no cloud to view; give at least one"),
        ({"clouds": {"a": PointCloud(np.empty((0, 3)))}}, "a has no points, so there is nothing to view; leave it out"),
        ({"points": 0}, "0 points cannot be viewed; show at least 1 of each cloud"),
        ({"added": {"b": np.ones(2)}}, "added names 'b', which is no cloud here; use one of a"),
        ({"added": {"a": np.ones(3)}}, "added of a has shape (3,); give one value for each of 2 points"),
        ({"reference": PointCloud(np.empty((0, 3)))}, "the reference has no points"),
    ],
)
def test_mistakes_are_one_line(arguments: dict, says: str) -> None:
    clouds = {"clouds": {"a": PointCloud([[0, 0, 0], [1, 1, 1]])}}
    with pytest.raises(PcdbenchError) as error:
        pcdbench.view(**(clouds | arguments))
    assert str(error.value).startswith(says) and "\n" not in str(error.value)


def test_a_page_is_written_whole_or_not_at_all(cloud: PointCloud, tmp_path: Path) -> None:
    view = pcdbench.view(cloud)
    assert view.write(tmp_path / "new" / "a.html").read_text(encoding="utf-8") == view.html
    scan = tmp_path / "scan.ply"
    scan.write_text("precious")
    with pytest.raises(PcdbenchError, match=r"scan\.ply is no name for a page; let it end in \.html"):
        view.write(scan)
    with pytest.raises(PcdbenchError, match="cannot be written: File exists; choose another place"):
        view.write(scan / "a.html")
    assert scan.read_text() == "precious" and sorted(path.name for path in tmp_path.iterdir()) == ["new", "scan.ply"]
