"""Uploads of robots as the studio makes them of files."""

from armwright_client import DefaultLimits, RobotArchive, RobotUpload

#: URDF knows no accelerations: without a rule no uploaded robot could be planned for.
_RULES = DefaultLimits(acceleration="10 x velocity")


def robot_upload(
    file_name: str, content: bytes, tip_link: str | None
) -> RobotUpload | RobotArchive:
    """The upload of a URDF or a .zip.

    Args:
        file_name: Name whose stem becomes the robot's name.
        content: Content of the file.
        tip_link: Link that the chain ends at, for a tree with several arms.

    Raises:
        ValueError: The file is neither a URDF nor a .zip.
    """
    stem, _, suffix = file_name.rpartition(".")
    if suffix.lower() == "zip":
        if tip_link is None:
            return RobotArchive(stem, content, {"default_limits": _RULES})
        return RobotArchive(stem, content, {"default_limits": _RULES, "tip_link": tip_link})
    if suffix.lower() in ("urdf", "xml"):
        text = content.decode("utf-8")
        return RobotUpload(name=stem, urdf=text, tip_link=tip_link, default_limits=_RULES)
    if suffix.lower() == "xacro":
        raise ValueError(
            f"{file_name} is a xacro file, of which a URDF is made: expand it first "
            f"(`xacro {file_name} > robot.urdf`), and give the result"
        )
    raise ValueError(f"{file_name}: give a .urdf, or a .zip with the URDF and its meshes")
