"""The board's page in a headless Chromium: sort, filter, hover, rows, clouds, links, a phone, hostile names."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boards_for_tests import made_board
from browser_for_tests import found_in, run_chromium

from pcdbench import PointCloud
from pcdbench.leaderboard.board import Board
from pcdbench.leaderboard.case_clouds import CaseClouds
from pcdbench.leaderboard.page import board_page
from pcdbench.viewing.page import embedded_json
from pcdbench.viewing.shown import shown_clouds

COMMAND = "pcdbench leaderboard case boards/rooms"
SIZE = (1280, 900)
DRIVER = """
const all = (selector) => [...document.querySelectorAll(selector)];
const click = (selector) => document.querySelector(selector).click();
const pick = (name, text) => {
  const label = all(`[data-choice='${name}'] label`).find((its) => its.innerText === text);
  label.querySelector("input").click();
};
const select = (name, text) => {
  const its = document.querySelector(`[data-choice='${name}']`);
  its.value = [...its.options].find((one) => one.text === text).value;
  its.dispatchEvent(new Event("change"));
};
const names = (part = "methods") => all(`[data-place='table'] tbody.${part} .name bdi`).map((its) => its.textContent);
const column = (kind) => all(`[data-place='table'] tbody.methods .${kind}`).map((its) => its.innerText);
const link = (hash) => { location.hash = hash; window.dispatchEvent(new HashChangeEvent("hashchange")); };
const move = (svg, x, y) => {
  const box = svg.getBoundingClientRect();
  const at = { clientX: box.left + x * box.width, clientY: box.top + y * box.height };
  svg.dispatchEvent(new PointerEvent("pointermove", at));
};
const note = () => {
  const its = document.querySelector(".note");
  return its.hidden ? null : [...its.children].map((line) => line.textContent);
};
"""


def seen(board: Board, script: str, folder: Path) -> Any:
    return found_in(board_page(board, case_command=COMMAND), DRIVER + script, folder, SIZE)


@pytest.fixture(scope="module")
def board() -> Board:
    return made_board(failing="holes", saw_test="planes", data=("indoor", "offices"))


def test_filters_and_sorting_show_the_numbers_of_the_board(board: Board, tmp_path: Path) -> None:
    found = seen(
        board,
        """
        const out = { overview: names(), above: names("references") };
        out.heads = all("thead .task").map((its) => its.innerText);
        pick("task", "tracking"); pick("level", "50 %"); pick("incompleteness", "short_scan"); pick("data", "offices");
        out.values = column("value"); out.ranks = column("rank"); out.names = names();
        out.figures = all(".figures svg").length;
        click("[data-sort='seconds']"); click("[data-sort='seconds']"); out.slowest = names();
        out.aria = document.querySelector("thead [aria-sort]").getAttribute("aria-sort");
        document.querySelector("[data-sort='name']").focus();
        document.activeElement.click(); out.focus = document.activeElement.dataset.sort;
        out.byName = names();
        select("metric", "final_drift_m"); select("statistic", "90th percentile");
        out.other = column("value"); out.unranked = column("rank");
        click("[data-toggles='3']"); out.hidden = names(); out.references = names("references");
        click("[data-choice='everyone']"); out.again = names();
        out.hash = location.hash;
        return out;
        """,
        tmp_path,
    )
    expected = {
        its.completer: its
        for its in board.standings
        if (its.data, its.incompleteness, its.level, its.metric) == (1, "short_scan", 0.5, "tracking_error_m")
    }
    assert found["heads"] == ["chamfer", "ssim", "localization", "tracking"]
    assert found["overview"] == found["names"] == ["planes", "holes", "network"]
    assert found["above"] == ["ground_truth", "resample", "incomplete"]
    assert [text.split()[0] for text in found["values"]] == [
        f"{expected[name].median.value:.3f}" for name in found["names"]
    ]
    assert [int(text) for text in found["ranks"]] == [expected[name].rank for name in found["names"]]
    assert found["figures"] == 3
    assert found["slowest"] == ["network", "holes", "planes"] and found["aria"] == "descending"
    assert found["byName"] == ["holes", "network", "planes"] and found["focus"] == "name"
    drift = {
        its.completer: its.p90.value
        for its in board.standings
        if (its.data, its.incompleteness, its.level, its.metric) == (1, "short_scan", 0.5, "final_drift_m")
    }
    assert [text.split()[0] for text in found["other"]] == [f"{drift[name]:.3f}" for name in found["byName"]]
    assert found["unranked"] == ["", "", ""]
    assert found["hidden"] == ["holes", "network"] and len(found["references"]) == 3
    assert found["again"] == found["byName"]
    for part in ("data=offices", "incompleteness=short_scan", "level=0.5", "metric=final_drift_m", "statistic=p90"):
        assert part in found["hash"]


def test_hovering_and_keys_tell_value_share_and_completer(board: Board, tmp_path: Path) -> None:
    found = seen(
        board,
        """
        pick("task", "ssim");
        const [distribution, levels, time] = all(".figures svg"), out = { none: note() };
        const at = (path) => {
          const middle = path.getPointAtLength(path.getTotalLength() / 2), box = path.ownerSVGElement.viewBox.baseVal;
          return [middle.x / box.width, middle.y / box.height];
        };
        move(distribution, ...at(distribution.querySelector("path.line[data-completer='3']")));
        out.distribution = note(); out.lit = all(".figures .lit").map((its) => its.dataset.completer);
        distribution.dispatchEvent(new PointerEvent("pointerleave")); out.left = note();
        move(levels, ...at(levels.querySelector("path.mark[data-completer='4']"))); out.levels = note();
        move(time, ...at(time.querySelector("path.mark[data-completer='5']"))); out.time = note();
        const press_ = (key) => distribution.dispatchEvent(new KeyboardEvent("keydown", { key, cancelable: true }));
        press_("ArrowRight"); out.first = note(); press_("ArrowRight"); out.second = note();
        press_("ArrowDown"); out.below = note(); press_("Escape"); out.escaped = note();
        return out;
        """,
        tmp_path,
    )
    assert found["none"] is found["left"] is found["escaped"] is None
    name, line = found["distribution"]
    assert name == "planes" and line.split()[1:6] == ["%", "of", "samples", "at", "most"]
    share, value = int(line.split()[0]) / 100, float(line.split()[6])
    samples = [
        its
        for cell in board.cells
        if cell.completer == "planes"
        and (case := board.cases[cell.case]).data == 0
        and (case.incompleteness, case.level) == ("holes", 0.3)
        for its in cell.results["ssim"].samples
    ]
    assert value == pytest.approx(np.quantile(samples, share), abs=6e-4)
    assert set(found["lit"]) == {"3"}
    assert found["levels"][0] == "holes" and found["levels"][1].startswith("10 % missing: 0.")
    assert found["time"][0] == "network" and found["time"][2] == "600 ms, 100 MB"
    assert found["first"][0] == found["second"][0] == "ground_truth" and found["below"][0] == "resample"
    assert found["first"][1].startswith("0 %") and found["second"][1].startswith("1 %")


def test_a_number_leads_to_its_rows_and_a_row_to_its_key_and_command(board: Board, tmp_path: Path) -> None:
    found = seen(
        board,
        """
        const out = {};
        pick("task", "localization");
        all("[data-place='table'] tbody.methods .value .number")[1].click();
        const dialog = document.querySelector("dialog");
        out.open = dialog.open; out.title = dialog.querySelector("h2").textContent;
        out.lines = all(".line-head").map((its) => [...its.children].map((one) => one.textContent));
        all(".line-head")[0].click(); out.failed = document.querySelector(".detail").textContent;
        all(".line-head")[1].click(); out.detail = document.querySelector(".detail").textContent;
        out.strokes = all(".strip .stroke").length;
        out.command = document.querySelector(".detail .command code").textContent;
        out.hash = location.hash;
        dialog.close(); dialog.dispatchEvent(new Event("close"));
        out.closed = !dialog.open && !location.hash.includes("rows=");
        all("[data-place='table'] tbody.methods .value .number")[0].click();
        out.facts = document.querySelector("dialog .facts").textContent;
        return out;
        """,
        tmp_path,
    )
    cells = {
        board.cases[cell.case].scene: cell.results["localization"]
        for cell in board.cells
        if cell.completer == "holes"
        and board.cases[cell.case].data == 0
        and (board.cases[cell.case].incompleteness, board.cases[cell.case].level) == ("holes", 0.3)
    }
    assert found["open"] and found["closed"]
    assert found["title"] == "holes localization · localization_error_m · holes 30 %"
    assert found["lines"][0] == ["hall", "failed", cells["hall"].key] and len(found["lines"]) == 4
    worst = sorted(
        (scene for scene in cells if scene != "hall"), key=lambda scene: -cells[scene].values["localization_error_m"]
    )
    assert [line[0] for line in found["lines"][1:]] == worst
    assert [line[2] for line in found["lines"][1:]] == [cells[scene].key for scene in worst]
    assert "failed: ran out of luck" in found["failed"]
    assert "10 samples, by size" in found["detail"] and found["strokes"] == 10
    assert found["command"] == f"{COMMAND} {cells[worst[0]].key}"
    assert "rows=holes" in found["hash"] and f"case={worst[0]}" in found["hash"]
    assert "reach_m0.5" in found["facts"] and "its card names hall" in found["facts"]


def clouds_of(board: Board, case: int) -> CaseClouds:
    """A red room for the truth, and a thinner one of another colour for every completer."""
    rng = np.random.default_rng(0)
    labels = [None, None, *(its.label for its in board.completers if not its.reference)]
    clouds = []
    for place, label in enumerate(labels):
        count = 3000 - 200 * place
        color = np.tile([0.8, 0.1, 0.1] if place == 0 else [0.1, 0.2, 0.8], (count, 1))
        clouds.append((label or ["true", "incomplete"][place], PointCloud(rng.random((count, 3)) * [4, 3, 1], color)))
    return CaseClouds(case, "room", tuple(labels), tuple(shown_clouds(clouds, [None] * len(clouds), None, 3000)))


def test_the_clouds_of_a_case_turn_together_and_follow_the_filters(board: Board, tmp_path: Path) -> None:
    middle = next(
        i for i, its in enumerate(board.cases) if (its.data, its.incompleteness, its.level) == (0, "holes", 0.3)
    )
    clouds = [clouds_of(board, middle + 1), clouds_of(board, middle + 2)]
    # The observer that waits for the clouds to come near would not fire before the script has ended.
    found = found_in(
        board_page(board, clouds, case_command=COMMAND).replace(
            '<script type="application/json" id="board">',
            "<script>const observers = []; window.IntersectionObserver = class { constructor(tell) { this.tell = tell; "
            'observers.push(this); } observe() {} };</script><script type="application/json" id="board">',
        ),
        DRIVER
        + """
        const out = {}, section = document.querySelector("[data-place='clouds']");
        select("case", "office (with clouds)");
        out.waiting = section.children.length;
        for (const its of observers) its.tell([{ isIntersecting: true }]);
        out.captions = all(".panel strong").map((its) => its.textContent);
        out.drawn = canvases().map(drawn); out.first = mean(canvases()[0]);
        const before = sums();
        press(canvases()[1], "ArrowLeft"); out.turned = sums().map((value, i) => value !== before[i]);
        click("[data-toggles='4']"); out.panels = all(".panel").map((its) => its.hidden);
        select("case", "kitchen (with clouds)");
        out.viewers = all(".pcdbench-viewer").length; out.redrawn = canvases().map(drawn);
        select("case", "lobby"); out.none = section.textContent; out.left = canvases().length;
        pick("level", "10 %"); out.scene = document.querySelector("[data-choice='case']").selectedOptions[0].text;
        out.hash = location.hash;
        return out;
        """,
        tmp_path,
        SIZE,
    )
    assert found["waiting"] == 0, "nothing is decoded before it is near"
    assert found["captions"] == ["true", "incomplete", "planes", "holes", "network"]
    assert min(found["drawn"]) > 2000 and found["first"][0] > found["first"][2] + 80
    assert found["turned"] == [True] * 5
    assert found["panels"] == [False, False, False, True, False], "holes is hidden everywhere"
    assert found["viewers"] == 1 and sum(count > 2000 for count in found["redrawn"]) == 4
    assert found["left"] == 0 and f"{COMMAND} " in found["none"]
    assert found["scene"] == "lobby" and "case=lobby" in found["hash"]


def test_a_link_opens_what_it_names_and_passes_over_what_is_gone(board: Board, tmp_path: Path) -> None:
    found = seen(
        board,
        """
        const shown = () => ({
          checked: all("[data-choice] input:checked").map((its) => its.closest("label").innerText), names: names(),
          metric: document.querySelector("[data-choice='metric']").selectedOptions[0]?.text,
          rows: document.querySelector("dialog").open && document.querySelector("dialog h2 bdi").textContent,
          opened: all(".line.open .case").map((its) => its.textContent),
        });
        const out = {};
        link("data=offices&incompleteness=short_scan&level=0.1&task=chamfer&metric=f_score&sort=-seconds&hide=network&rows=planes&case=kitchen");
        out.all = shown();
        link("data=gone&incompleteness=none&level=7&task=away&metric=x&hide=nobody&rows=nobody&case=nowhere&sort=constructor");
        out.gone = shown();
        return out;
        """,
        tmp_path,
    )
    assert found["all"]["checked"] == ["chamfer", "10 %", "short_scan", "offices"]
    assert found["all"]["metric"] == "f_score" and found["all"]["names"] == ["holes", "planes"]
    assert found["all"]["rows"] == "planes" and found["all"]["opened"] == ["kitchen"]
    assert found["gone"]["checked"] == ["All tasks", "50 %", "holes", "indoor"], "the nearest level there is"
    assert found["gone"]["rows"] is False and found["gone"]["names"] == ["planes", "holes", "network"]


def test_who_shares_a_rank_is_ordered_by_value_and_names_break_after_underscores(tmp_path: Path) -> None:
    few = made_board(scenes=["hall"])
    found = seen(
        few,
        """
        pick("task", "tracking");
        const out = { ranks: column("rank"), names: names() };
        click("[data-sort='rank']"); out.down = names();
        out.metric = document.querySelector("caption bdi + bdi, caption strong").innerHTML;
        return out;
        """,
        tmp_path,
    )
    ranked = [
        (its.rank, its.median.value, its.completer)
        for its in few.standings
        if (its.incompleteness, its.level, its.metric) == ("holes", 0.3, "tracking_error_m") and its.rank
    ]
    assert found["ranks"] == ["1", "1", "2"]
    assert found["names"] == [name for _, _, name in sorted(ranked)] != ["planes", "holes", "network"]
    assert found["down"] == found["names"][::-1]
    assert "tracking_<wbr>error_<wbr>m" in found["metric"]


def test_who_was_measured_on_fewer_cases_is_told_and_stands_before_who_was_on_none(tmp_path: Path) -> None:
    whole = made_board()
    fewer = {"holes": {"rank": None, "cases": 3}, "planes": {"rank": None, "cases": 0, "median": None, "failed": 4}}
    standings = [replace(its, **fewer.get(its.completer, {})) for its in whole.standings]
    found = seen(
        replace(whole, standings=tuple(standings)),
        """
        const row = (name) => all("tbody.methods tr").find((its) => its.textContent.includes(name));
        const told = (name) => row(name).querySelector(".value .place, .value .lost").textContent;
        const out = { told: ["network", "holes", "planes"].map(told) };
        pick("task", "chamfer"); out.names = names();
        return out;
        """,
        tmp_path,
    )
    assert found["told"] == ["#2", "3 of 4 cases", "4 failed"]
    assert found["names"] == ["network", "holes", "planes"]


EVIL = [
    "</script><script>document.body.dataset.evil=1</script>",
    '"><img src=x onerror="document.body.dataset.evil=2">',
    "مرحبا بالعالم",
    "__proto__",
]


def test_names_made_to_break_pages_are_shown_as_they_are(tmp_path: Path) -> None:
    board = made_board(EVIL, [*EVIL, "x" * 90], name=EVIL[0], failing=EVIL[1], saw_test=EVIL[0], error=EVIL[1])
    found = seen(
        board,
        """
        const out = { names: names() };
        pick("task", "chamfer"); out.ranked = names();
        out.direction = getComputedStyle(document.querySelector(".name bdi")).unicodeBidi;
        for (const number of all("tbody.methods .value .number")) {
          number.click();
          for (let i = 0; i < all(".line-head").length; i++) all(".line-head")[i].click();
          document.querySelector("dialog").close();
        }
        link(new URLSearchParams({ task: "chamfer", rows: out.names[0] }).toString());
        out.rows = document.querySelector("dialog h2 bdi").textContent;
        out.title = document.querySelector("h1").textContent;
        out.evil = document.body.dataset.evil ?? null; out.made = all("img, b").length;
        return out;
        """,
        tmp_path,
    )
    assert sorted(found["names"]) == sorted(found["ranked"]) == sorted(EVIL)
    assert found["rows"] == found["names"][0] and found["title"] == EVIL[0] and found["direction"] == "isolate"
    assert found["evil"] is None and found["made"] == 0


@pytest.mark.parametrize("view", ["", "task=chamfer", "task=tracking&rows=planes&case=hall"])
def test_a_phone_shows_everything_without_scrolling_sideways(board: Board, tmp_path: Path, view: str) -> None:
    long = made_board(["a_completer_with_quite_a_long_name", "b" * 60, "planes"], ["hall", "a_scene_of_many_words" * 4])
    page = board_page(long, [clouds_of(long, 0)], case_command=COMMAND + "/" + "d" * 80)
    found = found_in(
        '<html><head><meta http-equiv="Content-Security-Policy" content=""></head><body></body></html>',
        f"""
        const frame = document.createElement("iframe");
        frame.style.width = "390px"; frame.style.height = "844px";
        document.body.append(frame);
        const inner = frame.contentDocument, there = frame.contentWindow;
        inner.open(); inner.write({embedded_json(page)}); inner.close();
        // Opening a document takes its address without what is after the #.
        there.location.hash = {json.dumps(view)};
        there.dispatchEvent(new there.HashChangeEvent("hashchange"));
        const may = ".scrolls, .command, svg, .radios label, .pcdbench-viewer input";
        const wide = [...inner.querySelectorAll("body *")]
          .filter((its) => its.getBoundingClientRect().right > 391 && !its.closest(may));
        const text = inner.querySelector("tbody.methods .main, tbody.methods .number");
        const caption = inner.querySelector("[data-place='table'] caption").lastElementChild;
        return {{ caption: caption.getBoundingClientRect().right,
          table: inner.querySelector("[data-place='table'] table").className,
          wide: wide.map((its) => its.outerHTML.slice(0, 80)), width: inner.documentElement.scrollWidth,
          inner: frame.contentWindow.innerWidth, shown: text.getBoundingClientRect().width,
          size: getComputedStyle(text).fontSize }};
        """,
        tmp_path,
    )
    assert found["inner"] == 390
    assert found["table"] == ("ranking" if view else "overview")
    assert found["width"] <= 390 and found["wide"] == [] and found["caption"] <= 391
    assert found["shown"] > 10 and float(found["size"][:-2]) >= 13


def test_the_page_works_under_its_own_policy(board: Board, tmp_path: Path) -> None:
    path = tmp_path / "board.html"
    path.write_text(board_page(board, [clouds_of(board, 0)], case_command=COMMAND), encoding="utf-8")
    dom = run_chromium(path, tmp_path, "--dump-dom")
    assert dom.count('class="methods"') == 1 and "mean rank" in dom
