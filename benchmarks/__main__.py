"""Every benchmark that needs no data of its own, one after the other: ``python -m benchmarks``."""

import runpy
import sys

NAMES = (
    "kinematics",
    "ik",
    "timing",
    "scale",
)

for name in NAMES:
    print(f"== {name}", flush=True)
    sys.argv = [name]
    runpy.run_module(f"benchmarks.{name}", run_name="__main__")
