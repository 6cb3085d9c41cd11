"""Tasks: the functions that workers may be asked to call, and jobs, the calls."""

import importlib
import math
import pickle
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Generic, ParamSpec, TypeVar, overload

from planning.values.deadline import Deadline

#: Grace of tasks that mind their deadline themselves [s]: enough to tell what was tried, on a busy
#: machine too, and too little for a client to notice.
GRACE = 0.3
#: The deadline of a job that may take any time.
NEVER = Deadline(math.inf)

P = ParamSpec("P")
R = TypeVar("R")
R_co = TypeVar("R_co", covariant=True)


@dataclass(frozen=True, slots=True)
class Job(Generic[R_co]):
    """One call of a task, made by `Task.job`.

    Args:
        task: The name of the task.
        args: Positional arguments, picklable.
        kwargs: Named arguments, picklable.
        deadline: Deadline of the result; the task reads it by `current.deadline`.
        grace: How much later the worker is ended [s].
    """

    task: str
    args: tuple[Any, ...] = ()
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    deadline: Deadline = NEVER
    grace: float = 0.0

    @property
    def size(self) -> int:
        """Size of what the call is about [byte]."""
        return sum([len(value) for value in self.args if isinstance(value, bytes)])

    def with_deadline(self, deadline: Deadline) -> "Job[R_co]":
        """Job with another deadline."""
        return replace(self, deadline=deadline)


def pack_job(job: Job[Any]) -> bytes:
    """The call of a job as it is sent to a worker, which is told the deadline apart."""
    return pickle.dumps((job.task, job.args, dict(job.kwargs)), pickle.HIGHEST_PROTOCOL)


def unpack_job(content: bytes | memoryview) -> Job[Any]:
    """The job of a call that was sent."""
    return Job(*pickle.loads(content))


@dataclass(frozen=True, slots=True)
class TaskReference(Generic[P, R_co]):
    """The name of a task, for processes that only ask others to call it.

    Args:
        name: ``"module:function"``, unique.
        grace: How much later than its deadline the worker is ended [s].
    """

    name: str
    grace: float = 0.0

    def job(self, *args: P.args, **kwargs: P.kwargs) -> Job[R_co]:
        """A call of the task in a worker."""
        return Job(self.name, args, kwargs, grace=self.grace)


@dataclass(frozen=True, slots=True)
class Task(Generic[P, R_co]):
    """A function that workers may be asked to call; called directly, it is the function itself.

    Args:
        name: ``"module:function"``, unique.
        function: The function.
        grace: How much later than its deadline the worker is ended [s].
    """

    name: str
    function: Callable[P, R_co]
    grace: float = 0.0

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R_co:
        """Call the function in this process."""
        return self.function(*args, **kwargs)

    def job(self, *args: P.args, **kwargs: P.kwargs) -> Job[R_co]:
        """A call of the function in a worker."""
        return Job(self.name, args, kwargs, grace=self.grace)


_TASKS: dict[str, Task[Any, Any]] = {}


@overload
def task(function: Callable[P, R], /) -> Task[P, R]: ...
@overload
def task(*, grace: float) -> Callable[[Callable[P, R]], Task[P, R]]: ...
def task(
    function: Callable[P, R] | None = None, /, *, grace: float = 0.0
) -> Task[P, R] | Callable[[Callable[P, R]], Task[P, R]]:
    """Register a function as a task.

    Args:
        function: The function, when used without parentheses.
        grace: How much later than its deadline the worker is ended [s], for a function that minds
            the deadline itself.

    Raises:
        ValueError: Another function is registered under its name.
    """

    def decorate(body: Callable[P, R]) -> Task[P, R]:
        return register(Task(f"{body.__module__}:{body.__qualname__}", body, grace))

    return decorate if function is None else decorate(function)


def register(new: Task[P, R]) -> Task[P, R]:
    """Add a task to those that workers may be asked to call.

    Raises:
        ValueError: Another function is registered under its name.
    """
    if new.name in _TASKS:
        raise ValueError(f"there already is a task {new.name!r}")
    _TASKS[new.name] = new
    return new


def registered_task(name: str) -> Task[..., Any]:
    """The task of a name. Nothing is imported for it, so that a name alone can't run anything.

    Raises:
        LookupError: No such task is registered.
    """
    try:
        return _TASKS[name]
    except KeyError:
        raise LookupError(f"{name!r} is not a registered task") from None


def task_names(module: str) -> frozenset[str]:
    """The names of the tasks that a package or module has registered."""
    return frozenset(
        name for name in _TASKS if f"{name.partition(':')[0]}.".startswith(f"{module}.")
    )


def load_tasks(module: str) -> None:
    """Import a module, or all modules of a package, so that their tasks are registered."""
    loaded = importlib.import_module(module)
    for inner in pkgutil.iter_modules(getattr(loaded, "__path__", [])):
        importlib.import_module(f"{module}.{inner.name}")
