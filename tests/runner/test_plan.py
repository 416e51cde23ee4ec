"""The cells of a run, their seeds and their keys."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from pcdbench.errors import PcdbenchError, PluginError
from pcdbench.plugins import registry
from pcdbench.runner.plan import Request, plan

pytestmark = pytest.mark.usefixtures("tiny_plugins")
TINY = Request(["tiny_fill"], ["tiny_gap"], dataset="tiny", incompletenesses=["slab"])


def test_references_are_added_and_cells_counted():
    planned = plan(TINY)
    assert [its.name for its in planned.completers] == ["ground_truth", "incomplete", "resample", "tiny_fill"]
    assert [its.reference for its in planned.completers] == [True, True, True, False]
    assert len(planned.cells) == 3 * 3 * 4
    assert len({cell.key for cell in planned.cells}) == 3 * 3 * 4


def test_all_completers_without_references_are_those_that_are_none():
    assert not any(its.reference for its in plan(replace(TINY, completers=["all"], references=False)).completers)
    named = plan(replace(TINY, completers=["all", "incomplete"], references=False)).completers
    assert [its.name for its in named if its.reference] == ["incomplete"]


def test_seed_of_a_case_is_that_of_its_draw():
    cells = plan(replace(TINY, incompletenesses=["slab", "holes"])).cells
    seeds = {
        (cell.scene, cell.incompleteness.name): {c.seed for c in cells if _draw(c) == _draw(cell)} for cell in cells
    }
    assert all(len(found) == 1 for found in seeds.values())
    assert len({seed for found in seeds.values() for seed in found}) == 3 * 2


def _draw(cell):
    return cell.scene, cell.incompleteness.name, cell.draw


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"levels": [0.2]},
        {"options": ["tiny_fill.points=3"]},
        {"options": ["tiny.points=200"]},
        {"incompletenesses": ["holes"]},
    ],
)
def test_what_decides_an_outcome_is_in_the_key(change):
    request = replace(TINY, completers=["tiny_fill"], levels=[0.1], references=False)
    before = {cell.key for cell in plan(request).cells}
    after = {cell.key for cell in plan(replace(request, **change)).cells}
    assert len(after) == len(before) and not before & after


def test_weights_version_and_scene_are_in_the_key():
    cell = plan(TINY).cells[-1]
    assert replace(cell, completer=replace(cell.completer, weights="abc")).key != cell.key
    assert replace(cell, completer=replace(cell.completer, version="2")).key != cell.key
    assert replace(cell, scene_digest="another").key != cell.key


def test_keys_do_not_depend_on_what_else_is_in_the_run():
    alone = {cell.key for cell in plan(replace(TINY, references=False, levels=[0.3])).cells}
    assert alone < {cell.key for cell in plan(replace(TINY, completers=["all"])).cells}


def test_row_key_follows_the_task_and_its_options():
    request = replace(TINY, tasks=["tiny_gap", "tiny_wrong"])
    cell, (gap, wrong) = plan(request).cells[0], plan(request).tasks
    other = plan(replace(request, options=["tiny_wrong.how=text"])).tasks[1]
    assert len({cell.row_key(task) for task in (gap, wrong, other)}) == 3


def test_folder_is_the_same_for_the_same_command_only():
    assert plan(TINY).folder_name == plan(TINY).folder_name
    assert plan(TINY).folder_name.startswith("tiny-few-")
    assert plan(replace(TINY, seed=1)).folder_name != plan(TINY).folder_name


def test_levels_are_taken_once_and_in_order():
    assert plan(replace(TINY, levels=[0.5, 0.1, 0.5])).levels == (0.1, 0.5)


def test_changed_code_is_another_run_of_the_same_cells():
    planned = plan(TINY)
    *others, last = planned.completers
    changed = replace(planned, completers=(*others, replace(last, code="changed")))
    assert changed.folder_name != planned.folder_name
    assert [cell.key for cell in changed.cells] == [cell.key for cell in planned.cells]


def test_all_leaves_out_what_cannot_be_loaded_with_its_reason():
    planned = plan(replace(TINY, completers=["all"]))
    assert "No module named" in planned.left_out["tiny_missing"]
    assert "tiny_fill" in {its.name for its in planned.completers}


def test_all_says_what_clashes_and_which_plugin_is_broken(monkeypatch):
    found = registry()
    monkeypatch.setitem(found.broken, "broken 1.0 (a = b)", "RuntimeError: a bug")
    found.add(replace(found.get("completer", "tiny_fill"), origin="another 1.0"))
    assert not plan(replace(TINY, completers=["incomplete"])).left_out
    planned = plan(replace(TINY, completers=["all"]))
    assert planned.left_out["broken 1.0 (a = b)"] == "RuntimeError: a bug"
    assert "is registered by" in planned.left_out["tiny_fill"] and "another 1.0" in planned.left_out["tiny_fill"]


def test_a_completer_that_ends_the_process_when_it_is_built_cannot_be_used(monkeypatch):
    cls = registry().get("completer", "tiny_fill").load()
    monkeypatch.setattr(cls, "weights_digest", lambda self: sys.exit("no weights"))
    with pytest.raises(PluginError, match=r"^completer 'tiny_fill' cannot say .*: SystemExit: no weights$"):
        plan(TINY)


def test_asked_for_by_name_it_is_an_error():
    with pytest.raises(PluginError, match="tiny_missing"):
        plan(replace(TINY, completers=["tiny_fill", "tiny_missing"]))


@pytest.mark.parametrize("method", ["__init__", "splits", "scene_names", "draws"])
def test_whatever_a_data_set_raises_is_one_line(monkeypatch, method):
    def cannot(self, *arguments):
        raise FileNotFoundError("index.json\nis not there")

    monkeypatch.setattr(registry().get("dataset", "tiny").load(), method, cannot)
    told = "data set 'tiny' cannot be used: FileNotFoundError: index.json is not there"
    with pytest.raises(PluginError) as caught:
        plan(TINY)
    assert str(caught.value) == f"{told} (--dataset tiny:PATH says where it lies)"
    with pytest.raises(PluginError) as caught:
        plan(replace(TINY, dataset="tiny:there"))
    assert str(caught.value) == told


@pytest.mark.parametrize(
    ("method", "value", "message"),
    [
        ("digest", b"0", r"digest\(\) must give a text that is not empty, not b'0'"),
        ("digest", "", r"digest\(\) must give a text that is not empty, not ''"),
        ("environment", None, r"environment\(\) must give a text that is not empty, not None"),
        ("scene_names", [Path("a.ply")], r"scene_names\(\) must give a text that is not empty, not PosixPath"),
        ("draws", 0, r"draws\(\) must return a whole number from 1 on, not 0"),
        ("draws", 2.0, r"draws\(\) must return a whole number from 1 on, not 2.0"),
    ],
)
def test_what_a_data_set_says_is_checked_before_anything_runs(monkeypatch, method, value, message):
    monkeypatch.setattr(registry().get("dataset", "tiny").load(), method, lambda self, *_: value)
    with pytest.raises(PluginError, match=f"^data set 'tiny': {message}"):
        plan(TINY)


def learned(monkeypatch, card, weights="0" * 64):
    """Has tiny_fill tell this of its weights."""
    cls = registry().get("completer", "tiny_fill").load()
    monkeypatch.setattr(cls, "model_card", lambda self: card)
    monkeypatch.setattr(cls, "weights_digest", lambda self: weights)


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ([("dataset", "tiny")], "must return a mapping or None, not list"),
        ({"made_by": object()}, "must hold JSON values alone"),
        ({"loss": float("nan")}, "must hold JSON values alone"),
        ({"trained_on": "tiny"}, r"another trained_on \(trained_on: input should be a valid list"),
        ({"trained_on": [{"split": "few"}]}, r"another trained_on \(trained_on\.0\.dataset: field required"),
        ({"trained_on": [{"dataset": "indoor", "split": "smokee"}]}, "which indoor does not have; did you mean smoke"),
    ],
)
def test_a_model_card_that_boards_could_not_read_is_refused(monkeypatch, card, message):
    learned(monkeypatch, card)
    with pytest.raises(PluginError, match=rf"^completer 'tiny_fill': model_card\(\) .*{message}") as caught:
        plan(TINY)
    assert "\n" not in str(caught.value)
    assert "model_card" in plan(replace(TINY, completers=["all"])).left_out["tiny_fill"]


@pytest.mark.parametrize(
    "seen",
    [
        {"dataset": "tiny", "split": "few"},
        # What splits a data set has may lie with its files, which may not be here.
        {"dataset": "tiny", "split": "elsewhere"},
        {"dataset": "tiny"},
        {"dataset": "s3dis", "split": "area_1"},
        {"dataset": "x"},
    ],
)
def test_a_model_card_goes_into_the_configuration(monkeypatch, seen):
    learned(monkeypatch, {"trained_on": [seen]})
    assert plan(TINY).configuration["completers"][-1]["card"] == {"trained_on": [seen]}


def test_a_digest_that_is_no_text_is_refused(monkeypatch):
    learned(monkeypatch, None, weights=b"0")
    with pytest.raises(PluginError, match=r"weights_digest\(\) must return a text or None, not bytes"):
        plan(TINY)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"completers": ["tiny_fil"]}, "did you mean tiny_fill"),
        ({"completers": ["all", "tiny_fil"]}, "did you mean tiny_fill"),
        ({"tasks": ["chamfr"]}, "did you mean chamfer"),
        ({"dataset": "tin"}, "did you mean tiny"),
        ({"incompletenesses": ["hole"]}, "did you mean holes"),
        ({"split": "fwe"}, "no split 'fwe'; did you mean few"),
        ({"split": "none"}, "has no scenes"),
        ({"levels": [0.1, 1.0]}, "--level 1 must lie between 0 and 1"),
        ({"levels": [float("nan")]}, "--level nan must lie"),
        ({"levels": []}, "no --level"),
        ({"tasks": []}, "no task is named"),
        ({"options": ["tiny_color.x=1"]}, "'tiny_color' is not in this run"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(change, message):
    with pytest.raises(PcdbenchError, match=message) as caught:
        plan(replace(TINY, **change))
    assert "\n" not in str(caught.value)
