"""Settings of a compilation: compared by the values of all options, set or left out."""

from numba.core import compiler

from compiled.compiler.dispatcher import Flags


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
