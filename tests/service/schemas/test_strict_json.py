"""Strict JSON: names that occur twice, and bodies of too many fields."""

import json
import time
import tracemalloc
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.problem import ProblemError
from service.validation import MAX_FIELDS, MAX_OBJECT_FIELDS, parse_json

#: Names and texts with all that could be taken for the end of a string or of a field.
TEXT = st.text(alphabet='ab":\\{}[], \n', max_size=6)
VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats(-9.0, 9.0) | TEXT,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4),
    max_leaves=20,
)


@given(VALUES, st.sampled_from([None, 2]))
def test_what_has_no_name_twice_is_parsed(value: Any, indent: int | None) -> None:
    assert parse_json(json.dumps(value, indent=indent).encode()) == value


@given(VALUES, VALUES, TEXT)
def test_a_name_twice_is_refused_wherever_it_is(first: Any, second: Any, name: str) -> None:
    pair = f"{json.dumps(name)}: {json.dumps(first)}"
    twice = "{" + f"{pair}, {json.dumps(name)}: {json.dumps(second)}" + "}"
    for text in (twice, f"[1, [2.5, {twice}]]", f'{{"x": [[], {twice}], "y": [1]}}'):
        with pytest.raises(ProblemError) as refused:
            parse_json(text.encode())
        assert repr(name) in refused.value.detail or "twice" in refused.value.detail
        assert refused.value.code == "VALIDATION_ERROR"


def test_the_number_of_fields_is_bounded_before_anything_is_parsed() -> None:
    fields = {f"field_{i}": i for i in range(MAX_FIELDS + 1)}
    content = json.dumps(fields).encode()
    began = time.perf_counter()
    with pytest.raises(ProblemError, match=f"the body has more than {MAX_FIELDS} fields"):
        parse_json(content)
    assert time.perf_counter() - began < 0.1


def test_colons_in_texts_are_no_fields() -> None:
    text = '\\": ' * (MAX_FIELDS + 1)
    assert parse_json(json.dumps({"moveit": text}).encode()) == {"moveit": text}


def test_nothing_stays_of_what_was_parsed() -> None:
    parse_json(b'{"name": "arm"}')
    tracemalloc.start()
    try:
        for number in range(5000):
            parse_json(b'{"name": "a robot that is named once: %d"}' % number)
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 50_000


def test_the_fields_of_one_object_are_bounded_exactly() -> None:
    fields = {str(i): i for i in range(MAX_OBJECT_FIELDS)}
    assert parse_json(json.dumps([fields]).encode()) == [fields]
    with pytest.raises(ProblemError, match=f"an object has more than {MAX_OBJECT_FIELDS}"):
        parse_json(json.dumps([fields | {"x": 0}]).encode())
