"""Kinds of stops that a motion is proved to have."""

from typing import Literal

#: "path": the arm comes to rest along its own path; "joints": every joint brakes by itself.
StopKind = Literal["path", "joints"]
#: Those that are asked of a motion.
StopKinds = Literal["none", "path", "joints", "both"]
