"""Questions to the service whose refusals are results, too."""

from collections.abc import Callable

from pydantic import ValidationError

from armwright_client import ApiError, ArmwrightError
from studio.result import Failure, Outcome, failure
from studio.state import StudioState


def attempt(state: StudioState, action: Callable[[], Outcome]) -> Outcome:
    """The result of a question, or why there is none.

    Args:
        state: State that is asked about.
        action: Asks.
    """
    try:
        return action()
    except ApiError as error:
        return failure(state, error.problem)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(step) for step in first["loc"])
        return Failure(state, "A setting is out of its range", f"{where}: {first['msg']}")
    except ValueError as error:
        return Failure(state, "Something is missing", str(error))
    except ArmwrightError as error:
        return Failure(state, "The service did not answer", str(error))
