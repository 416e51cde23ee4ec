"""The viewer in a headless Chromium: it draws, colours, cuts, turns all panels together, and runs under its policy."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from browser_for_tests import found_in, run_chromium

import pcdbench
from pcdbench import PointCloud
from pcdbench.viewing.page import View, viewer_assets, viewer_element

RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)


def slab(low: tuple[float, ...], high: tuple[float, ...], color: tuple[float, ...], count: int = 4000) -> PointCloud:
    points = np.random.default_rng(0).uniform(low, high, (count, 3))
    return PointCloud(points, np.tile(color, (count, 1)))


@pytest.fixture(scope="module")
def view() -> View:
    """A red floor; the same with a blue ceiling that hides it."""
    floor, ceiling = slab((0, 0, 0), (5, 4, 0.02), RED), slab((0, 0, 2.5), (5, 4, 2.52), BLUE)
    return pcdbench.view({"floor": floor, "both": PointCloud.concatenate([floor, ceiling])}, reference=floor)


def test_modes_color_the_pixels_and_the_slider_takes_the_ceiling_off(view: View, tmp_path: Path) -> None:
    found = found_in(
        view.html,
        """
        const out = { started: document.querySelector("section").dataset.started };
        const [first, second] = canvases();
        press(first, "t");
        slide("size", 1);
        out.floor = mean(first); out.cut = mean(second); out.label = document.querySelector("output").textContent;
        slide("cut", 99);
        out.whole = mean(second); out.all = document.querySelector("output").textContent;
        for (const mode of ["color", "added", "height", "distance"]) {
          choose(mode);
          const legends = [...document.querySelectorAll("[data-legend]:not([hidden])")].map((its) => its.innerText);
          out[mode] = { first: mean(first), second: mean(second), drawn: drawn(second), sums: sums(), legends };
        }
        choose("color");
        const before = drawn(first); slide("size", -2); out.small = drawn(first) / before;
        return out;
        """,
        tmp_path,
    )
    assert found["started"] == "yes"
    red, blue = np.array(RED) * 255, np.array(BLUE) * 255
    assert found["floor"] == pytest.approx(red, abs=25), "the first panel shows the floor"
    assert found["cut"] == pytest.approx(red, abs=25), "the ceiling is taken off at first"
    assert found["whole"] == pytest.approx(blue, abs=25), "it hides the floor when it is put on"
    assert found["label"].endswith(" m") and found["all"] == "all"
    assert len({str(found[mode]["sums"]) for mode in ("color", "added", "height", "distance")}) == 4
    added = found["added"]
    assert added["second"][0] > added["second"][2] + 100, "what is added is orange"
    assert np.ptp(added["first"]) < 30, "what was observed is grey"
    # Nearly the first and the last colour of viridis, nearly the first one of plasma: the reference itself.
    assert found["height"]["first"] == pytest.approx([70, 52, 128], abs=25)
    assert found["height"]["second"] == pytest.approx([253, 231, 37], abs=25)
    assert found["distance"]["first"] == pytest.approx([86, 1, 164], abs=20)
    assert found["distance"]["drawn"] > 20_000
    assert found["color"]["legends"] == []
    assert [len(found[mode]["legends"]) for mode in ("added", "height", "distance")] == [1, 1, 1]
    assert found["distance"]["legends"][0].split() == ["0", "5", "m", "from", "the", "reference"]
    assert found["small"] < 0.6


def test_confidence_colors_what_was_added_alone(tmp_path: Path) -> None:
    floor = slab((0, 0, 0), (5, 4, 0.02), BLUE)
    added = {"seen": np.zeros(len(floor), bool), "doubtful": np.ones(len(floor), bool)}
    trust = {"sure": np.ones(len(floor)), "seen": np.ones(len(floor)), "doubtful": np.zeros(len(floor))}
    view = pcdbench.view(dict.fromkeys(trust, floor), added=added, confidence=trust)
    found = found_in(
        view.html,
        """
        choose("confidence");
        press(canvases()[0], "t");
        slide("size", 1);
        const legends = [...document.querySelectorAll("[data-legend]:not([hidden])")].map((its) => its.innerText);
        return { means: canvases().map(mean), legends };
        """,
        tmp_path,
    )
    sure, seen, doubtful = (np.array(mean) for mean in found["means"])
    assert np.ptp(seen) < 30, "what was observed is grey"
    assert doubtful[0] > doubtful[1] + 80, "red"
    assert sure[1] > sure[0] + 60, "green, and all of a cloud that says nothing of what was added"
    assert found["legends"][0].split()[-1] == "1" and len(found["legends"]) == 1


def test_mouse_touch_and_keys_move_all_panels_together(view: View, tmp_path: Path) -> None:
    found = found_in(
        view.html,
        """
        const [first, second] = canvases(), out = {};
        const moved = (name, act) => {
          document.querySelector("[data-control='reset']").click();
          const before = sums(); act(); const after = sums();
          out[name] = after.map((value, i) => value !== before[i]);
        };
        const drag = (more = {}) => {
          pointer(first, "down", 100, 100, more);
          pointer(first, "move", 140, 120, more);
          pointer(first, "up", 140, 120, more);
        };
        moved("none", () => pointer(first, "move", 150, 150));
        moved("turned", drag);
        moved("shifted", () => drag({ shiftKey: true }));
        moved("right", () => drag({ buttons: 2, button: 2 }));
        moved("wheel", () => second.dispatchEvent(new WheelEvent("wheel", { deltaY: -200, cancelable: true })));
        moved("pinch", () => {
          const other = { pointerId: 2 };
          pointer(second, "down", 100, 100);
          pointer(second, "down", 200, 100, other);
          pointer(second, "move", 60, 100);
          pointer(second, "up", 60, 100);
          pointer(second, "up", 200, 100, other);
        });
        for (const key of ["ArrowLeft", "ArrowUp", "+", "-", "t"]) moved(key, () => press(second, key));
        moved("pan key", () => press(second, "ArrowLeft", { shiftKey: true }));
        moved("other key", () => press(second, "x"));
        document.querySelector("[data-control='reset']").click();
        const before = drawn(first);
        for (let i = 0; i < 4; i++) press(first, "+");
        out.zoomed = drawn(first) / before;
        return out;
        """,
        tmp_path,
    )
    still = {name for name, panels in found.items() if panels == [False, False]}
    assert still == {"none", "other key"}
    zoomed = found.pop("zoomed")
    assert all(panels in ([True, True], [False, False]) for panels in found.values()), found
    assert 1.3 < zoomed < 2.6, "closer by 0.9 to the fourth, the picture's area is 2.3 times as large at most"


def test_a_phone_stacks_the_panels_and_nothing_overflows(view: View, tmp_path: Path) -> None:
    found = found_in(
        view.html,
        """
        const boxes = canvases().map((canvas) => canvas.getBoundingClientRect());
        return { tops: boxes.map((box) => box.top), lefts: boxes.map((box) => box.left),
                 wide: document.documentElement.scrollWidth, window: innerWidth };
        """,
        tmp_path,
        size=(500, 900),
    )
    assert found["wide"] <= found["window"]
    assert found["tops"][1] > found["tops"][0] and found["lefts"][0] == found["lefts"][1]


def test_the_page_draws_as_it_is_under_its_policy(view: View, tmp_path: Path) -> None:
    page = view.write(tmp_path / "page.html")
    picture = tmp_path / "picture.png"
    run_chromium(page, tmp_path, f"--screenshot={picture}", "--virtual-time-budget=3000")
    pixels = matplotlib.image.imread(picture)[..., :3]
    red = (pixels[..., 0] > 0.5) & (pixels[..., 1:] < 0.3).all(axis=2)
    assert red.sum() > 5000, "the floor is seen"


def test_viewers_of_one_page_do_not_disturb_each_other(view: View, tmp_path: Path) -> None:
    parts = [viewer_assets(), *(viewer_element(view.shown, title) for title in ("one", "two"))]
    policy = '<meta http-equiv="Content-Security-Policy" content="">'
    found = found_in(
        f"<!DOCTYPE html><html><head>{policy}</head><body>{''.join(parts)}</body></html>",
        """
        const before = sums();
        choose("height");
        press(canvases()[0], "ArrowLeft");
        return { before, after: sums() };
        """,
        tmp_path,
    )
    before, after = found["before"], found["after"]
    assert len(before) == 4 and before[:2] == before[2:]
    assert after[2:] == before[2:] and after[0] != before[0] and after[1] != before[1]
