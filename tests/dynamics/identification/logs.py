"""Logs of arms that pinocchio moves: friction, motors, sensors with offsets and noise."""

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from dynamics.identification.log import Log
from dynamics.model.payload import with_motors
from kinematics.arrays import Array
from kinematics.model.chain import Chain, Inertia
from tests.dynamics.samples import pinocchio_model

ARMS = ("panda", "ur5e", "iiwa14", "kr6_sixx", "puma560")


@dataclass(frozen=True)
class Truth:
    """An arm as it is, with the constant errors of its sensors."""

    chain: Chain
    offset: Array

    def torques(self, q: Array, qd: Array, qdd: Array) -> Array:
        model = pinocchio_model(self.chain)
        data = model.createData()
        rows = [pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)]
        motor = self.chain.motor_inertia * qdd * (model.armature == 0.0)
        dry = self.chain.coulomb_friction * np.tanh(qd / 0.01)
        return np.asarray(
            np.array(rows) + motor + self.chain.viscous_friction * qd + dry + self.offset
        )


def other(body: Inertia, rng: np.random.Generator) -> Inertia:
    """A body that differs from a drawing's: a heavier one with loads bolted on."""
    points = body.center_of_mass + rng.uniform(-0.08, 0.08, (4, 3))
    loads = rng.uniform(0.02, 0.15, 4) * max(body.mass, 0.2)
    mass = 1.1 * body.mass + loads.sum()
    center = (1.1 * body.mass * body.center_of_mass + loads @ points) / mass
    tensor = 1.1 * body.tensor
    for m, d in (
        (1.1 * body.mass, body.center_of_mass - center),
        *zip(loads, points - center, strict=True),
    ):
        tensor = tensor + m * (d @ d * np.eye(3) - np.outer(d, d))
    return Inertia(float(mass), center, tensor)


def real_arm(chain: Chain, seed: int) -> Truth:
    """An arm whose bodies and drives differ from what is believed."""
    rng = np.random.default_rng(seed)
    links = tuple(
        link if link.inertia is None else replace(link, inertia=other(link.inertia, rng))
        for link in chain.links
    )
    n = chain.n
    real = with_motors(
        replace(chain, links=links),
        rng.uniform(0.1, 0.8, n), rng.uniform(0.2, 4.0, n), rng.uniform(0.2, 3.0, n),
    )  # fmt: skip
    return Truth(real, rng.uniform(-0.5, 0.5, n))


def exciting(chain: Chain, seed: int, period: float, duration: float = 20.0) -> tuple[Array, ...]:
    """Times and a Fourier motion: positions, velocities and accelerations in closed form."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, period)
    k = np.arange(1, 6)
    w = 2.0 * np.pi / 10.0 * k
    a, b = rng.normal(0.0, 0.35, (2, chain.n, 5)) / np.sqrt(k)
    S, C = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q = S @ a.T + C @ b.T + rng.uniform(-0.5, 0.5, chain.n)
    qd = (C * w) @ a.T - (S * w) @ b.T
    qdd = -(S * w**2) @ a.T - (C * w**2) @ b.T
    return t, q, qd, qdd


def table(truth: Truth, seed: int, noise: float) -> str:
    """A CSV of an exciting motion: positions and efforts."""
    t, q, qd, qdd = exciting(truth.chain, seed, 0.01)
    rng = np.random.default_rng(seed)
    tau = truth.torques(q, qd, qdd) + noise * rng.standard_normal(q.shape)
    joints = truth.chain.joint_names
    names = [f"{kind}.{joint}" for kind in ("position", "effort") for joint in joints]
    rows = [",".join(map(repr, row)) for row in np.column_stack([t, q, tau]).tolist()]
    return "\n".join(["# a log", ",".join(["time", *names]), *rows])


def noisy_log(
    truth: Truth, seed: int, *, noise: float = 0.1, encoder: float = 0.0, period: float = 0.01
) -> Log:
    """A log of an exciting motion; with noise of the encoders only positions are in it."""
    rng = np.random.default_rng(1000 + seed)
    t, q, qd, qdd = exciting(truth.chain, seed, period)
    tau = truth.torques(q, qd, qdd) + noise * rng.standard_normal(q.shape)
    if encoder == 0.0:
        return Log(q, tau, t, qd, qdd)
    return Log(q + encoder * rng.standard_normal(q.shape), tau, t)
