"""What of a description is not read is told, and what matters comes first."""

from random import Random
from xml.etree import ElementTree

import pytest

from kinematics.readers.lint import tidy
from kinematics.urdf.urdf import parse_urdf
from tests.kinematics.samples import TREE

EXTENSIONS = (
    '<gazebo reference="hand"><material>Gazebo/Blue</material></gazebo>',
    '<transmission name="t"><type>simple</type></transmission>',
    '<ros2_control name="x" type="system"/>',
    '<gz:thing xmlns:gz="http://gazebosim.org/schema"><gz:inner/></gz:thing>',
)


def told(text: str) -> list[str]:
    """The lint of a tree with something more in it."""
    known = parse_urdf(TREE).lint
    return [line for line in tidy(parse_urdf(text).lint) if line not in tidy(known)]


def test_extensions_share_one_line_and_it_is_the_last() -> None:
    text = TREE.replace("</robot>", "".join(EXTENSIONS) + EXTENSIONS[0] + "</robot>")
    (line,) = (line for line in told(text) if "no motion depends on" in line)
    for words in ("gazebo (3)", "inner (1)", "ros2_control (1)", "thing (1)", "transmission (2)"):
        assert words in line
    lint = tidy(parse_urdf(text).lint)
    assert lint.index(line) > lint.index(next(x for x in lint if "velocity limit" in x))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('velocity="1.5"', 'velocty="1"', "'velocty' of <limit> is not read; is 'velocity' meant?"),
        ("<dynamics ", "<dynamic ", "joint 'slide': <dynamic> is not read; is 'dynamics' meant?"),
        ('<collision name="a">', '<collision name="a" group="g">',
         "link 'carriage': <collision> has group, not read"),
        ('<link name="mast"/>', '<link name="mast"><self_collision_checking/></link>',
         "link 'mast': <self_collision_checking> is not read"),
        ('<joint name="stand" type="fixed">',
         '<joint name="stand" type="fixed"><mimic joint="slide"/>', "is fixed: its <mimic>"),
        ('<axis xyz="1 2 -0.5"/>', '<axis xyz="1 2 0"/><safety_controller soft_upper_limit="1"/>',
         "'slide' has a soft_upper_limit without a soft_lower_limit"),
        ('<axis xyz="1 2 -0.5"/>', '<axis xyz="1 2 -0.5"/><calibration rising="0.1"/>',
         "calibration (1)"),
    ],
)  # fmt: skip
def test_what_is_not_read_is_told_by_name(old: str, new: str, words: str) -> None:
    assert old in TREE
    assert any(words in line for line in told(TREE.replace(old, new, 1)))


@pytest.mark.parametrize("seed", range(20))
def test_no_element_is_dropped_silently(seed: int) -> None:
    random = Random(seed)
    root = ElementTree.fromstring(TREE)
    tops = [e for e in root if e.tag in ("link", "joint")]
    places = [e for top in tops for e in top.iter() if e.tag != "geometry"]
    place, name = random.choice(places), f"thing_{random.randrange(99)}"
    if random.random() < 0.5:
        place.set(name, "1")
    else:
        place.append(ElementTree.Element(name))
    assert any(name in line for line in told(ElementTree.tostring(root, "unicode")))


def test_notes_that_differ_by_their_first_name_are_one() -> None:
    bare = [f"link {name!r} has no collision geometry: nothing is checked" for name in "abc"]
    lines = [*bare, "joint 'j' has no velocity limit", bare[0], "joint 'k' has no velocity limit"]
    assert tidy(lines) == [
        "joint 'j' has no velocity limit (the same of 'k')",
        f"{bare[0]} (the same of 'b', 'c', 'a')",
    ]
