"""Options are checked before anything runs, and an error names the option and its cure."""

from typing import Annotated, Literal, Self

import pytest
from pydantic import Field, model_validator

from pcdbench.errors import PcdbenchError, PluginError
from pcdbench.options import Options
from pcdbench.plugins import registry
from pcdbench.runner.selection import _recorded, checked_options, option_targets, parse_options, select

pytestmark = pytest.mark.usefixtures("tiny_plugins")


def test_options_by_plugin_and_key():
    assert parse_options(["a.x=1", "a.y=b=c", "a.x=1"]) == {"a": {"x": "1", "y": "b=c"}}


def test_an_option_with_two_values_is_refused():
    with pytest.raises(PcdbenchError, match=r"--option a\.x is given twice, as 1 and as 2; give one"):
        parse_options(["a.x=1", "a.y=2", "a.x=2"])


@pytest.mark.parametrize("text", ["a", "a.x", "a=1", ".x=1", "a.=1"])
def test_options_of_another_shape_are_errors(text):
    with pytest.raises(PcdbenchError, match=r"NAME\.KEY=VALUE"):
        parse_options([text])


def test_all_options_are_resolved_from_text():
    plugin = select("completer", "tiny_fill", {"points": "7"})
    assert plugin.options == {"points": 7, "seconds": 0.0}
    assert plugin.build().options.points == 7


def test_unknown_option_names_the_closest():
    with pytest.raises(PcdbenchError, match=r"tiny_fill has no option 'point'; did you mean points\?"):
        select("completer", "tiny_fill", {"point": "7"})


def test_option_of_a_plugin_without_any():
    with pytest.raises(PcdbenchError, match="tiny_gap has no option 'x'; it has no options"):
        select("task", "tiny_gap", {"x": "7"})


@pytest.mark.parametrize("value", ["many", "-1"])
def test_bad_value_names_option_and_value(value):
    with pytest.raises(PcdbenchError, match=rf"--option tiny_fill\.points={value}: input should be"):
        select("completer", "tiny_fill", {"points": value})


def test_option_for_what_is_not_in_the_run():
    with pytest.raises(PcdbenchError, match="'tiny_fil' is not in this run; did you mean tiny_fill"):
        option_targets({"tiny_fil": {"points": "1"}}, {"completer": ["tiny_fill"], "task": ["tiny_gap"]})


def test_what_cannot_be_imported_names_its_error():
    with pytest.raises(PluginError, match=r"tiny_missing.*No module named"):
        select("completer", "tiny_missing", {})


def test_identity_follows_options_and_not_the_path():
    plain = select("dataset", "tiny", {})
    assert select("dataset", "tiny", {}, path="elsewhere").identity == plain.identity
    assert select("dataset", "tiny", {"points": "10"}).identity != plain.identity


class Sets(Options):
    names: frozenset[str] = frozenset(f"name{number}" for number in range(20))
    nested: dict[str, list[set[int]]] = Field({"a": [{9, 1, 100}, {-1}]})
    plain: tuple[int, ...] = (3, 1, 2)


def test_sets_are_recorded_in_one_order_whatever_theirs_is_in_this_process():
    recorded = _recorded("completer 'it'", Sets())
    assert recorded["names"] == sorted(recorded["names"]) and len(recorded["names"]) == 20
    assert recorded["nested"] == {"a": [[1, 100, 9], [-1]]} and recorded["plain"] == [3, 1, 2]
    assert Sets.model_validate(recorded) == Sets()


class Various(Options):
    pair: tuple[int, int] = (1, 2)
    many: list[float] = Field([1.0])
    limit: float | None = 3.0
    few: tuple[str, ...] | None = None
    on: bool = False
    some: Annotated[list[int], Field(min_length=2)] | None = None
    side: Literal[4, 8, "all"] = 4
    edge: Literal[1, 2] | None = None


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("pair", "3,4", (3, 4)),
        ("pair", "(3, 4)", (3, 4)),
        ("many", "0.5", [0.5]),
        ("many", "[1,2]", [1.0, 2.0]),
        ("many", "", []),
        ("limit", "None", None),
        ("limit", "0.5", 0.5),
        ("few", "a,b", ("a", "b")),
        ("some", "1,2", [1, 2]),
        ("some", "None", None),
        ("on", "true", True),
        ("side", "8", 8),
        ("side", "all", "all"),
        ("edge", "2", 2),
        ("edge", "None", None),
    ],
)
def test_sequences_and_none_are_typed_as_show_prints_them(key, text, value):
    assert getattr(checked_options("various", Various, {key: text}), key) == value


@pytest.mark.parametrize(
    ("key", "text"), [("pair", "3"), ("pair", "3,x"), ("many", "1,,x"), ("on", "maybe"), ("side", "16")]
)
def test_bad_members_of_sequences_name_the_option_and_all_of_its_text(key, text):
    with pytest.raises(PcdbenchError, match=rf"--option various\.{key}={text}: "):
        checked_options("various", Various, {key: text})


def test_too_few_values_are_told_as_that():
    with pytest.raises(PcdbenchError, match=r"--option various\.pair=3: value 2 is missing \(see"):
        checked_options("various", Various, {"pair": "3"})


@pytest.mark.parametrize(("key", "text"), [("limit", "inf"), ("limit", "nan"), ("limit", "-inf"), ("many", "1,inf")])
def test_numbers_that_are_not_finite_are_refused(key, text):
    with pytest.raises(PcdbenchError, match=rf"--option various\.{key}={text}: input should be a finite number"):
        checked_options("various", Various, {key: text})


def test_a_default_that_json_cannot_say_is_the_plugins_fault(monkeypatch):
    class Endless(Options):
        reach_m: float = float("inf")

    cls = registry().get("completer", "tiny_fill").load()
    monkeypatch.setattr(cls, "Options", Endless)
    with pytest.raises(PluginError, match="the options of tiny_fill cannot be recorded as JSON"):
        select("completer", "tiny_fill", {})


def test_a_data_set_that_is_generated_lies_nowhere():
    with pytest.raises(PcdbenchError, match=r"^data set 'indoor' takes no path; leave out :/does/not/exist$"):
        select("dataset", "indoor", {}, path="/does/not/exist")


class Required(Options):
    reach_m: float


def test_an_option_without_default_that_is_not_given_is_asked_for():
    with pytest.raises(PcdbenchError, match=r"^strict needs --option strict\.reach_m=VALUE: it has no default"):
        checked_options("strict", Required, {})


def test_option_of_a_plugin_that_is_installed_but_not_in_the_run():
    with pytest.raises(PcdbenchError, match="'tiny_fill' is not in this run; name it there too, or leave its options"):
        option_targets({"tiny_fill": {"points": "1"}}, {"completer": ["tiny_colorful"], "task": ["tiny_gap"]})


def test_what_a_plugin_says_of_its_options_together_names_the_plugin_and_no_option():
    class Together(Options):
        weights: str = ""

        @model_validator(mode="after")
        def _weights_are_used(self) -> Self:
            raise ValueError("Weights are not used; leave them out")

    with pytest.raises(
        PcdbenchError, match=r"^joined: weights are not used; leave them out \(see pcdbench show joined"
    ):
        checked_options("joined", Together, {"weights": "x"})
