"""The page of a board: everything of the board is in it, packed, and whatever names say, it is text."""

import base64
import hashlib
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from importlib import resources
from itertools import chain, combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boards_for_tests import REFERENCES, TASKS, made_board
from hypothesis import given, settings
from hypothesis import strategies as st
from runs_for_tests import full_row, store_run

from pcdbench import PointCloud
from pcdbench.leaderboard.board import Board
from pcdbench.leaderboard.building import board_of_runs
from pcdbench.leaderboard.case_clouds import CaseClouds, shown_cases
from pcdbench.leaderboard.page import board_page
from pcdbench.leaderboard.page_data import CURVE_STEPS, SAMPLES_AT_MOST, packed_floats, page_payload
from pcdbench.viewing.shown import shown_clouds

EVIL = [
    "</script><script>document.body.dataset.evil=1</script>",
    '"><img src=x onerror=alert(1)>',
    "مرحبا",
    "a'b&amp;\u2028",
]
COMMAND = "pcdbench leaderboard case boards/rooms"


def bytes_of(text: str, kind: str = "u1") -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def short_floats(text: str) -> np.ndarray:
    packed = bytes_of(text).reshape(-1, 3)
    return np.concatenate([np.zeros((len(packed), 1), np.uint8), packed], axis=1).view("<f4")[:, 0]


@pytest.fixture(scope="module")
def board() -> Board:
    return made_board(failing="network", saw_test="planes", data=("indoor", "offices"))


@pytest.fixture(scope="module")
def payload(board: Board) -> dict[str, Any]:
    return page_payload(board)


def test_every_standing_is_in_the_columns(board: Board, payload: dict[str, Any]) -> None:
    metrics = [(payload["tasks"][its["task"]]["name"], its["name"]) for its in payload["metrics"]]
    labels = [its["name"] for its in payload["completers"]]
    settings = [
        (its["dataset"], payload["incompletenesses"][its["incompleteness"]], its["level"])
        for its in payload["settings"]
    ]
    shape = (len(settings), len(metrics), len(labels))
    medians = bytes_of(payload["estimates"]["median"], "<f4").reshape(*shape, 3)
    counts = {name: bytes_of(text, "<u2").reshape(shape) for name, text in payload["counts"].items()}
    seconds = bytes_of(payload["seconds"], "<f4").reshape(shape[::2])
    assert len(board.standings) == np.prod(shape)
    for its in board.standings:
        setting = settings.index((its.data, its.incompleteness, its.level))
        at = (setting, metrics.index((its.task, its.metric)), labels.index(its.completer))
        assert its.median is not None
        assert medians[at] == pytest.approx([its.median.value, its.median.low, its.median.high], rel=1e-6)
        found = {name: int(count[at]) for name, count in counts.items()}
        assert found == {"cases": its.cases, "failed": its.failed, "skipped": 0, "ranks": its.rank or 0}
        assert seconds[setting, at[2]] == pytest.approx(its.seconds)


def test_every_row_is_in_the_columns_with_its_key_samples_and_reason(board: Board, payload: dict[str, Any]) -> None:
    labels, tasks = [its["name"] for its in payload["completers"]], [its["name"] for its in payload["tasks"]]
    shape = (len(board.cases), len(labels), len(tasks))
    keys = bytes_of(payload["keys"]).reshape(*shape, 8)
    statuses = bytes_of(payload["statuses"]).reshape(shape)
    reasons = bytes_of(payload["row_reasons"], "<u2").reshape(shape)
    values = short_floats(payload["values"]).reshape(len(payload["metrics"]), *shape[:2])
    packed = []
    for its in payload["samples_of"]:
        ends = None if its is None else np.cumsum(bytes_of(its["counts"], "<u2").astype(int))
        packed.append(None if its is None else np.split(short_floats(its["values"]), ends[:-1]))
    for cell in board.cells:
        at = (cell.case, labels.index(cell.completer))
        for task, result in cell.results.items():
            row = (*at, tasks.index(task))
            assert bytes(keys[row]).hex() == result.key
            assert ["ok", "failed"][statuses[row]] == result.status
            assert (payload["reasons"][reasons[row] - 1] if reasons[row] else None) == result.error
            for place, metric in enumerate(payload["metrics"]):
                if metric["task"] != tasks.index(task):
                    continue
                value = values[(place, *at)]
                expected = result.values.get(metric["name"])
                assert np.isnan(value) if expected is None else value == pytest.approx(expected, rel=2e-5)
                if metric["main"]:
                    assert packed[place][at[0] * shape[1] + at[1]] == pytest.approx(result.samples, rel=2e-5)
                else:
                    assert packed[place] is None


