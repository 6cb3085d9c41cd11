"""Problems planned under a lie, and what the certificate made of each motion it was handed."""

import functools
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from kinematics.trajectory.trajectory import Trajectory
from planning.pipeline.pipeline import plan
from planning.proof.certificate import Certificate, certify
from planning.result import Plan
from tests.planning.proof.sabotage.cases import Case, case
from tests.planning.proof.sabotage.judge import faults

#: Packages in which a lie is told to everyone who knows the verdict by its name.
_PACKAGES = ("compiled", "kinematics", "dynamics", "obstacles", "planning")

#: Installs a lie; everything it changes is undone by the patch.
Install = Callable[["Sabotage"], None]


@dataclass(frozen=True)
class Lie:
    """A verdict that lies.

    Args:
        verdict: What decides.
        name: How it lies.
        install: Makes it.
        cases: Names of the problems that are planned under it.
        faults: Kinds of fault of which the judge has to find one at least.
    """

    verdict: str
    name: str
    install: Install
    cases: tuple[str, ...]
    faults: frozenset[str]

    def __str__(self) -> str:
        return f"{self.verdict}: {self.name}"


@dataclass(frozen=True)
class Motion:
    """A motion that was handed to the certificate.

    Args:
        case: Name of the problem.
        faults: What the judge finds wrong with it, by kind.
        believed: Whether the certificate says that it is verified.
        violation: What the certificate objects to; empty where nothing.
    """

    case: str
    faults: dict[str, str]
    believed: bool
    violation: str


class Sabotage:
    """Replaces verdicts wherever they are known by name, the proof's own modules included.

    Args:
        undo: Where what puts the truth back is left.
    """

    def __init__(self, undo: ExitStack) -> None:
        self._undo = undo

    def replace(self, original: Callable[..., Any], lie: Callable[..., Any]) -> None:
        """Put a lie in place of a function in every module that has it."""
        places = [
            (module, name)
            for module in _modules()
            for name, value in list(vars(module).items())
            if value is original
        ]
        assert places, original
        origin = original.__module__
        self._undo.callback(_forget, origin)
        for module, name in places:
            setattr(module, name, lie)
            self._undo.callback(setattr, module, name, original)
        _forget(origin)

    def wrap(self, original: Callable[..., Any], lie: Callable[..., Any]) -> None:
        """Put ``lie(original, ...)`` in place of a function in every module that has it."""
        self.replace(original, functools.partial(lie, original))

    def method(self, owner: type, name: str, lie: object) -> None:
        """Put a lie in place of a method or property of a class."""
        self._undo.callback(_forget, owner.__module__)
        self._undo.callback(setattr, owner, name, vars(owner)[name])
        setattr(owner, name, lie)
        _forget(owner.__module__)

    def module(self, owner: ModuleType, name: str, lie: object) -> None:
        """Put a lie in place of a name of one module, for this module alone."""
        self._undo.callback(setattr, owner, name, getattr(owner, name))
        setattr(owner, name, lie)

    def value(self, owner: object, name: str, lie: object) -> None:
        """Put a lie in place of a value of a frozen object."""
        origin = type(owner).__module__
        self._undo.callback(_forget, origin)
        self._undo.callback(object.__setattr__, owner, name, getattr(owner, name))
        object.__setattr__(owner, name, lie)
        _forget(origin)


def _modules() -> tuple[ModuleType, ...]:
    return _modules_of(len(sys.modules))


@functools.cache
def _modules_of(_count: int) -> tuple[ModuleType, ...]:
    return tuple(
        module
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] in _PACKAGES and module is not None
    )


def _forget(origin: str) -> None:
    """Empty the caches by content of all modules that a lie can reach from where it is told.

    What was packed before a lie must not be used under it, nor what was packed under it after.
    """
    reached = _reached(origin, len(sys.modules))
    for module in _modules():
        if module.__name__ in reached:
            for value in list(vars(module).values()):
                clear = getattr(value, "cache_clear", None)
                if clear is not None and not isinstance(value, type):
                    clear()


@functools.cache
def _reached(origin: str, _count: int) -> frozenset[str]:
    """A module and all that know a name of it, or of a module that does."""
    names = {
        module.__name__: {
            value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
            for value in list(vars(module).values())
        }
        for module in _modules()
    }
    reached = {origin}
    while more := {name for name, known in names.items() if known & reached} - reached:
        reached |= more
    return frozenset(reached)


@contextmanager
def installed(lie: Lie | None) -> Iterator[None]:
    """Everything under a lie, or under none."""
    with ExitStack() as undo:
        if lie is not None:
            lie.install(Sabotage(undo))
        yield


def tried(names: Sequence[str], lie: Lie | None) -> tuple[Motion, ...]:
    """Plan problems, under a lie or under none, and judge what was handed to the certificate.

    What is packed under a lie serves all problems; it is judged when the lie is gone.

    Args:
        names: Of the problems.
        lie: What lies; None for nothing.

    Returns:
        Every motion that was handed to the certificate, in turn, the answer of a problem last.
    """
    given = [case(name) for name in names]
    with installed(lie):
        handed = [_handed(one) for one in given]
    return tuple(
        motion for values in zip(names, given, handed, strict=True) for motion in _judged(*values)
    )


def _handed(given: Case) -> list[tuple[Trajectory, Certificate]]:
    """All motions that are handed to the certificate as a problem is planned, and its answer."""
    handed: list[tuple[Trajectory, Certificate]] = []

    def listening(trajectory: Trajectory, *values: Any, **more: Any) -> Certificate:
        certificate = certify(trajectory, *values, **more)
        handed.append((trajectory, certificate))
        return certificate

    with ExitStack() as undo:
        Sabotage(undo).replace(certify, listening)
        answer = plan(given.problem, given.options)
    if isinstance(answer, Plan):
        handed.append((answer.trajectory, answer.certificate))
    return handed


def _judged(
    name: str, given: Case, handed: Sequence[tuple[Trajectory, Certificate]]
) -> Iterable[Motion]:
    motions: dict[str, Motion] = {}
    for trajectory, certificate in handed:
        known = motions.get(trajectory.content_hash)
        wrong = faults(given.arm, trajectory, given.truth) if known is None else known.faults
        believed = certificate.verified or (known is not None and known.believed)
        violation = "" if certificate.violation is None else certificate.violation.message
        motions[trajectory.content_hash] = Motion(name, wrong, believed, violation)
    return motions.values()
