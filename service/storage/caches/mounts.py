"""Tools that requests mount: found by name, and packed for the workers."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic_core import from_json, to_json

from armwright_wire.scenes.tool import BUILTIN_TOOLS
from kinematics.errors import InvalidLinkName, InvalidObjectName, InvalidOption
from service.storage.caches.cache_key import Mount

#: Fields of requests that hold stages.
_BLOCKS = {"stages", "fallback"}
#: Fields of requests that say what is mounted.
MOUNTING = frozenset({"tool", "tcp", "stages", "margins"})
#: What a request is asked for: its fields, or an instance of its model.
Asked = Mapping[str, Any] | BaseModel


def builtin_tool(name: str) -> bytes | None:
    """The document of a built-in tool of the usual sizes; None where there is none."""
    if name not in BUILTIN_TOOLS:
        return None
    return to_json({"name": name, "form": {"type": name}})


def robot_tools(document: bytes) -> Mapping[str, bytes]:
    """Documents of the tools that a robot is stored with, by name.

    Args:
        document: Document of the robot, JSON.
    """
    if b'"tools"' not in document:  # documents with meshes are long
        return {}
    return {tool["name"]: to_json(tool) for tool in from_json(document).get("tools") or ()}


def mount_of(asked: Asked, stored: Callable[[str], bytes]) -> Mount | None:
    """The tool and the tip of a request; None where it names neither.

    Args:
        asked: The request, which follows its model.
        stored: Finds the document of a stored tool by its name.

    Raises:
        InvalidOption: A tip is named and no tool, or two tools have one name.
        InvalidObjectName: The tip is that of an object which is not attached.
    """
    tool, tcp = _field(asked, "tool"), _field(asked, "tcp")

    def found(tool: Any) -> bytes:
        return (builtin_tool(tool) or stored(tool)) if isinstance(tool, str) else _packed(tool)

    named: dict[str, bytes] = {}
    later = [*stage_tools(_field(asked, "stages"))]
    for one in later if tool is None else [tool, *later]:
        content = found(one)
        if named.setdefault(_name_of(one), content) != content:
            raise InvalidOption(
                f"tool: two different ones are called {_name_of(one)!r}",
                hint="Give each tool a name of its own.",
            )
    others = tuple((name, named[name]) for name in sorted({_name_of(one) for one in later}))
    margins = _field(asked, "margins")
    links = tuple(sorted((_field(margins, "links") or {}).items()))
    for item in _field(asked, "attached") or ():
        name, link = _field(item, "id"), _field(item, "link")
        if name in dict(links):
            raise InvalidLinkName(
                f"margins.links: {name!r} is no link: it is attached to {link!r}",
                hint="margin is kept by what is held too; margins.objects are obstacles' own.",
                link=name,
            )
    more = others, links, _field(margins, "own") or 0.0
    document = None if tool is None else named[_name_of(tool)]
    if tool is None and tcp is None:
        return Mount(None, None, None, *more) if any(more) else None
    if tcp is None or isinstance(tcp, str):
        if document is None:
            raise InvalidOption(
                f"tcp: {tcp!r} is the tip of a tool, and the request names none",
                hint='Give tool, or {"object": id, "pose": ...} for a tip of what is held.',
            )
        return Mount(document, tcp, None, *more)
    return Mount(document, None, _held(asked, tcp), *more)


def named_tools(asked: Asked) -> list[Any]:
    """The tools that a request and its stages name; None where the request names none."""
    return [_field(asked, "tool"), *stage_tools(_field(asked, "stages"))]


def stage_tools(stages: Any) -> Iterator[Any]:
    """The tools that stages of a task name, those inside of for_each and fallback too."""
    for stage in stages if isinstance(stages, list) else ():
        if isinstance(stage, list):
            yield from stage_tools(stage)
            continue
        if _field(stage, "tool") is not None:
            yield _field(stage, "tool")
        yield from stage_tools(_field(stage, "stages"))
        yield from stage_tools(_field(stage, "fallback"))


def with_tools(content: Any, documents: Mapping[str, bytes]) -> Any:
    """A request with the documents of tools in place of their names.

    Args:
        content: The request as JSON has it, or a part of it.
        documents: Documents by name.
    """
    if isinstance(content, list):
        return [with_tools(item, documents) for item in content]
    if not isinstance(content, dict):
        return content
    changed = {
        name: with_tools(part, documents) if name in _BLOCKS else part
        for name, part in content.items()
    }
    tool = content.get("tool")
    if isinstance(tool, str) and tool in documents:
        changed["tool"] = from_json(documents[tool])
    return changed


def with_tool_names(content: Any) -> Any:
    """A part of a request, as JSON has it, with names in place of its stages' tools."""
    if isinstance(content, list):
        return [with_tool_names(item) for item in content]
    if not isinstance(content, dict):
        return content
    changed = {name: with_tool_names(content[name]) for name in _BLOCKS & content.keys()}
    tool = content.get("tool")
    return content | changed | ({} if tool is None else {"tool": _name_of(tool)})


def _name_of(tool: Any) -> str:
    return tool if isinstance(tool, str) else str(_field(tool, "name"))


def _held(asked: Asked, tcp: Any) -> bytes:
    """The attached object whose tip is meant, with the pose of the tip."""
    name, items = _field(tcp, "object"), _field(asked, "attached") or ()
    item = next((item for item in items if _field(item, "id") == name), None)
    if item is None:
        known = ", ".join(str(_field(item, "id")) for item in items) or "none"
        raise InvalidObjectName(
            f"tcp: nothing that is called {name!r} is attached",
            hint=f"Attached are: {known}.",
            name=name,
        )
    if _field(item, "pose") is None:
        raise InvalidOption(
            f"tcp: {name!r} is attached by grasp_joints: where its tip is would need the scene",
            hint="Give its pose in the frame of the link that holds it.",
        )
    place = {field: _plain(_field(item, field)) for field in ("id", "link", "pose")}
    return to_json({"attached": place, "pose": _plain(_field(tcp, "pose"))})


def _field(part: Any, name: str) -> Any:
    return part.get(name) if isinstance(part, Mapping) else getattr(part, name, None)


def _plain(part: Any) -> Any:
    return part.model_dump(exclude_none=True) if isinstance(part, BaseModel) else part


def _packed(part: Any) -> bytes:
    return to_json(_plain(part))
