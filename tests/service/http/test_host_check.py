"""Host allow-list: which names a request may be sent to."""

import pytest

from service.http.host_check import allowed_host

NONE: frozenset[str] = frozenset()


@pytest.mark.parametrize(
    "header",
    ["127.0.0.1", "127.0.0.1:8000", "localhost", "LOCALHOST:80", "armwright", "[::1]", "[::1]:8000",
     "10.1.2.3:8000", "192.168.0.7"],
)  # fmt: skip
def test_addresses_and_names_without_a_dot_are_allowed(header: str) -> None:
    assert allowed_host(header, NONE)


@pytest.mark.parametrize(
    "header",
    ["evil.example", "evil.example:8000", "EVIL.example.", "127.0.0.1.evil.example", "1.2.3.4.5",
     "localhost.evil.example", "a b", "", "x/y", "evil.example@localhost", "[::1", "x:y", "x:",
     "[evil.example]", "x,localhost"],
)  # fmt: skip
def test_other_names_are_not(header: str) -> None:
    assert not allowed_host(header, NONE)
    assert not allowed_host(header, frozenset({"arm.example", ".arms.example"}))


def test_names_on_the_list_are_allowed() -> None:
    names = frozenset({"arm.example", ".arms.example"})
    for header in ("arm.example", "ARM.example:443", "arm.example.", "a.arms.example"):
        assert allowed_host(header, names)
    for header in ("sub.arm.example", "armsx.example", "arms.example", "xarms.example"):
        assert not allowed_host(header, names)
    assert allowed_host("anything.example", frozenset({"*"}))
    assert not allowed_host("no host", frozenset({"*"}))
