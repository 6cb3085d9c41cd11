"""Arms by pinocchio: torques, velocities and poses to compare with."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain, builtin_urdf
from kinematics.trajectory.trajectory import Trajectory

_ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class PinocchioArm:
    """Torques, velocities of the tip and poses by pinocchio, seen from the root.

    Args:
        name: Built-in arm; of no matter where a description and a chain are given.
        urdf: Description of another arm.
        chain: Its chain.
        load: Mass of a point at the tip [kg].
        others: Positions of joints off the chain by their names, of configurations (k, n), to which
            they are linear; others are held at 0.
    """

    def __init__(
        self,
        name: str = "panda",
        urdf: str | None = None,
        chain: Chain | None = None,
        load: float = 0.0,
        others: Callable[[Array], Mapping[str, Array | float]] = lambda _: {},
    ) -> None:
        self.chain = chain or builtin_chain(name)
        self.model = pin.buildModelFromXML(urdf or builtin_urdf(name))
        self._tip = self.model.getFrameId(self.chain.tip_link, pin.FrameType.BODY)
        self._root = self.model.getFrameId(self.chain.root_link, pin.FrameType.BODY)
        if load:
            frame = self.model.frames[self._tip]
            point = pin.Inertia(load, frame.placement.translation, np.zeros((3, 3)))
            self.model.appendBodyToJoint(frame.parentJoint, point, pin.SE3.Identity())
        self.data = self.model.createData()
        self._others = others
        #: Velocities of all joints by those of the chain, shape (nv, n).
        self.gears = np.zeros((self.model.nv, self.chain.n))
        for j, joint in enumerate(self.chain.joint_names):
            self.gears[self._joint(joint).idx_v, j] = 1.0
        states = np.vstack([np.eye(self.chain.n), np.zeros(self.chain.n)])
        for joint, values in others(states).items():
            every = np.broadcast_to(values, len(states))
            self.gears[self._joint(joint).idx_v] = every[:-1] - every[-1]

    def _joint(self, name: str) -> Any:
        return self.model.joints[self.model.getJointId(name)]

    def _frame(self, link: str | None) -> int:
        return int(self.model.getFrameId(link, pin.FrameType.BODY)) if link else self._tip

    def configuration(self, q: Array) -> Array:
        """Configuration of all joints of the model; those without end by cosine and sine."""
        return self.configurations(q[None])[:, 0]

    def configurations(self, states: Array) -> Array:
        """Configurations of all joints, a column for each row of states."""
        whole = np.repeat(pin.neutral(self.model)[:, None], len(states), axis=1)
        for name, values in (
            *zip(self.chain.joint_names, states.T, strict=True),
            *self._others(states).items(),
        ):
            joint, each = self._joint(name), np.broadcast_to(values, len(states))
            turns = joint.nq > joint.nv
            rows = (np.cos(each), np.sin(each)) if turns else each
            whole[joint.idx_q : joint.idx_q + joint.nq] = rows
        return whole

    def torque(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Joint torques, shape (n,) [N m or N]."""
        rates = (self.gears @ x for x in (qd, qdd))
        tau = pin.rnea(self.model, self.data, self.configuration(q), *rates)
        return np.asarray(self.gears.T @ tau)

    def tip_velocity(self, q: Array, qd: Array) -> Array:
        """Velocity of the tip's origin, shape (3,) [m/s]."""
        return self.twist(q, qd)[:3]

    def twist(self, q: Array, qd: Array) -> Array:
        """Velocity of the tip's origin and angular velocity of the tip, shape (6,)."""
        pin.forwardKinematics(self.model, self.data, self.configuration(q), self.gears @ qd)
        pin.updateFramePlacements(self.model, self.data)
        return np.array(pin.getFrameVelocity(self.model, self.data, self._tip, _ALIGNED).vector)

    def pose(self, q: Array, link: str | None = None) -> Array:
        """Pose of a link seen from the root, of the tip where none is named, shape (4, 4)."""
        pin.framesForwardKinematics(self.model, self.data, self.configuration(q))
        frame = self.data.oMf[self._frame(link)]
        return np.asarray(self.data.oMf[self._root].actInv(frame).homogeneous)

    def jacobian(self, q: Array, link: str | None = None) -> Array:
        """Jacobian of the origin of a link, of the tip where none is named, shape (6, n)."""
        whole, frame = self.configuration(q), self._frame(link)
        J = pin.computeFrameJacobian(self.model, self.data, whole, frame, _ALIGNED)
        pin.framesForwardKinematics(self.model, self.data, whole)
        return self._from_root(J)

    def jacobian_rate(self, q: Array, qd: Array, link: str | None = None) -> Array:
        """Derivative of that in time, shape (6, n)."""
        whole, rates = self.configuration(q), self.gears @ qd
        pin.computeJointJacobiansTimeVariation(self.model, self.data, whole, rates)
        pin.updateFramePlacements(self.model, self.data)
        rate = pin.getFrameJacobianTimeVariation(self.model, self.data, self._frame(link), _ALIGNED)
        return self._from_root(rate)

    def _from_root(self, J: Array) -> Array:
        R = self.data.oMf[self._root].rotation
        return np.asarray(np.kron(np.eye(2), R.T) @ J @ self.gears)

    def torques(self, motion: Trajectory, times: Array) -> Array:
        """Joint torques of a motion at instants, shape (k, n)."""
        return self.torques_at(*(motion.sample(times, order) for order in range(3)))

    def torques_at(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Joint torques in states, shape (k, n)."""
        return np.array([self.torque(*state) for state in zip(q, qd, qdd, strict=True)])

    def tip_speeds(self, motion: Trajectory, times: Array) -> Array:
        """Speeds of the tip of a motion at instants, shape (k,) [m/s]."""
        return self.tip_speeds_at(motion.sample(times), motion.sample(times, 1))

    def tip_speeds_at(self, q: Array, qd: Array) -> Array:
        """Speeds of the tip in states, shape (k,) [m/s]."""
        velocities = [self.tip_velocity(*state) for state in zip(q, qd, strict=True)]
        return np.asarray(np.linalg.norm(velocities, axis=1))
