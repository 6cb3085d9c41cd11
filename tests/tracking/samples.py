"""Trajectories and one-joint robots whose closed loops have closed forms."""

from dataclasses import replace

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain, Inertia, Link
from kinematics.trajectory.trajectory import Trajectory
from tests.dynamics.samples import PRISMATIC, textbook


def smooth(chain: Chain, start: Array, end: Array, duration: float = 1.0) -> Trajectory:
    """Rest to rest by a polynomial of degree five."""
    shape = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    powers = duration ** -np.arange(6.0)
    c = (np.asarray(end) - start)[:, None] * shape * powers
    c[:, 0] = start
    return Trajectory(chain.joint_names, np.array([0.0, duration]), c[None])


def constant(chain: Chain, position: Array, duration: float = 1.0) -> Trajectory:
    """A reference that stands still."""
    c = np.asarray(position, dtype=np.float64).reshape(1, -1, 1)
    return Trajectory(chain.joint_names, np.array([0.0, duration]), c)


def slider(mass: float = 2.0, friction: float = 0.0, effort: float = np.inf) -> Chain:
    """A mass on a level rail: m q_ddot + b q_dot = u."""
    link = Link("carriage", 0, np.eye(4), Inertia(mass, np.zeros(3), np.eye(3)))
    chain = textbook("slider", [PRISMATIC], np.eye(4)[None], [link], [9.81, 0.0, 0.0])
    limits = replace(chain.limits, effort=np.array([effort]))
    return replace(chain, limits=limits, viscous_friction=np.array([friction]))


def linear_response(A: Array, x: Array, times: Array) -> Array:
    """Solution of x_dot = A x at ``times`` by eigenvectors, shape (len(times), len(x))."""
    values, vectors = np.linalg.eig(A)
    weights = np.linalg.solve(vectors, x.astype(complex))
    modes = np.exp(np.outer(times, values)) * weights
    return np.real(modes @ vectors.T)