def test_curves_are_quantiles_of_all_samples(board: Board, payload: dict[str, Any]) -> None:
    shape = (len(payload["settings"]), len(payload["metrics"]), len(payload["completers"]), CURVE_STEPS + 1)
    curves = short_floats(payload["curves"]).reshape(shape)
    place = next(i for i, its in enumerate(payload["metrics"]) if its["name"] == "tracking_error_m")
    cases = [
        i for i, its in enumerate(board.cases) if (its.data, its.incompleteness, its.level) == (1, "short_scan", 0.5)
    ]
    samples = [
        value
        for cell in board.cells
        if cell.case in cases and cell.completer == "network"
        for value in cell.results["tracking"].samples
    ]
    assert len(samples) == 3 * 30, "one of four scenes failed"
    expected = np.quantile(samples, np.linspace(0, 1, CURVE_STEPS + 1))
    assert curves[-1, place, -1] == pytest.approx(expected, rel=2e-5)


@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(width=32, allow_nan=True, allow_infinity=False), min_size=1))
def test_short_floats_keep_five_digits_and_what_is_no_number(values: list[float]) -> None:
    given_ = np.array(values, np.float32)
    found = short_floats(packed_floats(given_))
    assert (np.isnan(found) == np.isnan(given_)).all()
    # The greatest floats round to infinity, the least ones have no more digits.
    usual = np.isfinite(given_) & (np.abs(given_) < 3e38) & (np.abs(given_) > 1e-30)
    assert found[usual] == pytest.approx(given_[usual], rel=2e-5)


