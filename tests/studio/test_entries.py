"""Lists of entries, and the texts by which their fields are edited."""

import pytest

from studio.page.entries_panel import describe, labels_of, number_in, text_of, value_of
from studio.settings_form import EntryForms, FormField
from studio.state import moved, with_field, without

FORMS = EntryForms("kind", {"a": (), "b": (), "c": ()})
ENTRIES = ({"kind": "a"}, {"kind": "b"}, {"kind": "c", "x": [1.0, 2.0]})


def kinds(entries: tuple[object, ...]) -> str:
    return "".join(item["kind"] for item in entries)  # type: ignore[index]


def test_entries_are_moved_as_far_as_there_is_room() -> None:
    assert kinds(moved(ENTRIES, 0, 1)) == "bac"
    assert kinds(moved(ENTRIES, 2, -1)) == "acb"
    assert kinds(moved(ENTRIES, 2, 1)) == "abc"
    assert kinds(moved(ENTRIES, 0, -1)) == "abc"
    assert kinds(without(ENTRIES, 1)) == "ac"


def test_fields_are_set_and_left_out() -> None:
    changed = with_field(ENTRIES, 0, "x", 3)
    assert changed[0] == {"kind": "a", "x": 3}
    assert with_field(changed, 0, "x", None) == ENTRIES


def test_a_choice_names_its_entry() -> None:
    labels = labels_of(ENTRIES, FORMS)
    assert [number_in(label) for label in labels] == [None, 0, 1, 2]
    assert labels[1:] == ["0 a", "1 b", "2 c"]


def test_entries_are_described() -> None:
    assert describe(ENTRIES, FORMS).splitlines()[2] == "2. **c** x=[1.0, 2.0]"


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        ("json", "[1.0, 2.0]", [1.0, 2.0]),
        ("number", "0.5", 0.5),
        ("integer", "3", 3),
        ("flag", "yes", True),
        ("choice", "tool", "tool"),
        ("text", "first", "first"),
    ],
)
def test_texts_and_values_are_the_same(kind: str, text: str, value: object) -> None:
    field = FormField("x", kind, "", None, ("tool", "root") if kind == "choice" else ())
    assert value_of(field, text) == value
    assert text_of(field, {"x": value}) == text
    assert value_of(field, text_of(field, {})) is None


def test_a_text_that_is_no_value_says_what_is() -> None:
    with pytest.raises(ValueError, match="x: 'one' is not a number"):
        value_of(FormField("x", "number", "", None), "one")
    with pytest.raises(ValueError, match="is not JSON"):
        value_of(FormField("x", "json", "", None), "[1")
