"""Robot archives: a .zip with a URDF, its meshes and perhaps an SRDF, read with suspicion."""

import io
import re
import stat
import zipfile
from dataclasses import dataclass, field
from functools import partial
from pathlib import PurePosixPath

from kinematics.errors import InvalidRobotDescription
from obstacles.meshes.mesh import FILE_TYPES

#: A robot with visual and collision meshes of all its variants stays well below these.
MAX_ENTRIES = 2_000
MAX_UNPACKED = 256 * 2**20
#: Deflate reaches 1032 at most; text and meshes rarely pass 20.
MAX_RATIO = 200
#: Small files may be emptier than that.
_RATIO_FREE = 2**20
_MAX_NAME = 1_024
#: In front of each entry in the directory of a .zip.
_ENTRY_MARK = b"PK\x01\x02"
#: A mesh file name that begins by going up: most packages have urdf/ and meshes/ side by side.
_UPWARD = re.compile(
    r"""(?P<start>\bfilename\s*=\s*(?P<quote>["']))(?P<path>(\./)*\.\./[^"'<>&]*)(?P<end>(?P=quote))"""
)
_LIMITS = ("joint_limits.yaml", "joint_limits.yml")
_MESHES = tuple(f".{kind}" for kind in FILE_TYPES)
_ARCHIVES = (".zip", ".gz", ".tgz", ".tar", ".bz2", ".xz", ".7z", ".rar", ".zst", ".jar", ".3mf")
_ARCHIVE_STARTS = (
    b"PK\x03\x04",
    b"PK\x05\x06",
    b"\x1f\x8b",
    b"BZh",
    b"\xfd7zXZ\x00",
    b"7z\xbc\xaf",
)


@dataclass(frozen=True, slots=True)
class RobotArchive:
    """Content of an archive: URDF, SRDF and meshes.

    Args:
        urdf: The text of the .urdf file that is meant.
        srdf: The text of the .srdf file that belongs to it, if there is one.
        meshes: Bytes of the mesh files by their path in the archive.
        joint_limits: The text of MoveIt's joint_limits.yaml, if there is one.
        notes: Files that say something of the robot and are not read, one sentence each.
    """

    urdf: str
    srdf: str | None = None
    meshes: dict[str, bytes] = field(default_factory=dict)
    joint_limits: str | None = None
    notes: tuple[str, ...] = ()


def read_archive(
    content: bytes, urdf_path: str | None = None, srdf_path: str | None = None
) -> RobotArchive:
    """Read a robot from the bytes of a .zip; nothing is ever written to disk.

    Files that are neither URDF, SRDF, mesh nor MoveIt's joint_limits.yaml are left alone.

    Args:
        content: The archive.
        urdf_path: Path of the .urdf file that is meant, or the end of it; needed where there are
            several.
        srdf_path: Path of the .srdf file that belongs to it; where there are several, by default
            the one
            with the name of the .urdf file.

    Raises:
        InvalidRobotDescription: It is no .zip, unpacks to too much, has a name that leads out of
            it, holds another archive, has no URDF, or nothing says which one is meant.
    """
    # Counted in the bytes: listing a million entries takes longer than a whole request may.
    entries = content.count(_ENTRY_MARK)
    if entries > MAX_ENTRIES:
        raise _too_many_entries(entries)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return _read(archive, urdf_path, srdf_path)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, EOFError) as error:
        raise _archive_error(f"it can't be read: {error}") from None
    except (RuntimeError, ValueError, OSError, OverflowError) as error:
        raise _archive_error(f"it is damaged or encrypted: {error}") from None
    except Exception as error:
        # zlib and lzma have errors of their own for what is damaged inside.
        if type(error).__module__ in ("zlib", "_lzma", "struct"):
            raise _archive_error(f"it is damaged: {error}") from None
        raise


def _read(archive: zipfile.ZipFile, urdf_path: str | None, srdf_path: str | None) -> RobotArchive:
    entries = [_check_entry(entry) for entry in _entries(archive) if not entry.is_dir()]
    names = [entry.filename for entry in entries]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise _archive_error(f"{min(twice)!r} is in it twice")
    limits = [name for name in names if PurePosixPath(name).name in _LIMITS]
    wanted = [
        e for e in entries if _suffix(e) in (".urdf", ".srdf", *_MESHES) or e.filename in limits
    ]
    files: dict[str, bytes] = {}
    left = MAX_UNPACKED
    for entry in wanted:
        files[entry.filename] = _unpack(archive, entry, left)
        left -= len(files[entry.filename])
    chosen = _choose(files, ".urdf", urdf_path)
    if chosen is None:
        raise _no_urdf(names)
    folder = PurePosixPath(chosen).parent
    urdf = _UPWARD.sub(partial(_from_root, folder), _text(files, chosen))
    twin = PurePosixPath(chosen).stem
    semantics = _choose(files, ".srdf", srdf_path, twin)
    meshes = {
        name: data for name, data in files.items() if PurePosixPath(name).suffix.lower() in _MESHES
    }
    return RobotArchive(
        urdf,
        None if semantics is None else _text(files, semantics),
        meshes,
        _text(files, limits[0]) if len(limits) == 1 else None,
        (*_unread_limits(limits), *_unexpanded_srdf(names, semantics)),
    )


def _unread_limits(names: list[str]) -> list[str]:
    if len(names) < 2:
        return []
    told = ", ".join(names[:10])
    return [f"which of {told} is meant is open: none is read, give its text as joint_limits"]


