"""What tasks that answer requests have in common."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from service.storage.cache_key import NotPrepared
from service.tasks.result import CacheMiss

_P = ParamSpec("_P")
_T = TypeVar("_T")


def answering(task: Callable[_P, _T]) -> Callable[_P, _T | CacheMiss]:
    """A task that answers `Absent` where a robot or scene it was to load is not prepared."""

    @wraps(task)
    def attempted(*args: _P.args, **kwargs: _P.kwargs) -> _T | CacheMiss:
        try:
            return task(*args, **kwargs)
        except NotPrepared as error:
            return CacheMiss(error.reference)

    return attempted
