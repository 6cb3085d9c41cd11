"""The kind of processor that kernels are compiled for."""

import os
from functools import cache
from typing import NamedTuple

import llvmlite.binding as llvm
from numba.core import config
from numba.core.registry import cpu_target

#: Where ARMWRIGHT_KERNEL_TARGET says nothing.
_USUAL = "x86-64-v3"
_BELOW_V3 = frozenset({"sse4.2", "ssse3", "popcnt", "cx16"})
_V3 = _BELOW_V3 | {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"}
#: What a processor must have to be one of each kind.
_NEEDS: dict[str, frozenset[str]] = {
    "x86-64": frozenset(),
    "x86-64-v3": _V3,
    "x86-64-v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
}


class Target(NamedTuple):
    """A processor as LLVM knows it."""

    triple: str
    name: str
    features: str


@cache
def target() -> Target:
    """The processor that this process compiles for; numba is told the first time.

    A stated kind such as x86-64-v3 rather than the very processor: its machine code runs, and
    answers with the same bits, on every processor of that kind. One that is not of the kind gets
    code of its own, and a user's NUMBA_CPU_NAME goes before all.
    """
    begun = "_toplevel_target_context" in vars(cpu_target)
    wanted = os.environ.get("ARMWRIGHT_KERNEL_TARGET", _USUAL)
    if wanted not in (*_NEEDS, "native"):
        kinds = ", ".join((*_NEEDS, "native"))
        raise ValueError(f"ARMWRIGHT_KERNEL_TARGET is {wanted!r}; it is one of {kinds}")
    if not begun and config.CPU_NAME is None and _has(wanted):
        config.CPU_NAME, config.CPU_FEATURES = wanted, ""
    return Target(*cpu_target.target_context.codegen().magic_tuple())


def _has(kind: str) -> bool:
    if kind == "native" or not llvm.get_process_triple().startswith("x86_64"):
        return False
    features = llvm.get_host_cpu_features()
    return all(features.get(name, False) for name in _NEEDS[kind])
