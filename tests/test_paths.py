"""Names of scenes, figures and plugins as names of files."""

import string
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from pcdbench.paths import file_name

NASTY = (
    "../../x", "/etc/passwd", "..", ".", "", "a\0b", "C:\\x", "NUL", "con.txt", "a/b", "-rf", ".hidden", "x" * 5000,
    "<img src=x onerror=alert(1)>", "\ud800", "küche", "a\nb",
)  # fmt: skip


@settings(deadline=None)
@given(st.one_of(st.text(), st.sampled_from(NASTY)))
def test_a_name_is_one_part_of_a_path_that_every_system_takes(text: str) -> None:
    name = file_name(text)
    assert name and set(name) <= {*string.ascii_letters, *string.digits, *"._-"} and len(name) <= 120
    assert Path("folder", name).resolve().parent == Path("folder").resolve()
    assert not name.startswith(".") and not name.endswith(".")
    assert name.partition(".")[0].upper() not in {"CON", "PRN", "AUX", "NUL", "COM1", "LPT9"}
    assert file_name(name) == name


@settings(deadline=None)
@given(st.text(), st.text())
def test_different_texts_have_different_names(one: str, other: str) -> None:
    assert (file_name(one) == file_name(other)) == (one == other) or file_name(one) == other or file_name(other) == one


def test_usual_names_stay() -> None:
    for name in ("room_0001", "office-b.room08", "copyroom_1"):
        assert file_name(name) == name
    assert file_name("../../x") == "_.._x-" + file_name("../../x")[-8:]
