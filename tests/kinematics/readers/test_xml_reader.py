"""Untrusted XML: what is read, what is refused, and at exactly which size."""

import re
import time
from xml.etree.ElementTree import Element

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.errors import InvalidRobotDescription
from kinematics.readers.xml_reader import (
    MAX_BYTES,
    MAX_DEPTH,
    MAX_NAME,
    attribute,
    children,
    number,
    read_document,
    read_robot,
)


def refused(text: str | bytes, words: str) -> None:
    """See that a robot's text is refused with certain words."""
    with pytest.raises(InvalidRobotDescription, match=words):
        read_robot(text, "URDF")


# --------------------------------------------------------------------------------- documents


def test_text_and_bytes_of_any_declared_encoding_give_the_same_tree() -> None:
    text = '<robot name="größe"><link name="a"/><!-- note --><?tool x?></robot>'
    for data in (
        text,
        text.encode(),
        f'<?xml version="1.0" encoding="utf-16"?>{text}'.encode("utf-16"),
    ):
        root = read_robot(data, "URDF")
        assert root.get("name") == "größe"
        assert [child.get("name") for child in children(root, "link")] == ["a"]


def test_the_own_namespace_is_dropped_and_others_with_all_inside_them() -> None:
    root = read_robot(
        '<robot xmlns="http://a" xmlns:b="http://b"><link name="one"/>'
        '<b:link name="two"><link name="three"/></b:link>'
        '<group><b:x/><link name="four"/></group></robot>',
        "URDF",
    )
    assert [element.tag for element in root.iter()] == ["robot", "link", "group", "link"]
    assert [element.get("name") for element in root.iter("link")] == ["one", "four"]


@pytest.mark.parametrize("prefix", ["xacro", "x"])
def test_xacro_is_named_however_deep_it_is(prefix: str) -> None:
    text = f'<robot xmlns:{prefix}="http://www.ros.org/wiki/xacro"><a><b><{prefix}:if/></b></a></robot>'
    refused(text, "unexpanded xacro file: it has <xacro:if>")


@pytest.mark.parametrize(
    "text",
    [
        "<robot><xacro:include filename='arm.xacro'/></robot>",  # its prefix is not declared
        b"<robot name='a'><link name='x'/><xacro:arm prefix=''/></robot>",
        "<robot><link name='${prefix}link'/></robot>",
    ],
)
def test_xacro_is_named_where_nothing_declares_it(text: str | bytes) -> None:
    with pytest.raises(InvalidRobotDescription, match="unexpanded xacro file") as raised:
        read_robot(text, "URDF")
    assert "`xacro robot.urdf.xacro > robot.urdf`" in (raised.value.hint or "")


def test_definitions_of_xacro_that_nothing_uses_are_taken_out() -> None:
    text = (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="size" value="1"/>'
        '<xacro:arg name="prefix" default=""/><link name="{}"/></robot>'
    )
    root = read_robot(text.format("arm"), "URDF")
    assert [element.tag for element in root] == ["link"]
    for use in ("${size}", "$(arg prefix)arm"):
        words = f"unexpanded xacro file: it has name={use!r} of <link>"
        refused(text.format(use), re.escape(words))


def test_white_space_before_the_declaration_is_no_fault() -> None:
    text = '\n \t<?xml version="1.0"?>\n<robot name="arm"/>'
    assert read_robot(text, "URDF").get("name") == "arm"
    assert read_robot(text.encode(), "URDF").get("name") == "arm"


def test_other_formats_are_named() -> None:
    for root in ("sdf", "mujoco", "Robot", "robots"):
        refused(f"<{root}/>", f"is <{root}>, it must be <robot>")
    assert read_document("<mujoco/>", "MJCF").tag == "mujoco"


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE robot [<!ENTITY a "b">]><robot/>',
        '<!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot/>',
        '<!DOCTYPE robot PUBLIC "x" "http://localhost/x.dtd"><robot/>',
        '<!DOCTYPE r [<!ENTITY % p SYSTEM "file:///etc/passwd"> %p;]><robot/>',
        "<!DOCTYPE robot><robot/>",
    ],
)
def test_document_types_and_entities_are_never_expanded(text: str) -> None:
    for data in (text, text.encode("utf-16")):
        refused(data, "document type or an entity")


