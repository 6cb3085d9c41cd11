"""Types of kernels as text, made from that text again; settings of a compilation."""

from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import types
from numba.core import compiler

from compiled.compiler.dispatcher import Flags
from compiled.compiler.signature import named_tuples, type_of_text, type_text
from compiled.simd import TYPES


class Inner(NamedTuple):
    values: Any
    count: Any


class Outer(NamedTuple):
    inner: Any
    more: Any


SCALARS = [types.float64, types.int64, types.boolean, types.uint64, types.complex128, types.none]
NUMBERS = st.sampled_from([types.float64, types.int32, types.boolean])
ARRAYS = st.builds(types.Array, NUMBERS, st.integers(2, 4), st.sampled_from("CFA"), st.booleans())
FLAT = st.builds(types.Array, NUMBERS, st.just(1), st.sampled_from("CA"), st.booleans())


def pair(kinds: list[Any]) -> Any:
    return types.BaseTuple.from_types(kinds, Inner)


def may_be_missing(kind: Any) -> bool:
    return not isinstance(kind, types.NoneType | types.Optional)


KINDS = st.recursive(
    st.sampled_from([*SCALARS, *TYPES.values()]) | ARRAYS | FLAT,
    lambda inner: (
        st.lists(inner, max_size=3).map(types.BaseTuple.from_types)
        | st.lists(inner, min_size=2, max_size=2).map(pair)
        | inner.filter(may_be_missing).map(types.Optional)
    ),
    max_leaves=6,
)


@given(KINDS)
def test_text_gives_the_type_it_was_made_from(kind: Any) -> None:
    assert type_of_text(type_text(kind)) == kind


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (types.Array(types.float64, 2, "C"), "float64[:, ::1]"),
        (types.Array(types.float64, 2, "F"), "float64[::1, :]"),
        (types.Array(types.int64, 1, "A"), "int64[:]"),
        (types.Array(types.int64, 1, "C", readonly=True), "const(int64[::1])"),
        (types.BaseTuple.from_types([types.int64]), "(int64,)"),
        (types.BaseTuple.from_types([types.int64] * 2), "(int64, int64)"),
        (types.Optional(types.int64), "optional(int64)"),
        (TYPES["vector"], "vector"),
    ],
)
def test_text_is_numbas_notation(kind: Any, text: str) -> None:
    assert type_text(kind) == text
    assert type_of_text(text) == kind


def test_named_tuples_inside_of_others_come_first_and_may_have_short_names() -> None:
    inner = types.BaseTuple.from_types([types.float64, types.int64], Inner)
    outer = types.BaseTuple.from_types([inner, inner], Outer)
    assert named_tuples([types.int64, outer]) == [inner, outer]
    text = type_text(outer, {inner: "Short"})
    assert text == f"{__name__}.Outer(Short, Short)"
    assert type_of_text(text, {"Short": inner}) == outer


@pytest.mark.parametrize(
    "kind",
    [
        types.List(types.int64),
        types.Array(types.float64, 1, "C", aligned=False),
        types.Array(types.float64, 0, "C"),
    ],
)
def test_types_without_a_notation_are_refused(kind: Any) -> None:
    with pytest.raises(ValueError, match="no text"):
        type_text(kind)


@pytest.mark.parametrize(
    "text", ["float65", "float64[", "1 + 2", "nowhere.at_all.Pair(int64, int64)", "'int64'"]
)
def test_text_of_no_type_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="unknown type"):
        type_of_text(text)


@pytest.mark.parametrize("given_types", ["int64", "int64, int64, int64"])
def test_a_named_tuple_of_another_number_of_fields_is_refused(given_types: str) -> None:
    with pytest.raises(ValueError, match="2 fields"):
        type_of_text(f"{Inner.__module__}.Inner({given_types})")


def test_flags_are_equal_where_numbas_are() -> None:
    ours, other = Flags(), Flags()
    assert ours == other
    ours.nrt = True
    assert ours != other
    other.nrt = True
    assert ours == other
    ours.discard("nrt")
    assert ours != other
    del other.nrt
    assert ours == other
    ours.release_gil = False  # as it is where nothing is set
    assert ours == other


def test_numbas_flags_find_ours_in_a_table() -> None:
    ours, theirs = Flags(), compiler.Flags()
    ours.nrt = theirs.nrt = True
    assert {theirs: 1}[ours] == 1
    assert ours == theirs
    theirs.forceinline = True
    assert ours != theirs


def test_copies_change_by_themselves() -> None:
    ours = Flags()
    assert ours == Flags()  # compared, and so remembered
    copy = ours.copy()
    copy.nrt = True
    assert copy != ours
    assert isinstance(copy, Flags)
