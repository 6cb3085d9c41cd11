"""Calls among kernels: errors, arrays, tuples, recursion, constants and options."""

import math
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core.errors import TypingError

from compiled.compiler import machine_code as kernel_code
from compiled.compiler.fingerprint import fingerprint
from compiled.kernel import direct, kernel
from tests.compiled.programs import BIG_PROGRAM, python, write_big

pytestmark = pytest.mark.usefixtures("_nothing_kept")


Array = np.ndarray[Any, np.dtype[np.float64]]


def test_a_large_kernel_is_called_with_errors_and_arrays_intact(tmp_path: Path) -> None:
    fresh = python(BIG_PROGRAM, write_big(tmp_path))
    assert fresh.splitlines()[1] == "too much"
    assert python(BIG_PROGRAM, tmp_path) == fresh
    caller = next((tmp_path / "cache").glob(f"big.caller-{32 * '[0-9a-f]'}.kernel"))
    large = next((tmp_path / "cache").glob(f"big.large-{32 * '[0-9a-f]'}.kernel"))
    assert large.stem.encode() in caller.read_bytes()


@kernel
def ratio(numerator: float, denominator: float) -> float:
    return numerator / denominator


@kernel(inline="always", fastmath=True)
def total(values: Array) -> float:
    sum_ = 0.0
    for value in values:
        sum_ += value
    return sum_


@kernel
def scaled(values: Array, by: int) -> float:
    return float(values[0] * by)


@kernel
def scaled_thrice(values: Array) -> float:
    return scaled(values, 2) + scaled(values, 3) + scaled(values, by=int(values[0]))


def test_literals_in_calls_make_no_signatures_of_their_own() -> None:
    assert scaled_thrice(np.array([4.0])) == 36.0
    assert len(scaled.overloads) == 1  # type: ignore[attr-defined]


def test_a_kernel_that_only_kernels_call_has_no_door() -> None:
    assert scaled_thrice(np.array([4.0])) == 36.0
    names = [name for name in kernel_code._codes if "test_kernel_calls.scaled-" in name]
    assert names
    assert not [name for name in names if "door" in name]
    # Python may call it all the same, and then it gets one.
    assert scaled(np.array([4.0]), 2) == 8.0


@kernel
def factorial(n: int) -> int:
    return 1 if n < 2 else n * factorial(n - 1)


@kernel
def even(n: int) -> bool:
    return True if n == 0 else odd(n - 1)


@kernel
def odd(n: int) -> bool:
    return False if n == 0 else even(n - 1)


def test_a_kernel_may_call_itself_but_not_by_way_of_another() -> None:
    assert factorial(5) == 120
    with pytest.raises(NotImplementedError, match="calls itself by way of another"):
        even(4)


class Pair(NamedTuple):
    left: Array
    right: Array


@kernel
def swapped(pair: Pair) -> Pair:
    return Pair(pair.right, pair.left)


def test_tuples_of_arrays_go_through_doors() -> None:
    left, right = np.arange(3.0), np.arange(4.0)
    answer = swapped(Pair(left, right))
    assert isinstance(answer, Pair)
    assert np.shares_memory(answer.left, right)
    assert direct(swapped, Pair(left, right))(Pair(right, left)).right.size == 4


def first(values: Array) -> float:
    return float(values[0])


