"""Errors that are told with their place."""

import pytest

from kinematics.errors import ArmwrightError, InvalidGoal, InvalidOption, InvalidScene, located


def raised(error: ArmwrightError, *kinds: type[ArmwrightError], **more: object) -> ArmwrightError:
    """The error that leaves a place in which another one is raised."""
    with pytest.raises(ArmwrightError) as caught, located("here", *kinds, **more):  # type: ignore[arg-type]
        raise error
    return caught.value


def test_the_place_stands_before_the_message() -> None:
    """Kind, hint and details stay, and more details come beside them."""
    error = raised(InvalidOption("wrong", hint="Mend it.", value=1), details={"index": 2})
    assert type(error) is InvalidOption
    assert error.message == "here: wrong"
    assert error.hint == "Mend it."
    assert dict(error.details) == {"value": 1, "index": 2}


def test_another_kind_is_told_as_the_one_asked_for() -> None:
    """An error becomes one of the kind that the caller's request is about."""
    assert type(raised(InvalidScene("flat"), InvalidScene, kind=InvalidGoal)) is InvalidGoal


@pytest.mark.parametrize(
    ("error", "more"),
    [(InvalidGoal("wrong"), {}), (InvalidOption("here is wrong"), {"unless": "here"})],
)
def test_others_pass_as_they_are(error: ArmwrightError, more: dict[str, str]) -> None:
    """Errors of other kinds, and those that say their place, are not changed."""
    assert raised(error, InvalidOption, **more) is error
