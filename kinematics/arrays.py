"""Arrays of numbers, and checks of the arguments of public functions.

An argument of another type is refused by name, with what to give.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from functools import cache, wraps
from inspect import signature
from types import MappingProxyType, NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from compiled.arrays import Array, Indices
from kinematics.errors import InvalidNumbers, InvalidOption

_F = TypeVar("_F", bound=Callable[..., Any])
#: What counts as a number where one is annotated; a bool is a mistake.
_NUMBERS = (int, float, np.integer, np.floating)
#: What makes a value that is often given by its name, by the type's name.
_CURES = {
    "RobotGeometry": "Load it by its name or from its file: aw.load_robot({!r}).",
    "Chain": "Give what aw.load_robot makes, or the chain of it.",
    "Scene": "Give aw.Scene([...]), or aw.Scene() where there are no obstacles.",
    "Trajectory": "Give that of a plan, or what aw.retime makes of waypoints.",
}


def typed(function: _F) -> _F:
    """Refuse arguments that are not of the class that their annotation names.

    What is annotated as ``ArrayLike`` has to be numbers, a literal one of its values, and no
    sequence is a text. Shapes and callables are left to the function.

    Args:
        function: A public function.

    Returns:
        The function; it raises InvalidOption where an argument is of another type, no array of
        numbers or no known choice.
    """
    parameters = tuple(signature(function).parameters)

    @cache
    def checks() -> dict[str, tuple[tuple[type, ...], Callable[[object], None]]]:
        hints = get_type_hints(function)
        return {name: _check(function.__name__, name, hints[name]) for name in hints}

    @wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        known = checks()
        for name, value in (*zip(parameters, args, strict=False), *kwargs.items()):
            kinds, check = known.get(name, _ANY)
            if type(value) not in kinds:
                check(value)
        return function(*args, **kwargs)

    return cast(_F, checked)


def _check(
    function: str, name: str, hint: Any
) -> tuple[tuple[type, ...], Callable[[object], None]]:
    """The classes of one argument that need no check, and the check of others.

    It refuses what the annotation does not name.
    """
    parts = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    optional, kinds = hint == ArrayLike | None, _classes(parts)

    def numbers_alone(value: object) -> None:
        exact = type(value) is np.ndarray and value.dtype == np.float64
        if not exact and not (optional and value is None):
            as_numbers(cast(Any, value), name)

    def choice(value: object) -> None:
        if value not in parts and value not in get_args(hint):
            choices = ", ".join(map(str, get_args(hint)))
            message = f"{function}: there is no {name} {value!r}"
            raise InvalidOption(message, hint=f"One of: {choices}.")

    def no_text(value: object) -> None:
        if isinstance(value, str):
            raise InvalidOption(f"{function}: {name} is the text {value!r}", hint="Give a list.")
        if kinds and not _fits(value, kinds):
            raise _refusal(function, name, value, kinds)

    def instance(value: object) -> None:
        if not _fits(value, kinds):
            raise _refusal(function, name, value, kinds)

    if hint == ArrayLike or optional:
        return (), numbers_alone
    if get_origin(hint) is Literal:
        return (), choice
    if get_origin(hint) in (Iterable, Sequence):
        return (), no_text
    return (kinds, instance) if kinds else _ANY


def _accept(_value: object) -> None:
    """Accept any value: the function checks it itself."""


#: The check of what is not annotated by classes.
_ANY: tuple[tuple[type, ...], Callable[[object], None]] = ((), _accept)


def _classes(parts: tuple[Any, ...]) -> tuple[type, ...]:
    """The classes that a value may be of; none where a hint names others than classes."""
    known = [get_origin(part) if get_origin(part) is Mapping else part for part in parts]
    if not all(isinstance(part, type) and get_origin(part) is None for part in known):
        return ()
    return tuple(kind for part in known for kind in (_NUMBERS if part is float else (part,)))


def _fits(value: object, kinds: tuple[type, ...]) -> bool:
    """Whether a value is of one of some classes; a truth value is no number."""
    return isinstance(value, kinds) and (not isinstance(value, bool) or bool in kinds)


def _refusal(function: str, name: str, value: object, kinds: tuple[type, ...]) -> InvalidOption:
    names = dict.fromkeys("number" if kind in _NUMBERS else kind.__name__ for kind in kinds)
    known = [one.replace(NoneType.__name__, "None") for one in names]
    cure = next((_CURES[one] for one in known if one in _CURES), f"Give {' or '.join(known)}.")
    named = value if isinstance(value, str) else "panda"
    return InvalidOption(
        f"{function}: {name} has to be a {' or '.join(known)}, and {value!r:.60} is a "
        f"{type(value).__name__}",
        hint=cure.format(named),
    )


__all__ = ["Array", "Indices", "as_numbers", "contiguous", "frozen", "numbers"]


def frozen(values: ArrayLike) -> Array:
    """A read-only, contiguous copy of ``values`` as float64; what is one already, itself.

    Raises:
        InvalidNumbers: The values are no numbers, or rows of different lengths.
    """
    # A view may be of what can still be written to.
    is_own = type(values) is np.ndarray and values.dtype == np.float64 and values.base is None
    if is_own and values.flags.c_contiguous and not values.flags.writeable:  # type: ignore[union-attr]
        return values  # type: ignore[return-value]
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        array = as_numbers(values, "what is given")  # which tells what is wrong
    array.setflags(write=False)
    return array


class Remade:
    """A frozen dataclass that pickles as its arguments: it arrives checked and read-only too."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = (item.name for item in fields(self) if item.init)  # type: ignore[arg-type]
        return type(self), tuple(_plain(getattr(self, name)) for name in arguments)


def _plain(value: Any) -> Any:
    """A value with a dictionary in place of a read-only mapping, which can't be pickled."""
    if not isinstance(value, MappingProxyType):
        return value
    return {key: _plain(item) for key, item in value.items()}


def as_numbers(values: ArrayLike, name: str) -> Array:
    """An array of numbers, of any shape, NaN and infinities among them.

    Raises:
        InvalidNumbers: The values are no numbers, or rows of different lengths.
    """
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidNumbers(
            f"{name} is no array of numbers with rows of equal length: {str(values)[:40]!r}",
            hint="Give numbers, in rows of equal length.",
        ) from None


def contiguous(values: ArrayLike, name: str) -> Array:
    """An array of numbers side by side in memory, as kernels read it.

    Raises:
        InvalidNumbers: The values are no numbers, or rows of different lengths.
    """
    return np.ascontiguousarray(as_numbers(values, name))


def numbers(values: ArrayLike, name: str, shape: tuple[int, ...] | None = None) -> Array:
    """An array of finite numbers.

    Args:
        values: Values as a caller gives them.
        name: Name of the argument.
        shape: Lengths that it has to have, -1 for any; None for any shape.

    Raises:
        InvalidOption: The values are not finite numbers, or of another shape.
    """
    array = as_numbers(values, name)
    if shape is not None and not _has_shape(array, shape):
        wanted = str(shape).replace("-1", "any")
        raise InvalidOption(
            f"{name} has the shape {array.shape}, not {wanted}", hint="Give an array of that shape."
        )
    if not np.isfinite(array).all():
        raise InvalidOption(f"{name} is not finite", hint="Give numbers without NaN and infinity.")
    return array


def _has_shape(array: Array, shape: tuple[int, ...]) -> bool:
    lengths = zip(array.shape, shape, strict=False)
    return array.ndim == len(shape) and all(wanted in (-1, own) for own, wanted in lengths)
