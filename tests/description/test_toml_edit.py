"""Keys set in a file that people wrote."""

import tomllib
from pathlib import Path

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.toml_edit import set_keys

PATH = Path("rig.toml")
TEXT = """# head
[first]
a = 1   # one

[sensor]            # where it is
below = 45.0        # mm # and more
name = "a # b"      # text
axes = [
  "x",  # first
  "y",
]
# last words

[[many]]
a = 2
"""


def test_a_key_is_changed_where_it_stands_and_its_comment_stays():
    edited = set_keys(TEXT, "sensor", {"below": 50.0}, PATH)
    assert edited == TEXT.replace("below = 45.0 ", "below = 50.0 ")


def test_a_sign_of_a_comment_within_a_text_is_none():
    edited = set_keys(TEXT, "sensor", {"name": "c"}, PATH)
    assert edited == TEXT.replace('"a # b"', '"c"')


def test_a_new_key_comes_behind_the_last_one_of_its_table():
    edited = set_keys(TEXT, "sensor", {"checked": {"date": "today", "N": 9.81}}, PATH)
    line = 'checked = { date = "today", N = 9.81 }\n'
    assert edited == TEXT.replace("]\n# last", f"]\n{line}# last")


def test_a_list_over_several_lines_is_replaced_as_a_whole():
    edited = set_keys(TEXT, "sensor", {"axes": ["-y", "x"], "new": True}, PATH)
    assert tomllib.loads(edited)["sensor"]["axes"] == ["-y", "x"]
    assert 'axes = ["-y", "x"]\nnew = true\n# last words\n' in edited


def test_line_ends_of_windows_stay():
    edited = set_keys(TEXT.replace("\n", "\r\n"), "sensor", {"below": 50.0, "new": 1}, PATH)
    assert edited.replace("\r\n", "").count("\n") == 0
    assert edited.endswith("a = 2\r\n")


def test_a_table_at_the_end_without_a_line_end():
    assert set_keys("[sensor]\na = 1", "sensor", {"b": 2}, PATH) == "[sensor]\na = 1\nb = 2\n"
    assert set_keys("[sensor]", "sensor", {"b": 2}, PATH) == "[sensor]\nb = 2\n"


@pytest.mark.parametrize(
    "text",
    [
        "sensor = { a = 1 }\n",
        "sensor.a = 1\n",
        "[sensor]\na = 1\n[sensor.checked]\nb = 2\n",
        "[sensor]\nchecked.b = 2\nchecked.d = 4\n",
    ],
)
def test_what_is_written_in_another_way_is_left_to_the_person(text):
    with pytest.raises(BadInput, match=r"^rig\.toml: .* by hand: checked = \{ c = 3 \}$"):
        set_keys(text, "sensor", {"checked": {"c": 3}}, PATH)
