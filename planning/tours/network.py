"""Stops, their configurations and the times between these, as the search kernels take them."""

from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from planning.timing.rest_to_rest import Times


class Network(NamedTuple):
    """Stops with their configurations, and the times between these.

    The stops are the goals, then the start, then the end of the tour.

    Args:
        times: Times between configurations, symmetric, shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,).
        near: Stops nearest to each stop, by least time, shape (s, k).
        least: Least times between stops, shape (s, s) [s].
        first_follower: Place at which the followers of each stop begin, shape (s + 1,).
        followers: Stops that have to come after, shape (p,).
    """

    times: Times
    first: Indices
    near: Indices
    least: Times
    first_follower: Indices
    followers: Indices


class TourState(NamedTuple):
    """A tour while it is being searched.

    Args:
        order: Stops in the order of their visit, the start first and the end last, shape (s,).
        position: Place of each stop in that order, shape (s,).
        choice: Configuration of each stop, shape (s,).
    """

    order: Indices
    position: Indices
    choice: Indices

    def copy(self) -> "TourState":
        """A copy whose arrays are its own."""
        return TourState(self.order.copy(), self.position.copy(), self.choice.copy())


class Precedence(NamedTuple):
    """Goals that have to come after others.

    Args:
        first: Place at which the followers of each stop begin, shape (s + 1,).
        followers: Numbers of stops, shape (p,).
    """

    first: Indices
    followers: Indices


def tour_state(order: Indices, choice: Indices) -> TourState:
    """The state of a tour from the order of its stops (s,) and their configurations (s,)."""
    position = np.empty_like(order)
    position[order] = np.arange(len(order))
    return TourState(order.astype(np.int64), position, choice.astype(np.int64))


def set_state(state: TourState, source: TourState) -> None:
    """Make a tour the same as another one."""
    for target, values in zip(state, source, strict=True):
        target[:] = values


def least_times(times: Times, first: Indices) -> Times:
    """Least times between stops, shape (s, s) [s].

    Args:
        times: Times between configurations, shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,).
    """
    rows = np.minimum.reduceat(times, first[:-1], axis=0)
    least: Times = np.minimum.reduceat(rows, first[:-1], axis=1)
    np.fill_diagonal(least, 0.0)
    return np.ascontiguousarray(least)


def make_network(times: Times, first: Indices, precedence: Precedence, neighbours: int) -> Network:
    """The network of stops with times between their configurations.

    Args:
        times: Shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,).
        precedence: Stops that have to come after others.
        neighbours: How many near stops moves of the search check.
    """
    least = least_times(times, first)
    apart: Array = least.astype(np.float64)
    np.fill_diagonal(apart, np.inf)
    count = min(neighbours, len(least) - 1)
    near = np.argsort(apart, axis=1, kind="stable")[:, :count]
    near = np.ascontiguousarray(near, dtype=np.int64)
    return Network(times, first, near, least, precedence.first, precedence.followers)
