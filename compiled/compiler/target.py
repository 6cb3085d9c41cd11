"""The kind of processor that kernels are compiled for."""

import os
from functools import cache
from typing import NamedTuple

import llvmlite.binding as llvm
from numba.core import config
from numba.core.registry import cpu_target

_BELOW_V3 = frozenset({"sse4.2", "ssse3", "popcnt", "cx16"})
_V3 = _BELOW_V3 | {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"}
_V4 = _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}
#: What a processor must have to be one of each kind.
_NEEDS: dict[str, frozenset[str]] = {
    "x86-64": frozenset(),
    "x86-64-v3": _V3,
    "x86-64-v4": _V4,
}
#: The very processor.
_NATIVE = "native"
#: Kinds taken where ARMWRIGHT_KERNEL_TARGET says nothing, the best first. Their machine code gives
#: the same bits; that of older kinds, without fused multiplication, does not.
_USUAL = ("x86-64-v4", "x86-64-v3")


class Target(NamedTuple):
    """A processor as LLVM knows it."""

    triple: str
    name: str
    features: str


@cache
def target() -> Target:
    """The processor that this process compiles for; the first call sets it in numba.

    A stated kind such as x86-64-v3 rather than the very processor: its machine code runs, and
    answers with the same bits, on every processor of that kind. One that is not of the kind gets
    code of its own, and a user's NUMBA_CPU_NAME goes before all.
    """
    begun = "_toplevel_target_context" in vars(cpu_target)
    wanted = os.environ.get("ARMWRIGHT_KERNEL_TARGET") or usual()
    if wanted not in (*_NEEDS, _NATIVE):
        kinds = ", ".join((*_NEEDS, _NATIVE))
        raise ValueError(f"ARMWRIGHT_KERNEL_TARGET is {wanted!r}; it is one of {kinds}")
    if not begun and config.CPU_NAME is None and wanted != _NATIVE and available(wanted):
        config.CPU_NAME, config.CPU_FEATURES = wanted, ""
    return Target(*cpu_target.target_context.codegen().magic_tuple())


def usual() -> str:
    """The kind that is taken where none is asked for: the widest that this processor is of."""
    return next((kind for kind in _USUAL if available(kind)), _NATIVE)


def available(kind: str) -> bool:
    """Whether the processor runs machine code for a kind."""
    if kind == _NATIVE:
        return True
    return llvm.get_process_triple().startswith("x86_64") and _NEEDS[kind] <= _features()


def _features() -> frozenset[str]:
    return frozenset(name for name, there in llvm.get_host_cpu_features().items() if there)
