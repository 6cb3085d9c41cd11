"""The paper of the exam: all questions, in the order of the lectures."""

import numpy as np

from tests.course.exam import control, dynamics, inverse, lyapunov, potential, rotations, velocity
from tests.course.exam.question import Question

PARTS = (rotations, inverse, velocity, potential, control, dynamics, lyapunov)


def paper(seed: int = 37) -> list[Question]:
    """All questions of a seed."""
    rngs = np.random.default_rng(seed).spawn(len(PARTS))
    asked = [one for part, rng in zip(PARTS, rngs, strict=True) for one in part.questions(rng)]
    return sorted(asked, key=lambda one: one.lecture)
