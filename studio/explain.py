"""Failures explained: every pair that collides where the failure is, with its depth."""

from armwright_client import CheckAnswer, Obstacle
from studio.requests import plan_request, set_fields
from studio.result import Failure
from studio.workbench import Workbench


def colliding_pairs(workbench: Workbench, failed: Failure) -> list[tuple[str, str]]:
    """The pairs that collide or are nearer than the margin, the deepest first.

    Args:
        workbench: Workbench that asks.
        failed: Failure with the configuration that it is about.
    """
    pairs = [] if failed.pair is None else [failed.pair]
    if failed.shown is None:
        return pairs
    answer = check(workbench, failed)
    hits = sorted(answer.collisions, key=lambda hit: -(hit.depth or 0.0))
    pairs += [hit.pair for hit in hits]
    if not hits and answer.clearance_pair is not None and not answer.valid:
        pairs.append(answer.clearance_pair)
    return [pair for i, pair in enumerate(pairs) if {*pair} not in [{*p} for p in pairs[:i]]]


def check(workbench: Workbench, failed: Failure) -> CheckAnswer:
    """The verdict on the configuration that a failure is about.

    Args:
        workbench: Workbench that asks.
        failed: Failure with the configuration that it is about.
    """
    fields = set_fields(plan_request(failed.state, keep=False))
    names = ("scene", "attached", "margin", "fingers")
    options = {name: fields[name] for name in names if name in fields}
    answer = workbench.client.check(failed.state.robot, list(failed.shown or ()), **options)
    if not isinstance(answer, CheckAnswer):
        raise TypeError("one configuration was asked about, and many verdicts were answered")
    return answer


def obstacle_named(failed: Failure, name: str) -> Obstacle | None:
    """The obstacle of a name, if it is one.

    Args:
        failed: Failure with its scene.
        name: Name of an obstacle or a link.
    """
    return next((item for item in failed.state.obstacles if item.id == name), None)