def _unexpanded_srdf(names: list[str], semantics: str | None) -> list[str]:
    found = [name for name in names if name.lower().endswith(".srdf.xacro")]
    if semantics is not None or not found:
        return []
    hint = f"`xacro {found[0]} > robot.srdf`"
    return [f"there is no .srdf file in the archive, only {', '.join(found)}: expand it ({hint})"]


def _no_urdf(names: list[str]) -> InvalidRobotDescription:
    xacro = [name for name in names if PurePosixPath(name).suffix.lower() == ".xacro"]
    if not xacro:
        return _archive_error("there is no .urdf file in it", hint="Put the robot's URDF into it.")
    # The one with the shortest name is mostly the robot, the others its macros.
    name = min(xacro, key=lambda name: (len(PurePosixPath(name).name), name))
    return _archive_error(
        f"there is no .urdf file in it, only xacro files: {', '.join(xacro[:10])}",
        hint=f"Expand the robot's, say `xacro {name} > robot.urdf`, and put the result into it: a "
        "service never expands one. The command line, the client and the studio do, on your "
        "machine, of the folder.",
    )


def _from_root(folder: PurePosixPath, found: re.Match[str]) -> str:
    """A mesh name that goes up from the URDF's folder, told from the archive's root instead.

    One that leads out of the archive stays as it is, and is refused where it is looked up.
    """
    words: list[str] = list(folder.parts)
    for word in found["path"].split("/"):
        if word == ".." and not words:
            return found[0]
        words = words[:-1] if word == ".." else words + [word] * (word not in ("", "."))
    return f"{found['start']}package://{'/'.join(words)}{found['end']}"


def _entries(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    entries = archive.infolist()
    if len(entries) > MAX_ENTRIES:
        raise _too_many_entries(len(entries))
    total = sum(entry.file_size for entry in entries)
    if total > MAX_UNPACKED:
        raise _archive_error(f"it unpacks to {total} bytes, at most {MAX_UNPACKED} are taken")
    return [entry for entry in entries if not entry.filename.startswith("__MACOSX/")]


def _check_entry(entry: zipfile.ZipInfo) -> zipfile.ZipInfo:
    name = entry.filename
    if not 0 < len(name) <= _MAX_NAME or not name.isprintable() or entry.orig_filename != name:
        raise _archive_error("an entry has a name that is empty, too long or not printable")
    if "\\" in name or ":" in name or name.startswith(("/", "~")) or ".." in name.split("/"):
        raise _archive_error(
            f"the entry {name!r} leads out of it",
            hint='Take absolute paths, drive letters, backslashes and ".." out of the names.',
        )
    if stat.S_IFMT(entry.external_attr >> 16) not in (0, stat.S_IFREG):
        raise _archive_error(f"the entry {name!r} is not a regular file")
    if entry.flag_bits & 0x1:
        raise _archive_error(f"the entry {name!r} is encrypted")
    if _suffix(entry) in _ARCHIVES:
        raise _archive_error(f"the entry {name!r} is an archive itself", hint="Unpack it first.")
    if entry.file_size > max(MAX_RATIO * entry.compress_size, _RATIO_FREE):
        raise _archive_error(f"the entry {name!r} is packed more densely than any real file")
    return entry


def _suffix(entry: zipfile.ZipInfo) -> str:
    return PurePosixPath(entry.filename).suffix.lower()


def _unpack(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, left: int) -> bytes:
    """The bytes of an entry, no more than it announced and than may still be unpacked."""
    with archive.open(entry) as stream:
        data = stream.read(min(left, entry.file_size) + 1)
    if len(data) > min(left, entry.file_size):
        raise _archive_error(f"the entry {entry.filename!r} unpacks to more than it announces")
    if data.startswith(_ARCHIVE_STARTS):
        raise _archive_error(f"the entry {entry.filename!r} is an archive itself")
    return data


def _choose(
    files: dict[str, bytes], ending: str, path: str | None, twin: str | None = None
) -> str | None:
    """The name of the file with this ending that is meant; None where there is none."""
    names = [name for name in files if PurePosixPath(name).suffix.lower() == ending]
    if path is not None:
        matching = [name for name in names if f"/{name}".endswith(f"/{path.lstrip('/')}")]
    elif len(names) > 1 and twin is not None:
        matching = [name for name in names if PurePosixPath(name).stem == twin]
    else:
        matching = names
    if len(matching) > 1 or (names and not matching):
        field_name = f"{ending[1:]}_path"
        reason = "is none of its files" if path is not None and not matching else "is open"
        raise _archive_error(
            f"which {ending} file is meant {reason}: there are {', '.join(names[:10])}"
            if path is None
            else f"{field_name} {path!r} {reason}: there are {', '.join(names[:10])}",
            hint=f"Say which one in the field {field_name}.",
            candidates=names,
        )
    return matching[0] if matching else None


def _text(files: dict[str, bytes], name: str) -> str:
    try:
        return files[name].decode("utf-8-sig")
    except UnicodeDecodeError:
        raise _archive_error(f"{name!r} is not UTF-8") from None


def _too_many_entries(count: int) -> InvalidRobotDescription:
    return _archive_error(f"it has {count} entries, at most {MAX_ENTRIES} are taken")


def _archive_error(
    reason: str, hint: str | None = None, **details: object
) -> InvalidRobotDescription:
    return InvalidRobotDescription(f"the robot archive: {reason}", hint=hint, **details)