def test_the_metrics_with_the_most_samples_are_left_out_where_all_are_too_many(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    total = {task: sum(len(cell.results[task].samples) for cell in board.cells) for task in TASKS}
    assert sum(total.values()) < SAMPLES_AT_MOST
    monkeypatch.setattr("pcdbench.leaderboard.page_data.SAMPLES_AT_MOST", sum(total.values()) - 1)
    payload = page_payload(board)
    held = {
        its["name"]: samples is not None for its, samples in zip(payload["metrics"], payload["samples_of"], strict=True)
    }
    assert not held["tracking_error_m"] and held["chd"] and held["ssim"] and held["localization_error_m"]


def test_a_board_on_which_nothing_was_measured_has_a_page() -> None:
    page = board_page(made_board(["network"], ["hall"], failing="network", tasks=["ssim"]), case_command=COMMAND)
    assert "12 rows" not in page and "Without measurements (6 rows)" in page


def test_what_was_skipped_throughout_on_one_data_set_is_counted_there(tmp_path: Path) -> None:
    for split, status in (("coloured", "ok"), ("grey", "skipped")):
        scenes = [f"{split} {number}" for number in range(3)]
        store_run(tmp_path / split, [full_row("a", [0.5], scene=its, status=status) for its in scenes], split=split)
    payload = page_payload(board_of_runs("b", [tmp_path]))
    counts = {name: bytes_of(payload["counts"][name], "<u2").tolist() for name in ("cases", "skipped")}
    assert [its["dataset"] for its in payload["settings"]] == [0, 1] and len(payload["metrics"]) == 1
    assert counts == {"cases": [3, 0], "skipped": [0, 3]}


class Elements(HTMLParser):
    """Start tags with their attributes, and all text outside of scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.text, self._inside = "", ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        self._inside = tag

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside not in ("script", "style"):
            self.text += data


def case_clouds(board: Board) -> CaseClouds:
    rng = np.random.default_rng(0)
    names = ["true", "incomplete", *(its.label for its in board.completers if not its.reference)]
    clouds = [(name, PointCloud(rng.random((500, 3)), rng.random((500, 3)))) for name in names]
    shown = shown_clouds(clouds, [None] * len(clouds), None, 500)
    return CaseClouds(0, "".join(names), (None, None, *names[2:]), tuple(shown))


def test_names_made_to_break_pages_are_text() -> None:
    board = made_board(EVIL, EVIL, name=EVIL[0], failing=EVIL[1], saw_test=EVIL[0], error=EVIL[1])
    page = board_page(board, [case_clouds(board)], case_command=f"pcdbench {EVIL[0]}")
    plain = board_page(made_board(["a"], ["b"]), [case_clouds(made_board(["a"], ["b"]))], case_command="c")
    elements = Elements(page)
    count = {
        kind: sum(tag == "script" for tag, _ in Elements(its).found) for kind, its in (("evil", page), ("plain", plain))
    }
    assert count["evil"] == count["plain"] == 4, "the viewer's, the clouds', the board's and the page's own"
    assert "img" not in [tag for tag, _ in elements.found]
    assert not any(name.startswith("on") for _, attributes in elements.found for name in attributes)
    assert all(name in elements.text for name in EVIL[:2])


def test_the_page_needs_nothing_from_elsewhere_and_its_policy_allows_what_is_in_it() -> None:
    board = made_board()
    page = board_page(board, [case_clouds(board)], case_command=COMMAND)
    elements = Elements(page)
    assert not {"src", "href", "srcset", "action"} & {name for _, attributes in elements.found for name in attributes}
    own = page.replace("http://www.w3.org/2000/svg", "")
    assert "://" not in own and "@import" not in own and "fetch(" not in own
    (policy,) = (its["content"] for _, its in elements.found if its.get("http-equiv") == "Content-Security-Policy")
    assert (
        policy is not None and policy.startswith("default-src 'none'; script-src 'sha256-") and "unsafe" not in policy
    )
    for kind in ("script", "style"):
        texts = re.findall(rf"<{kind}>(.*?)</{kind}>", page, re.DOTALL)
        assert len(texts) == 2
        for text in texts:
            assert base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() in policy


def test_what_is_wrong_with_numbers_is_said_in_words(board: Board) -> None:
    text = Elements(board_page(board, case_command=COMMAND)).text
    assert "Trained on scenes of this board, so to be read with care:planes: its card names hall" in text
    assert "12 failed: network on ssim: ran out of luck" in text
    assert (
        "indoor 2, split test-small: 4 scenes · offices 2, split test-small: 4 scenes · 48 cases · 3 completers" in text
    )


def test_the_same_board_gives_the_same_page(board: Board) -> None:
    assert board_page(board, case_command=COMMAND) == board_page(board, case_command=COMMAND)


def test_twenty_completers_on_three_hundred_cases_of_each_setting_are_a_page_of_a_few_megabytes() -> None:
    board = made_board(
        [f"completer {i}" for i in range(17)],
        [f"room {i}" for i in range(300)],
        levels=(0.3,),
        incompletenesses=("holes",),
    )
    page = board_page(board, case_command=COMMAND)
    content = re.search(r'<script type="application/json" id="board">(.*?)</script>', page, re.DOTALL)
    assert content is not None and len(json.loads(content[1])["completers"]) == 17 + len(REFERENCES)
    assert len(page) < 3e6


def test_clouds_are_of_one_scene_at_every_level_and_rather_of_one_on_which_nothing_failed(board: Board) -> None:
    cases = [board.cases[i] for i in shown_cases(board, 1)]
    assert len(cases) == 12 and {its.scene for its in cases} == {"office"}, "on the hall one completer failed"
    assert len({(its.data, its.incompleteness, its.level) for its in cases}) == 12
    assert len(list(shown_cases(board, 2))) == 24 and not list(shown_cases(board, 0))


@pytest.mark.skipif(shutil.which("node") is None, reason="no Node.js is installed (apt-get install nodejs)")
def test_labels_of_a_figure_lie_neither_on_one_another_nor_on_marks_nor_outside() -> None:
    marks = [(100, 290), (200, 280), (205, 268), (330, 262), (340, 285), (470, 288)]
    labels = [{"x": x + 9, "y": y + 4, "end": False, "text": "a name of some size"[:18]} for x, y in marks[:4]]
    labels += [{"x": x - 9, "y": y + 4, "end": True, "text": "at the right"} for x, y in marks[4:]]
    labels += [{"x": 482, "y": y - 4, "end": True, "text": name} for y, name in ((290, "truth"), (286, "resample"))]
    script = (resources.files("pcdbench.leaderboard") / "web" / "figures.js").read_text()
    its = [{"x": x, "y": y} for x, y in marks]
    script += f"console.log(JSON.stringify(apart({json.dumps(labels)}, {json.dumps(its)}, 26, 295)));"
    done = subprocess.run(["node", "-"], input=script, capture_output=True, text=True, check=True, timeout=60)
    told = json.loads(done.stdout)
    assert [its["text"] for its in told] == [its["text"] for its in labels]
    assert max(abs(its["y"] - wanted["y"]) for its, wanted in zip(told, labels, strict=True)) < 60
    # A letter of 12.5 pixels is about six wide; a mark is five from its middle to its border.
    widths = [6 * len(its["text"]) for its in told]
    boxes = [
        (its["x"] - width * its["end"], its["x"] + width * (not its["end"]), its["y"] - 10, its["y"] + 3)
        for its, width in zip(told, widths, strict=True)
    ]
    assert all(top >= 26 and bottom <= 295 for _, _, top, bottom in boxes)
    boxes += [(x - 5, x + 5, y - 5, y + 5) for x, y in marks]
    named = combinations(boxes[: len(told)], 2), product(boxes[: len(told)], boxes[len(told) :])
    for one, other in chain(*named):
        assert one[1] <= other[0] or other[1] <= one[0] or one[3] <= other[2] or other[3] <= one[2], (one, other)
