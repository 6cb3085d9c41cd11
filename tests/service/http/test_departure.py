"""Whoever works for a client is told when it leaves."""

from service.http.departure import Departure


def test_those_concerned_are_told_once_and_those_forgotten_never() -> None:
    told: list[str] = []
    departure = Departure()
    first, second = (lambda: told.append("first")), (lambda: told.append("second"))
    departure.tell(first)
    departure.tell(second)
    departure.forget(second)
    assert not departure.has_come
    departure.come()
    departure.come()
    assert departure.has_come
    assert told == ["first"]


def test_who_comes_late_is_told_at_once() -> None:
    told: list[str] = []
    departure = Departure()
    departure.come()
    departure.tell(lambda: told.append("late"))
    assert told == ["late"]
