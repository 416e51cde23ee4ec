"""Options are checked before anything runs, and an error names the option and its cure."""

import pytest

from pcdbench.errors import PcdbenchError, PluginError
from pcdbench.runner.selection import option_targets, parse_options, select

pytestmark = pytest.mark.usefixtures("tiny_plugins")


def test_options_by_plugin_and_key():
    assert parse_options(["a.x=1", "a.y=b=c", "a.x=2"]) == {"a": {"x": "2", "y": "b=c"}}


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
