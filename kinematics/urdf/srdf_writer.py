"""SRDF of a chain: its group, its named states, and the pairs of links that may touch."""

from collections.abc import Mapping
from html import escape

from kinematics.arrays import Array
from kinematics.model.chain import Chain

#: Reasons as MoveIt's files have them; another reason is written as it is.
_REASONS = {
    "adjacent": "Adjacent",
    "always": "Default",
    "same body": "Adjacent",
    "srdf": "User",
}
#: The group of the chain.
GROUP = "arm"


def srdf_text(
    chain: Chain, states: Mapping[str, Array], allowed: Mapping[tuple[str, str], str]
) -> str:
    """The SRDF of a chain as one group.

    Args:
        chain: The robot.
        states: Configurations by name, each of shape (n,) [rad or m].
        allowed: Pairs of links that may touch, each with the reason.
    """
    lines = [
        '<?xml version="1.0"?>',
        f"<robot name={_quoted(chain.name or 'robot')}>",
        f'  <group name="{GROUP}">',
        f"    <chain base_link={_quoted(chain.base_link)} tip_link={_quoted(chain.tip_link)}/>",
        "  </group>",
    ]
    for name, q in states.items():
        lines.append(f'  <group_state name={_quoted(name)} group="{GROUP}">')
        lines += [
            f"    <joint name={_quoted(joint)} value={_quoted(repr(value))}/>"
            for joint, value in zip(chain.joint_names, q.tolist(), strict=True)
        ]
        lines.append("  </group_state>")
    lines += [
        f"  <disable_collisions link1={_quoted(a)} link2={_quoted(b)} "
        f"reason={_quoted(_REASONS.get(reason, reason))}/>"
        for (a, b), reason in allowed.items()
    ]
    return "\n".join([*lines, "</robot>", ""])


def _quoted(text: str) -> str:
    return f'"{escape(text, quote=True)}"'
