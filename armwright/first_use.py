"""Kernels of a wheel that brings none: compiled at first use, on all cores, with progress."""

import sys

from compiled.compiler.dispatcher import before_first


def compile_at_first_use() -> None:
    """Have this process compile what a first plan needs before it compiles anything."""
    before_first(_compile)


def _compile() -> None:
    from service.cli import Terminal  # noqa: PLC0415  seldom needed, and long
    from service.warm_up.kernels import compile_kernels  # noqa: PLC0415

    compile_kernels(Terminal(sys.stderr).show, first_only=True)
