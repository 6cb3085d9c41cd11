"""The cache of values asked for last: how many, and how many bytes."""

from collections import OrderedDict

from hypothesis import given
from hypothesis import strategies as st

from service.storage.caches.recent import Recent

COUNT, BYTES = 4, 100


def test_what_was_asked_for_last_stays() -> None:
    cache = Recent(2)
    for key in "ab":
        cache.put(key, key.upper())
    assert cache.get("a", lambda: "made anew") == "A"
    cache.put("c", "C")
    assert [key in cache for key in "abc"] == [True, False, True]


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 150)), max_size=60))
def test_bytes_and_numbers_are_bounded(puts: list[tuple[int, int]]) -> None:
    cache = Recent(COUNT, BYTES, int)
    model: OrderedDict[int, int] = OrderedDict()
    for key, size in puts:
        cache.put(key, size)
        model[key] = size
        model.move_to_end(key)
        while len(model) > COUNT or (len(model) > 1 and sum(model.values()) > BYTES):
            model.popitem(last=False)
        assert key in cache, "the last one stays, whatever it has"
        assert {k for k in range(10) if k in cache} == set(model)
        assert cache.weight == sum(model.values())