@pytest.mark.parametrize("order", [(False, True), (True, False)])
def test_arrays_that_differ_in_constness_are_looked_up_once_each(
    order: tuple[bool, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    called: Any = kernel(first)
    look_up, looked_up = called._compile_for_args, list[object]()

    def count(_: object, *args: object) -> object:
        looked_up.append(args)
        return look_up(*args)

    monkeypatch.setattr(type(called), "_compile_for_args", count)
    for writable in 3 * order:
        values = np.array([2.0, 3.0])
        values.setflags(write=writable)
        assert called(values) == 2.0
    assert len(looked_up) <= 2


@kernel
def mixed(pair: Pair, by: float) -> Pair:
    left, right = pair.left.copy(), pair.right
    for i in range(left.size):
        left[i] += by * np.sin(right[i]) + np.arctan2(right[i], by) - np.sqrt(abs(right[i]))
        for j in range(i):
            left[i] += np.exp(-left[j]) * np.tanh(right[j]) + np.log1p(abs(left[j])) * right[i]
            left[j] -= np.cos(left[i]) * np.hypot(right[j], by) + np.expm1(-abs(left[i]))
            left[i] *= np.arctan2(np.sinh(left[j]), np.cosh(right[i])) + np.cbrt(left[j] + by)
            left[j] /= 2.0 + np.tan(left[i]) ** 2 + np.arcsinh(right[j]) ** 2 + abs(left[j])
        left[i] = max(min(left[i], 2.0 * by), -2.0 * by) if right[i] > 0.0 else left[i] % by
    if not np.isfinite(left[0]):
        raise ValueError("not finite")
    return Pair(right, left)


def test_a_door_hands_tuples_numbers_and_errors_to_a_large_kernel_and_back() -> None:
    pair = Pair(np.array([0.1, 0.4, -0.3]), np.array([0.2, -0.5, 0.9]))
    expected = mixed.py_func(pair, 0.5).right  # type: ignore[attr-defined]
    answer = mixed(pair, 0.5)
    (result,) = mixed.overloads.values()  # type: ignore[attr-defined]
    code = kernel_code.find(result.entry_point.name)
    assert code is not None
    assert code.bitcode is None, "it is small, and copied into its door"
    np.testing.assert_allclose(answer.right, expected, rtol=1e-14)
    assert answer.left is pair.right
    references = [sys.getrefcount(one) for one in pair]
    for _ in range(100):
        mixed(pair, 0.5)
        with pytest.raises(ValueError, match="not finite"):
            mixed(Pair(pair.left * np.nan, pair.right), 0.5)
    del answer
    assert [sys.getrefcount(one) for one in pair] == [references[0], references[1] - 1]
    with pytest.raises(TypeError):
        direct(mixed, pair, 0.5)(pair, "half")  # type: ignore[arg-type]


@kernel
def measure(pair: Pair, at: int) -> float:
    return float(pair.left[at] * pair.right[at])


@kernel
def both(pair: Pair) -> float:
    return measure(pair, 0) + measure(pair, 1)


@kernel
def clear(values: Array) -> None:
    values[0] = 0.0


@kernel
def clear_somewhere(pair: Pair, right: bool) -> float:
    end = pair.left[1:]
    if right:
        end = pair.right
    clear(end)
    return 0.0


@kernel
def clear_and_measure(pair: Pair, out: Pair) -> float:
    out.left[0] = 1.0
    return measure(pair, 0) + measure(out, 1)


def constant(values: Array) -> Array:
    values.flags.writeable = False
    return values


def test_a_kernel_that_only_reads_is_compiled_once_for_constant_arrays() -> None:
    for left in (np.ones(2), constant(np.ones(2))):
        for right in (np.ones(2), constant(np.ones(2))):
            assert both(Pair(left, right)) == 2.0
    assert len(both.overloads) == len(measure.overloads) == 1  # type: ignore[attr-defined]


def test_a_kernel_that_writes_calls_one_that_reads_with_all_kinds_of_tuples() -> None:
    for left in (np.ones(2), constant(np.ones(2))):
        for pair in (Pair(left, np.ones(2)), Pair(left, constant(np.ones(2)))):
            assert clear_and_measure(pair, Pair(np.ones(2), constant(np.ones(2)))) == 2.0


@pytest.mark.parametrize("right", [False, True])
def test_a_kernel_that_writes_refuses_constant_arrays(right: bool) -> None:
    for pair in (Pair(constant(np.ones(2)), np.ones(2)), Pair(np.ones(2), constant(np.ones(2)))):
        with pytest.raises(TypingError):
            clear_somewhere(pair, right)
    assert clear_somewhere(Pair(np.ones(2), np.ones(2)), right) == 0.0


def test_division_by_zero_follows_ieee_754() -> None:
    assert ratio(1.0, 0.0) == math.inf
    assert math.isnan(ratio(0.0, 0.0))


def test_options_are_passed_on() -> None:
    values = np.random.default_rng(0).normal(size=1000)
    assert total(values) == pytest.approx(math.fsum(values), rel=1e-12)
    freedoms = total.targetoptions["fastmath"]  # type: ignore[attr-defined]
    assert freedoms["contract"]
    assert "reassoc" not in freedoms, "the order of a sum must not hang on the processor"
    assert ratio.targetoptions["fastmath"] is False  # type: ignore[attr-defined]


def test_fingerprint_tells_kernels_apart_and_repeats() -> None:
    assert fingerprint(ratio) == fingerprint(ratio)
    assert fingerprint(ratio) != fingerprint(total)


@pytest.mark.parametrize(
    ("body", "is_same"), [("return 2.0 * x", True), ("return len(DOC) * x", False)]
)
def test_a_docstring_does_not_enter_a_fingerprint(body: str, is_same: bool) -> None:
    made = []
    for docstring in ("Double of a number.", "Twice a number."):
        names: dict[str, Any] = {}
        text = body.replace("DOC", repr(docstring))
        exec(f"def scaled(x):\n    {docstring!r}\n    {text}\n", names)
        made.append(fingerprint(names["scaled"]))
    assert (made[0] == made[1]) is is_same


@kernel
def winding(first: Array, unread: Array, second: Array) -> float:
    y = z = float(first[0])
    for i in range(first.size):
        y = math.sqrt(abs(z) + first[i]) + math.atan2(y, second[i]) + math.sqrt(y * y + z * z)
        z = math.atan2(z, y) + math.sqrt(y * y + 3.0) + math.atan2(second[i], z)
        y += math.sqrt(abs(z) + second[i]) + math.atan2(y, z) + math.sqrt(y * y + z * z)
        z -= math.atan2(z, y) + math.sqrt(y * y + 2.0) + math.atan2(first[i], z)
        y += math.hypot(z, first[i]) + math.atan2(second[i], y) + math.sqrt(y * y + 5.0)
        z -= math.hypot(y, second[i]) + math.sqrt(z * z + 7.0) + math.atan2(first[i], y)
        y -= math.sqrt(z * z + y * y) + math.hypot(y, z) + math.atan2(second[i], first[i])
    return y + z


@kernel
def wound_twice(first: Array, unread: Array, second: Array) -> float:
    once, again = winding(first, unread, second), winding(second, unread, first)
    smaller = larger = 0.0
    for i in range(first.size):
        smaller = min(smaller, math.hypot(first[i], once) - math.tanh(again) * math.sinh(second[i]))
        larger = max(larger, math.hypot(second[i], again) - math.sinh(once) * math.tanh(first[i]))
        smaller -= math.cosh(larger) - math.expm1(-abs(smaller)) + math.log1p(abs(larger))
        larger += math.cosh(smaller) + math.expm1(-abs(larger)) + math.log1p(abs(smaller))
        smaller -= math.hypot(larger, once) + math.atan2(smaller, again) * math.atan2(larger, once)
        larger += math.hypot(smaller, again) + math.atan2(larger, once) * math.atan2(smaller, again)
    return once + again if smaller <= larger else math.nan


def test_kernels_do_not_call_the_copy_in_a_door() -> None:
    first, second = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    once = winding(first, np.zeros(1), second)
    again = winding(second, np.zeros(1), first)
    assert wound_twice(first, np.zeros(1), second) == once + again
    sizes = {"winding": False, "wound_twice": True}
    for name, is_large in sizes.items():
        (result,) = globals()[name].overloads.values()
        code = kernel_code.find(result.entry_point.name)
        assert code is not None
        assert (code.bitcode is None) == is_large, f"the size of {name} has changed"
        assert b"7windingB" in (code.machine_code or code.bitcode or b"")


def second(values: Array) -> float:
    return float(values[1])


def product(n: int) -> int:
    return 1 if n < 2 else n * product_kernel(n - 1)


product_kernel = kernel(product)
