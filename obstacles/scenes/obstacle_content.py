"""Bytes that tell an obstacle from others: hashes of scenes are made of them."""

import struct
from dataclasses import fields
from functools import cache
from typing import Protocol

import numpy as np

from kinematics.arrays import Array
from obstacles.shapes.shape import Compound, Shape

_FLOAT = struct.Struct("=d")


class PlacedShape(Protocol):
    """The fields of an obstacle."""

    @property
    def id(self) -> str:
        """Its name."""

    @property
    def shape(self) -> Shape:
        """Its solid."""

    @property
    def T_world_obstacle(self) -> Array:
        """Its pose, shape (4, 4)."""

    @property
    def margin(self) -> float:
        """Distance to be kept from it [m]."""

    @property
    def frame(self) -> str | None:
        """Its frame; None for the root frame."""


def obstacle_content(obstacle: PlacedShape) -> bytes:
    """All that an obstacle consists of, field by field."""
    parts = [f"{obstacle.id}\0".encode(), *_shape_content(obstacle.shape)]
    parts += [obstacle.T_world_obstacle.tobytes(), _FLOAT.pack(obstacle.margin)]
    if obstacle.frame is not None:
        parts.append(f"frame\0{obstacle.frame}\0".encode())
    return b"".join(parts)


def _shape_content(shape: Shape) -> list[bytes]:
    parts = [f"{type(shape).__name__}\0".encode()]
    if isinstance(shape, Compound):
        for solid, T in zip(shape.solids, shape.poses, strict=True):
            parts += [*_shape_content(solid), T.tobytes()]
        return parts
    for name in _field_names(type(shape)):
        values = getattr(shape, name)
        if type(values) is float:  # as an array of no dimensions has it
            parts.append(f"{name}()".encode() + _FLOAT.pack(values))
        else:
            values = np.asarray(values)
            parts.append(f"{name}{values.shape}".encode() + values.tobytes())
    return parts


@cache
def _field_names(shape: type[Shape]) -> tuple[str, ...]:
    return tuple(item.name for item in fields(shape))  # type: ignore[arg-type]
