"""Frames that stand still: the root, links before the first joint, and names for the root."""

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidLinkName
from kinematics.forward import forward
from kinematics.model.chain import Chain

#: The name of the tip's frame, where it stands at the configuration of a request.
TOOL = "tool"
#: Name of the root frame of a robot whose SRDF has no fixed virtual joint, as in MoveIt.
WORLD = "world"
#: Chains that begin this close to the root need no note [m, and as the entries of a rotation].
_SAME_FRAME = 1e-9


def frame_pose(chain: Chain, frame: str, joints: Array | None, where: str) -> Array:
    """Pose T_root_frame of a frame that a request names, shape (4, 4).

    Args:
        chain: The robot.
        frame: A link that stands still, a name of the root frame, or "tool".
        joints: Configuration at which "tool" is meant, shape (n,) [rad or m]; None where nothing
            says so.
        where: The field that names the frame.

    Raises:
        InvalidLinkName: There is no such frame, it moves, or nothing says where the tool is.
    """
    if frame == TOOL:
        if joints is None:
            raise InvalidLinkName(
                f"{where}: nothing says where the tool is",
                hint="Give one configuration (start, joints or seed_joints), or another frame.",
                frame=frame,
            )
        return forward(chain, joints)
    if frame in chain.index:
        link = chain.links[chain.index[frame]]
        if link.joint >= 0:
            raise InvalidLinkName(
                f"{where}: the link {frame!r} moves with the arm",
                hint=f"Frames are: {', '.join(frame_names(chain))}. Poses on work that a joint "
                f"carries: make a robot of the same description with base_link {frame!r}. An "
                f"obstacle that stands on {frame!r} goes into attached, with that link.",
                frame=frame,
            )
        return link.T_joint_link
    if frame in root_names(chain):
        return np.eye(4)
    raise InvalidLinkName(
        f"{where}: robot {chain.name!r} has no frame {frame!r}",
        hint=f"Frames are: {', '.join(frame_names(chain))}.",
        frame=frame,
    )


def check_default_frame(chain: Chain, frame: str | None) -> None:
    """Check that the frame of a request is one, though the request may have no value in it.

    Args:
        chain: The robot.
        frame: The frame; None where the request names none. Where the tool is matters only to what
            is meant there.

    Raises:
        InvalidLinkName: There is no such frame, or it moves.
    """
    if frame is not None and frame != TOOL:
        frame_pose(chain, frame, None, "frame")


def root_names(chain: Chain) -> tuple[str, ...]:
    """Names of the root frame that are none of a link."""
    return chain.root_aliases or (WORLD,)


def frame_names(chain: Chain) -> list[str]:
    """Frames that a request can name: links that stand still, names of the root, the tool."""
    standing = [link.name for link in chain.links if link.joint < 0]
    return [*dict.fromkeys([*standing, *root_names(chain)]), TOOL]


def root_notes(chain: Chain) -> list[str]:
    """A note where the chain begins elsewhere than in the root frame."""
    T = chain.link(chain.base_link).T_joint_link
    if np.abs(T - np.eye(4)).max() <= _SAME_FRAME:
        return []
    offset = float(np.linalg.norm(T[:3, 3]))
    cosine = min(1.0, max(-1.0, (float(np.trace(T[:3, :3])) - 1.0) / 2.0))
    note = (
        f"poses and scenes are in the frame of the root link {chain.root_link!r}, not of "
        f"{chain.base_link!r}, where the chain begins {offset:.4g} m and "
        f"{np.arccos(cosine):.4g} rad from it: name that frame for what is meant there"
    )
    return [note]


def tool_notes(chain: Chain) -> list[str]:
    """A note where a link has the name that requests mean the tip by."""
    if TOOL not in chain.index or chain.tip_link == TOOL:
        return []
    return [f"the frame {TOOL!r} of a request is the tip {chain.tip_link!r}, not the link {TOOL!r}"]
