"""Print the table of the sabotage suite: lie, problems, bad motions, refused, believed."""

import sys
import time

from tests.planning.proof.sabotage.lies import LIES
from tests.planning.proof.sabotage.trial import Lie, Motion, tried

_HEAD = ("verdict", "lie", "problems", "motions", "bad", "refused", "believed", "s")


def main(part: str = "") -> None:
    """Print the table of all lies whose name contains a text, and every motion believed."""
    lies = [lie for lie in LIES if part in str(lie)]
    # Without lies first: every kernel is compiled then, and none ever with a lie inside.
    for name in sorted({name for lie in lies for name in lie.cases}):
        tried([name], None)
    print(_row(_HEAD) + "\n" + _row(["---"] * len(_HEAD)))  # noqa: T201
    for lie in lies:
        began = time.perf_counter()
        motions = list(tried(lie.cases, lie))
        print(_line(lie, motions, time.perf_counter() - began), flush=True)  # noqa: T201


def _line(lie: Lie, motions: list[Motion], seconds: float) -> str:
    bad = [motion for motion in motions if motion.faults]
    believed = [motion for motion in bad if motion.believed]
    counts = (len(lie.cases), len(motions), len(bad), len(bad) - len(believed), len(believed))
    lines = [_row([lie.verdict, lie.name, *counts, f"{seconds:.1f}"])]
    lines += [f"believed: {motion.case}: {motion.faults}" for motion in believed]
    if not any(lie.faults & motion.faults.keys() for motion in bad):
        lines.append("no bad motion was made")
    return "\n".join(lines)


def _row(cells: object) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"  # type: ignore[call-overload]


if __name__ == "__main__":
    main(*sys.argv[1:])
