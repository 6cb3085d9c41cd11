"""Mesh URIs, resolved among the uploaded files and nowhere else."""

from collections.abc import Mapping
from urllib.parse import unquote

from kinematics.errors import InvalidRobotDescription

_PACKAGE = "package://"
#: What xacro writes for ``file://$(find package)``, and Gazebo's models: the path says which
#: package is meant somewhere in its middle.
_ELSEWHERE = ("file://", "model://")
#: Shortest end of such a path that names a file: fewer folders say too little.
_LEAST_WORDS = 3


def resolve_mesh(uri: str, uploaded: Mapping[str, bytes]) -> bytes:
    """The bytes of the mesh that a description calls ``uri``.

    Never touches files or the network. Tried in turn: the very same key; the path after
    ``package://``; the path after the package's name; the one uploaded key that ends with that
    path or that the path ends with. Of ``file://`` and ``model://``, which say where the file was
    on another machine, the longest end of two folders at least that an uploaded key ends with.

    Args:
        uri: Name as written in the description, ``package://...``, ``file://...`` or relative.
        uploaded: Bytes by the name they were uploaded under.

    Raises:
        InvalidRobotDescription: The URI points outside of what was uploaded, or none or several
            of the uploaded names match.
    """
    path = _path(uri, "mesh URI")
    by_path: dict[str, list[str]] = {}
    for key in uploaded:
        by_path.setdefault(_path(key, "name of an uploaded mesh"), []).append(key)
    if uri in uploaded:
        return uploaded[uri]
    names = [path]
    if uri.startswith(_PACKAGE) and "/" in path:
        names.append(path.split("/", 1)[1])
    for name in names:
        if name in by_path:
            return uploaded[_single_match(uri, by_path[name], uploaded)]
    if uri.startswith(_ELSEWHERE):
        words = path.split("/")
        for start in range(1, len(words) - _LEAST_WORDS + 1):
            keys = _longer("/".join(words[start:]), by_path)
            if keys:
                return uploaded[_single_match(uri, keys, uploaded)]
    return uploaded[_single_match(uri, _by_end(names[-1], by_path), uploaded)]


def _by_end(path: str, by_path: Mapping[str, list[str]]) -> list[str]:
    """The keys whose path ends with ``path``, else those longest that ``path`` ends with.

    Not the keys that merely end alike: visual/a.obj must never stand in for collision/a.obj.
    """
    longer = _longer(path, by_path)
    if longer:
        return longer
    shorter = [other for other in by_path if other and ("/" + path).endswith("/" + other)]
    return by_path[max(shorter, key=len)] if shorter else []


def _longer(path: str, by_path: Mapping[str, list[str]]) -> list[str]:
    """The keys whose path ends with ``path``."""
    return [
        key for other, keys in by_path.items() if ("/" + other).endswith("/" + path) for key in keys
    ]


def _single_match(uri: str, keys: list[str], uploaded: Mapping[str, bytes]) -> str:
    if len(keys) == 1:
        return keys[0]
    listed = ", ".join(repr(key) for key in list(uploaded)[:20]) or "nothing"
    if keys:
        raise InvalidRobotDescription(
            f"mesh {uri!r} may be any of {', '.join(repr(key) for key in keys)}",
            hint="Upload each mesh once, under the URI the description uses.",
            uri=uri,
        )
    raise InvalidRobotDescription(
        f"mesh {uri!r} was not uploaded; uploaded: {listed}",
        hint="Send it with the upload: in `meshes` under this URI, or beside it in the archive.",
        uri=uri,
    )


def _path(uri: str, what: str) -> str:
    """The path of a URI with "." and inner ".." worked out.

    Raises:
        InvalidRobotDescription: It has another scheme, is absolute or leads out of its folder.
    """
    scheme = next((known for known in (_PACKAGE, *_ELSEWHERE) if uri.startswith(known)), "")
    text = uri.removeprefix(scheme)
    if scheme:  # three slashes are a common slip, and name the same file
        text = text.lstrip("/")
    # Percent signs are worked out for the check only: "%2e%2e" must not get past it.
    for form in (text, unquote(text)):
        if "\0" in form or "\\" in form or ":" in form or form.startswith(("/", "~")):
            raise InvalidRobotDescription(
                f"the {what} {uri!r} is not allowed: only package://, file://, model:// and "
                "relative ones are",
                hint="Nothing is read from the server's files or the network: meshes are looked "
                "up among what is uploaded.",
                uri=uri,
            )
        if _normalize(form) is None:
            raise InvalidRobotDescription(
                f"the {what} {uri!r} leads out of the upload",
                hint='Take the ".." out.',
                uri=uri,
            )
    return _normalize(text) or ""


def _normalize(path: str) -> str | None:
    words: list[str] = []
    for word in path.split("/"):
        if word == "..":
            if not words:
                return None
            words.pop()
        elif word not in ("", "."):
            words.append(word)
    return "/".join(words)
