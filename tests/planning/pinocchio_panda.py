"""The Panda by pinocchio: torques, velocities and poses to compare with."""

import numpy as np
import pinocchio as pin

from kinematics.arrays import Array
from kinematics.robots import builtin_chain, builtin_urdf


class PinocchioPanda:
    """Torques, the tip's velocity and link poses of the Panda by pinocchio."""

    def __init__(self) -> None:
        self.chain = builtin_chain("panda")
        self.model = pin.buildModelFromXML(builtin_urdf("panda"))
        self.data = self.model.createData()
        self.index = [
            self.model.joints[self.model.getJointId(name)].idx_v for name in self.chain.joint_names
        ]

    def full(self, values: Array) -> Array:
        """Values of the arm's joints among all joints of the model, the fingers at 0."""
        wide = np.zeros(self.model.nv)
        wide[self.index] = values
        return wide

    def torque(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Joint torques, shape (7,) [N m]."""
        tau = pin.rnea(self.model, self.data, *(self.full(x) for x in (q, qd, qdd)))
        return np.asarray(tau)[self.index]

    def tip_velocity(self, q: Array, qd: Array) -> Array:
        """Velocity of the tip's origin in the base frame, shape (3,) [m/s]."""
        pin.forwardKinematics(self.model, self.data, self.full(q), self.full(qd))
        frame = self.model.getFrameId(self.chain.tip_link)
        pin.updateFramePlacements(self.model, self.data)
        reference = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.asarray(pin.getFrameVelocity(self.model, self.data, frame, reference).linear)

    def pose(self, q: Array, link: str | None = None) -> Array:
        """Pose of a link in the base frame, of the tip where none is named, shape (4, 4)."""
        pin.framesForwardKinematics(self.model, self.data, self.full(q))
        frame = self.data.oMf[self.model.getFrameId(link or self.chain.tip_link)]
        return np.asarray(frame.homogeneous)
