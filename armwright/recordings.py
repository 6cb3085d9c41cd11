"""Recorded motions and logs of robots, from files."""

from pathlib import Path

from armwright.model import Robot, chain_of
from armwright_client.recordings.recording import Recording
from armwright_client.recordings.recording import read_recording as read_file
from kinematics.arrays import typed
from kinematics.errors import InvalidOption


@typed
def read_recording(
    robot: Robot,
    path: Path | str,
    *,
    topic: str | None = None,
    prefix: str | None = None,
    span: tuple[float, float] | None = None,
    tip: str | None = None,
) -> Recording:
    """Read a recorded motion or log of a robot from a file.

    Args:
        robot: The robot or its chain, whose joints are looked for by name.
        path: A CSV, JSON, YAML, MCAP or .bag file, or the folder of a rosbag.
        topic: Topic to be read, where several have these joints.
        prefix: Text before the joints' names in the file; where one fits, it is found.
        span: First and last instant that are taken, after the first of the file [s].
        tip: Topic of measurements of the tip, at whose instants joints are taken.

    Raises:
        InvalidOption: The file is malformed or holds no such motion, or several.
    """
    chain = chain_of(robot)
    limits = chain.limits.lower.tolist(), chain.limits.upper.tolist()
    among = {"topic": topic, "prefix": prefix, "tip": tip}
    try:
        return read_file(path, chain.joint_names, span=span, limits=limits, **among)
    except ValueError as error:
        raise InvalidOption(str(error)) from None
