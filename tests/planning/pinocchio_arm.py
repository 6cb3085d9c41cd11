"""Arms by pinocchio: torques, velocities and poses to compare with."""

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain, builtin_urdf
from kinematics.trajectory.trajectory import Trajectory


class PinocchioArm:
    """Torques, velocities of the tip and poses by pinocchio; joints off the chain are held at 0.

    Args:
        name: Built-in arm; of no matter where a description and a chain are given.
        urdf: Description of another arm.
        chain: Its chain.
        load: Mass of a point at the tip [kg].
    """

    def __init__(
        self,
        name: str = "panda",
        urdf: str | None = None,
        chain: Chain | None = None,
        load: float = 0.0,
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
        joints = (self.model.joints[self.model.getJointId(j)] for j in self.chain.joint_names)
        self.index = [joint.idx_v for joint in joints]

    def configuration(self, q: Array) -> Array:
        """Configuration of all joints of the model; those without end by cosine and sine."""
        return self.configurations(q[None])[:, 0]

    def configurations(self, states: Array, more: Mapping[str, Array] | None = None) -> Array:
        """Configurations of all joints, a column for each row of states, with more by name."""
        whole = np.repeat(pin.neutral(self.model)[:, None], len(states), axis=1)
        for name, values in (
            *zip(self.chain.joint_names, states.T, strict=True),
            *(more or {}).items(),
        ):
            joint = self.model.joints[self.model.getJointId(name)]
            turns = joint.nq > joint.nv
            whole[joint.idx_q : joint.idx_q + joint.nq] = (
                (np.cos(values), np.sin(values)) if turns else values
            )
        return whole

    def rates(self, values: Array) -> Array:
        """Velocities or accelerations of all joints of the model."""
        wide = np.zeros(self.model.nv)
        wide[self.index] = values
        return wide

    def torque(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Joint torques, shape (n,) [N m or N]."""
        rates = (self.rates(x) for x in (qd, qdd))
        tau = pin.rnea(self.model, self.data, self.configuration(q), *rates)
        return np.asarray(tau)[self.index]

    def tip_velocity(self, q: Array, qd: Array) -> Array:
        """Velocity of the tip's origin in the base frame, shape (3,) [m/s]."""
        pin.forwardKinematics(self.model, self.data, self.configuration(q), self.rates(qd))
        pin.updateFramePlacements(self.model, self.data)
        reference = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        twist = pin.getFrameVelocity(self.model, self.data, self._tip, reference)
        return np.asarray(twist.linear)

    def pose(self, q: Array, link: str | None = None) -> Array:
        """Pose of a link seen from the root, of the tip where none is named, shape (4, 4)."""
        pin.framesForwardKinematics(self.model, self.data, self.configuration(q))
        frame = self.data.oMf[self.model.getFrameId(link) if link else self._tip]
        return np.asarray(self.data.oMf[self._root].actInv(frame).homogeneous)

    def jacobian(self, q: Array) -> Array:
        """Jacobian of the tip's origin in the base frame, shape (6, n)."""
        whole, kind = self.configuration(q), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        J = pin.computeFrameJacobian(self.model, self.data, whole, self._tip, kind)
        return np.asarray(J)[:, self.index]

    def torques(self, motion: Trajectory, times: Array) -> Array:
        """Joint torques of a motion at instants, shape (k, n)."""
        states = (motion.sample(times, order) for order in range(3))
        return np.array([self.torque(*state) for state in zip(*states, strict=True)])

    def tip_speeds(self, motion: Trajectory, times: Array) -> Array:
        """Speeds of the tip of a motion at instants, shape (k,) [m/s]."""
        states = zip(motion.sample(times), motion.sample(times, 1), strict=True)
        return np.asarray(np.linalg.norm([self.tip_velocity(*s) for s in states], axis=1))
