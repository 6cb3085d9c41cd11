"""Recorded motions: rows of a file by joint and by time, with what is wrong with them told."""

from bisect import bisect_left
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from math import isfinite
from pathlib import Path
from statistics import median

from armwright_client.recordings.files import HINT, Row, read_rows
from armwright_wire.errors import InvalidArgument

#: Rows may come late by so many usual steps of time; they are sorted.
_LATE = 10.0
#: Topics and joints that a refusal names.
_SHOWN = 8
_OPTIONAL = ("velocities", "accelerations", "torques", "currents")


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded motion, or poses at rest where it has no times.

    Args:
        joint_names: Names of the n joints.
        times: Instants after the first one, ascending, m of them [s]; None where there are none.
        positions: A row of n for each instant [rad or m].
        velocities: Rows likewise [rad/s or m/s]; None where they were not recorded.
        accelerations: Rows likewise [rad/s^2 or m/s^2].
        torques: Rows likewise [N m or N].
        currents: Rows likewise, in place of torques [A].
        tip: Fields of `calibrate` that were measured with the joints: `positions`, `poses` or
            `distances`.
        notes: Notes on what was sorted or left out.
    """

    joint_names: tuple[str, ...]
    times: Sequence[float] | None
    positions: Sequence[Sequence[float]]
    velocities: Sequence[Sequence[float]] | None = None
    accelerations: Sequence[Sequence[float]] | None = None
    torques: Sequence[Sequence[float]] | None = None
    currents: Sequence[Sequence[float]] | None = None
    tip: Mapping[str, Sequence[object]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def log(self, gains: Sequence[float] | None = None) -> dict[str, object]:
        """Fields of the log that `identify` takes.

        Args:
            gains: Torque of each joint for one ampere, where currents were recorded [N m/A or N/A].

        Raises:
            InvalidArgument: There are neither torques nor currents, or currents without gains.
        """
        if self.torques is None and self.currents is None:
            raise InvalidArgument(
                "; ".join(["the recording has neither torques nor currents", *self.notes]),
                hint="Record efforts too; identification compares them with the motion.",
            )
        if self.torques is None and gains is None:
            raise InvalidArgument("currents need gains, the torque of each joint for one ampere")
        names = ["times", "positions", "velocities", "accelerations"]
        names.append("currents" if self.torques is None else "torques")
        fields = {name: getattr(self, name) for name in names}
        fields |= {"gains": gains} if self.torques is None else {}
        return {name: value for name, value in fields.items() if value is not None}


def read_recording(
    path: Path | str,
    joints: Sequence[str] | None = None,
    *,
    topic: str | None = None,
    prefix: str | None = None,
    span: tuple[float, float] | None = None,
    tip: str | None = None,
    limits: tuple[Sequence[float], Sequence[float]] | None = None,
) -> Recording:
    """Read a recorded motion, its columns in the order of a robot's joints.

    Args:
        path: A CSV, JSON, YAML, MCAP or .bag file, or the folder of a rosbag.
        joints: Names of the robot's joints; those of the file if left out.
        topic: Topic to be read, where several have these joints.
        prefix: Text before the joints' names in the file; where one fits, it is found.
        span: First and last instant that are taken, after the first of the file [s].
        tip: Topic of measurements of the tip, at whose instants joints are taken; a table has them
            as columns.
        limits: Least and largest positions of the joints [rad or m]; what is far beyond them is in
            other units, and refused.

    Raises:
        InvalidArgument: The file is malformed or holds no such motion, or several.
    """
    topics = read_rows(Path(path))
    name, names, columns, notes = _chosen(path, topics, joints, topic, prefix)
    rows = [row for row in topics[name] if set(columns) <= set(row.names)]
    if left := sum(bool(row.names) for row in topics[name]) - len(rows):
        notes.append(f"{left} messages of other joints are left out")
    rows, stamps = _in_order(path, rows, columns, notes)
    if span is not None:
        if stamps is None or not span[0] < span[1]:
            raise InvalidArgument(f"{path}: a span of {span} s needs ascending times")
        kept = [i for i, stamp in enumerate(stamps)
                if span[0] <= stamp - stamps[0] <= span[1]]  # fmt: skip
        rows, stamps = [rows[i] for i in kept], [stamps[i] for i in kept]
    if not rows:
        raise InvalidArgument(f"{path}: no row is left", hint="Give another span.")
    found = {kind: _column(path, rows, columns, kind, notes) for kind in ("positions", *_OPTIONAL)}
    positions = found.pop("positions")
    assert positions is not None
    for name, low, high, column in zip(
        names, *(limits or ((), ())), zip(*positions, strict=True), strict=False
    ):
        if max(low - min(column), max(column) - high) > high - low:
            raise InvalidArgument(
                f"{path}: positions of {name} are between {min(column):.4g} and {max(column):.4g}, "
                f"far beyond its limits {low:.4g} and {high:.4g}",
                hint="State the units: position.JOINT [deg], for example.",
            )
    times = None if stamps is None else [stamp - stamps[0] for stamp in stamps]
    measured = _tip(rows)
    if tip is not None:
        if stamps is None or tip not in topics:
            raise InvalidArgument(f"{path}: there is no topic {tip!r}, or joints have no times")
        positions, times, found = _at_instants(path, topics[tip], stamps, positions), None, {}
        measured = _tip(topics[tip])
    return Recording(names, times, positions, **found, tip=measured, notes=tuple(notes))


def _chosen(
    path: Path | str,
    topics: Mapping[str, Sequence[Row]],
    joints: Sequence[str] | None,
    topic: str | None,
    prefix: str | None,
) -> tuple[str, tuple[str, ...], tuple[str, ...], list[str]]:
    """Topic, joints, their names in it, and notes."""
    groups = dict.fromkeys(
        (name, row.names) for name, rows in topics.items() for row in rows
        if row.names and topic in (None, name)
    )  # fmt: skip
    wanted = tuple(joints or ())
    fits = {
        (name, found if wanted else f"{group[0]} ..."): group
        for name, group in groups
        for found in ([""] if not wanted else _prefixes(group, wanted, prefix))
    }
    if len(fits) > 1:
        several = (f"topic {name!r} with prefix {found!r}" for name, found in fits)
        raise InvalidArgument(
            f"{path} holds several such motions: {'; '.join(several)}",
            hint="Give topic, prefix or the names of the joints.",
        )
    if not fits:
        there = [f"{name} {', '.join(group[:_SHOWN])}".strip() for name, group in groups]
        raise InvalidArgument(
            f"{path}: there are no positions of {', '.join(wanted) or 'joints'}; there are those "
            f"of {'; '.join(there[:_SHOWN]) or 'none'}",
            hint=HINT,
        )
    ((name, found), group), *_ = fits.items()
    if not wanted:
        return name, group, group, []
    notes = [f"joints are called {found}{wanted[0]} and so on"] if found and prefix is None else []
    if group == tuple(str(i) for i in range(len(wanted))):
        return name, wanted, group, notes
    return name, wanted, tuple(found + joint for joint in wanted), notes


def _prefixes(group: Sequence[str], joints: Sequence[str], prefix: str | None) -> Collection[str]:
    if prefix is None and (
        set(joints) <= set(group) or list(group) == [str(i) for i in range(len(joints))]
    ):
        return [""]
    if prefix is not None:
        return [prefix] if {prefix + joint for joint in joints} <= set(group) else []
    ends = ({name.removesuffix(joint) for name in group if name.endswith(joint)}
            for joint in joints)  # fmt: skip
    return sorted(set.intersection(*ends))


def _in_order(
    path: Path | str, rows: list[Row], names: Sequence[str], notes: list[str]
) -> tuple[list[Row], list[float] | None]:
    """Rows by ascending stamps, and these; without stamps as they are, and None."""
    stamps = [row.stamp for row in rows]
    if not any(stamps) and rows and all(row.received is not None for row in rows):
        stamps = [row.received for row in rows]
        notes.append("messages have no stamps: times are those at which they were recorded")
    if not rows or all(stamp is None for stamp in stamps):
        return rows, None
    given = [stamp for stamp in stamps if stamp is not None and isfinite(stamp)]
    if len(given) < len(rows):
        raise InvalidArgument(f"{path}: {len(rows) - len(given)} of {len(rows)} rows have no time")
    usual = median([abs(b - a) for a, b in pairwise(given)] or [0.0])
    highest = enumerate(accumulate(given, max))
    late = [(top - given[i], i + 1) for i, top in highest if given[i] < top]
    most, number = max(late, default=(0.0, 0))
    if most > _LATE * usual:
        raise InvalidArgument(
            f"{path}: at row {number} times go back by {most:.3g} s",
            hint="The clock was set, or two motions stand in one file: part them.",
        )
    if late:
        notes.append(f"{len(late)} rows came late, by {most:.3g} s at most: they are sorted")
    order = sorted(range(len(rows)), key=given.__getitem__)
    kept: list[int] = []
    for i in order:
        if not kept or given[i] > given[kept[-1]]:
            kept.append(i)
        elif _positions(rows[i], names) != _positions(rows[kept[-1]], names):
            raise InvalidArgument(
                f"{path}: rows {kept[-1] + 1} and {i + 1} have the time {given[i]:.9g} s and "
                "other positions",
                hint="Write times with more digits, or leave one of the rows out.",
            )
    if len(kept) < len(rows):
        notes.append(f"{len(rows) - len(kept)} rows stand twice: they are left out")
    return [rows[i] for i in kept], [given[i] for i in kept]


def _positions(row: Row, names: Sequence[str]) -> list[float | None]:
    given = dict(zip(row.names, row.values.get("positions", ()), strict=False))
    return [given.get(name) for name in names]


def _column(
    path: Path | str, rows: Sequence[Row], names: Sequence[str], kind: str, notes: list[str]
) -> list[list[float]] | None:
    """Values of one kind in the order of some joints; None where not all rows have them."""
    values: list[list[float]] = []
    order: dict[tuple[str, ...], list[int]] = {}
    bad: list[tuple[int, str]] = []
    for number, row in enumerate(rows, 1):
        given = row.values.get(kind, ())
        if row.names not in order:
            order[row.names] = [row.names.index(name) for name in names]
        if len(given) == len(row.names):
            values.append([given[i] for i in order[row.names]])
            broken = [name for name, value in zip(names, values[-1], strict=True)
                      if not isfinite(value)]  # fmt: skip
            bad += [(number, f"not a number for {broken[0]}")] if broken else []
        elif not given:
            bad.append((number, "missing"))
        else:
            raise InvalidArgument(
                f"{path}: row {number} has {len(given)} {kind} for {len(row.names)} joints"
            )
    if bad and kind == "positions":
        raise InvalidArgument(
            f"{path}: positions are {bad[0][1]} in row {bad[0][0]}, and in {len(bad)} of "
            f"{len(rows)} rows",
            hint="Cut them out: with span, or in the file.",
        )
    if bad and values:
        notes.append(
            f"{kind} are {bad[0][1]} in row {bad[0][0]}, and in {len(bad)} of {len(rows)} rows: "
            "they are left out"
        )
    return None if bad else values


def _tip(rows: Iterable[Row]) -> dict[str, list[object]]:
    """Fields of `calibrate` that rows have of a tip."""
    tip: dict[str, list[object]] = {}
    for row in (row.values for row in rows):
        if "distance" in row:
            tip.setdefault("distances", []).append(row["distance"][0])
        elif "quaternion" in row:
            pose = {"position": row["point"], "quaternion_xyzw": row["quaternion"]}
            tip.setdefault("poses", []).append(pose)
        elif "point" in row:
            tip.setdefault("positions", []).append(row["point"])
    return tip


def _at_instants(
    path: Path | str,
    measured: Sequence[Row],
    stamps: Sequence[float],
    positions: Sequence[Sequence[float]],
) -> list[list[float]]:
    """Joints at the instants of measurements, between the rows about them."""
    joints = []
    for row in measured:
        time = row.stamp or row.received or 0.0
        k = min(max(bisect_left(stamps, time), 1), len(stamps) - 1)
        if not stamps[0] <= time <= stamps[-1] or k < 1:
            raise InvalidArgument(
                f"{path}: at {time:.6f} s, when the tip was measured, no joints were recorded"
            )
        share = (time - stamps[k - 1]) / (stamps[k] - stamps[k - 1])
        pairs = zip(positions[k - 1], positions[k], strict=True)
        joints.append([a + share * (b - a) for a, b in pairs])
    return joints