@pytest.mark.parametrize(
    "text",
    ["", " ", "robot", "<robot", "<robot>", "<robot></link>", "<robot/><robot/>",
     "<robot a='1' a='2'/>", "<robot>&unknown;</robot>", "<a:robot/>", b"\xff\xfe",
     b"<robot name='\xff'/>", b"\xff\xfe\x00", "\ufeff",
     '<?xml version="1.0" encoding="utf-32"?><robot/>', "<robot name='\x00'/>",
     "<robot/>\x00", '<?xml version="1.0" encoding="none"?><robot/>'],
)  # fmt: skip
def test_text_that_is_not_well_formed_is_refused(text: str | bytes) -> None:
    data = text if isinstance(text, bytes) else text.encode()
    refused(data, "no well-formed XML")


@given(st.binary(max_size=60))
def test_random_bytes_are_a_robot_or_refused(data: bytes) -> None:
    for text in (data, b"<robot>" + data + b"</robot>"):
        try:
            assert read_robot(text, "URDF").tag == "robot"
        except InvalidRobotDescription as error:
            assert "URDF" in error.message  # noqa: PT017


# ------------------------------------------------------------------------------------ bounds


def nested(depth: int) -> str:
    """A robot of so many elements, each inside the one before."""
    return "<robot>" + "<a>" * (depth - 1) + "</a>" * (depth - 1) + "</robot>"


def test_depth_is_bounded_exactly() -> None:
    assert len(list(read_robot(nested(MAX_DEPTH), "URDF").iter())) == MAX_DEPTH
    refused(nested(MAX_DEPTH + 1), f"more than {MAX_DEPTH} deep")


def test_the_number_of_elements_is_bounded_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kinematics.readers.xml_reader.MAX_ELEMENTS", 40)
    fits = "<robot>" + "<a/>" * 39 + "</robot>"
    assert len(read_robot(fits, "URDF")) == 39
    refused(fits.replace("<robot>", "<robot><a/>"), "more than 40 elements")


def test_what_follows_the_last_element_allowed_is_not_parsed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("kinematics.readers.xml_reader.MAX_ELEMENTS", 10)
    text = "<robot>" + "<a/>" * 11 + " " * 200_000 + "<not closed"
    refused(text, "more than 10 elements")
    began = time.perf_counter()
    refused("<robot>" + "<a/>" * 1_000_000, "more than 10 elements")
    assert time.perf_counter() - began < 0.2


def test_the_size_is_bounded_exactly() -> None:
    shell = "<robot></robot>"
    spaces = " " * (MAX_BYTES - len(shell))
    assert read_robot(shell.replace("><", f">{spaces}<"), "URDF").tag == "robot"
    refused(shell.replace("><", f">{spaces} <"), "more than 16 MiB")


# -------------------------------------------------------------------------------- attributes


def element(**attributes: str) -> Element:
    """An element <e> of attributes."""
    return Element("e", attributes)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("", "has no 'name'"),
        ("  \t", "has no 'name'"),
        ("x" * (MAX_NAME + 1), "printable"),
        ("a\nb", "printable"),
        ("a\x1bb", "printable"),
        ("a\u202eb", "printable"),
    ],
)
def test_names_that_cannot_be_shown_are_refused(value: str, words: str) -> None:
    with pytest.raises(InvalidRobotDescription, match=words) as error:
        attribute(element(name=value), "name", "joint 'j'")
    assert "joint 'j'" in error.value.message
    assert len(error.value.message) < 250


@pytest.mark.parametrize(
    "word",
    ["nan", "inf", "-Infinity", "1_0", "0x1p3", "٣", "１", "1e999", "-1e400", "1,5", "--1", "1e",
     ".", "e5", "1.2.3", "½", "1d5", "True"],
)  # fmt: skip
def test_words_that_are_not_finite_decimal_numbers_are_refused(word: str) -> None:
    with pytest.raises(InvalidRobotDescription, match="'v' of <e> of link 'x' must be finite"):
        number(element(v=word), "v", "link 'x'")


def test_defaults_stand_for_what_is_missing_but_not_for_what_is_wrong() -> None:
    assert number(element(), "v", "", default=7.0) == 7.0
    assert number(element(v="0"), "v", "", default=7.0) == 0.0
    with pytest.raises(InvalidRobotDescription):
        number(element(v="x"), "v", "", default=7.0)
    with pytest.raises(InvalidRobotDescription, match="missing"):
        number(element(), "v", "")
