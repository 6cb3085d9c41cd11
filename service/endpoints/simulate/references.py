"""References of closed loops from wire to domain: trajectories, and references by name."""

from typing import NamedTuple

import numpy as np

from armwright_wire import simulation as schema
from armwright_wire.simulation import SimulateRequest
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from service.translate import trajectories
from tracking.simulation.references import hold, sine, spline, step


class RequestReference(NamedTuple):
    """The reference of a request.

    Args:
        motion: As a trajectory.
        begins: When it begins, in the request's time [s].
        rest: Where the robot rests before, shape (n,) [rad or m]; None at the motion's start.
    """

    motion: Trajectory
    begins: float
    rest: Array | None


def reference(body: SimulateRequest, chain: Chain) -> RequestReference:
    """The reference of a request, a trajectory or one by name.

    Raises:
        InvalidTrajectory: Joints or lengths do not fit the robot, or times do not ascend.
        InvalidRobotState: A vector has the wrong length.
        InvalidOption: A value is out of its range.
    """
    named = body.reference
    if named is None:
        assert body.trajectory is not None
        motion, begins = trajectories.trajectory(body.trajectory, chain)
        return RequestReference(motion, begins, None)
    if isinstance(named, schema.Step):
        motion = step(chain, named.start, named.end, named.at, named.duration)
        return RequestReference(motion, 0.0, np.array(named.start))
    if isinstance(named, schema.Hold):
        motion = hold(chain, named.joints, named.duration)
    elif isinstance(named, schema.Sine):
        shape = named.center, named.amplitude, named.frequency, named.phase
        motion = sine(chain, *shape, named.duration)
    else:
        motion = spline(chain, named.points, named.times, named.interpolation)
    return RequestReference(motion, 0.0, None)
