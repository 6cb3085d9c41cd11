"""Programs read and carried out by interpreters of our own, line by line."""

import json
import re
from ast import literal_eval
from typing import Any, NamedTuple

import numpy as np
import yaml

from kinematics.arrays import Array
from planning.exports.options import ExportFormat


class Do(NamedTuple):
    """Something that a program does.

    Args:
        what: "at" (where the arm has to be), "to", "fingers", "wait", "take", or the kind of an
            event.
        q: Joints, shape (n,).
        cut: Radius [m] or share of the legs by which the corner may be cut.
        value: Port and value of an event, positions of fingers, seconds, a procedure.
    """

    what: str
    q: Array | None = None
    cut: float = 0.0
    value: Any = None


def read(text: str, format_: ExportFormat) -> list[Do]:
    """What a program does, in order."""
    readers = {
        ExportFormat.URSCRIPT_MOVEJ: _urscript,
        ExportFormat.URSCRIPT_SERVOJ: _urscript,
        ExportFormat.RAPID: _rapid,
        ExportFormat.KRL: _krl,
        ExportFormat.CSV: _table,
        ExportFormat.EGM: _stream,
        ExportFormat.RSI: _stream,
    }
    if format_ in readers:
        return readers[format_](text)
    steps = (
        json.loads(text) if format_ == ExportFormat.JOINT_TRAJECTORY_JSON else yaml.safe_load(text)
    )
    return _steps(steps["steps"])


def _numbers(text: str) -> Array:
    return np.array([float(x) for x in text.split(",")])


def _urscript(text: str) -> list[Do]:
    done: list[Do] = []
    for line in text.splitlines():
        if found := re.match(r"  q_start = \[(.*)\]", line):
            done.append(Do("at", _numbers(found[1])))
        elif found := re.match(r"  movej\(\[(.*?)\], .*r=(.*)\)", line):
            done.append(Do("to", _numbers(found[1]), float(found[2])))
        elif found := re.match(r"  servoj\(\[(.*?)\]", line):
            done.append(Do("to", _numbers(found[1])))
        elif found := re.match(r"  gripper_to\((.*)\)", line):
            done.append(Do("fingers", value=_numbers(found[1])[:-1]))
        elif found := re.match(r"  set_standard_(digital|analog)_out\((\d+), (\S+)\)", line):
            kind = "signal" if found[1] == "digital" else "set"
            value = {"True": 1.0, "False": 0.0}.get(found[3])
            done.append(Do(kind, value=(found[2], float(found[3]) if value is None else value)))
        elif found := re.match(r"  while get_standard_digital_in\((\d+)\) != (\w+)", line):
            done.append(Do("wait_for", value=(found[1], float(found[2] == "True"))))
        elif found := re.match(r"  (take_\w+)\(\)", line):
            done.append(Do("take", value=found[1]))
    return done


def _stream(text: str) -> list[Do]:
    rows = np.deg2rad(literal_eval(text.partition("POSITIONS = ")[2].partition("\nif ")[0]))
    return [Do("to" if k else "at", row) for k, row in enumerate(rows)]


def single(numbers: Array) -> Array:
    """Radians of degrees that a controller reads as numbers of single precision."""
    return np.asarray(np.deg2rad(numbers.astype(np.float32).astype(np.float64)))


def _rapid(text: str) -> list[Do]:
    done: list[Do] = []
    zones = {"fine": 0.0}
    for line in text.splitlines():
        if found := re.match(r"  CONST zonedata (\w+) := \[FALSE, ([\d.]+)", line):
            zones[found[1]] = 1e-3 * float(found[2])
        elif found := re.match(r"    MoveAbsJ \[\[(.*?)\], .*, (\w+), tool0", line):
            what = "to" if any(one.what == "at" for one in done) else "at"
            done.append(Do(what, single(_numbers(found[1])), zones[found[2]]))
        elif found := re.match(r"    gripper_to (.*);", line):
            done.append(Do("fingers", value=_numbers(found[1])[:-1]))
        elif found := re.match(r"    (SetDO|SetAO|WaitDI) (\w+?)(\d*), (\S+);", line):
            kind = {"SetDO": "signal", "SetAO": "set", "WaitDI": "wait_for"}[found[1]]
            done.append(Do(kind, value=(found[3] or found[2], float(found[4]))))
        elif found := re.match(r"    (take_\w+);", line):
            done.append(Do("take", value=found[1]))
    return done


def _krl(text: str) -> list[Do]:
    done, share = list[Do](), 0.0
    for line in text.splitlines():
        if found := re.match(r"\$APO.CPTP = (\d+)", line):
            share = float(found[1]) / 200.0
        elif found := re.match(r"PTP \{(.*)\}( C_PTP)?", line):
            what = "to" if any(one.what == "at" for one in done) else "at"
            q = np.array([float(x.split()[1]) for x in found[1].split(",")])
            done.append(Do(what, single(q), share if found[2] else 0.0))
        elif found := re.match(r"gripper_to\((.*)\)", line):
            done.append(Do("fingers", value=_numbers(found[1])[:-1]))
        elif found := re.match(r"\$(AN)?OUT\[(\d+)\] = (\S+)", line):
            value = {"TRUE": 1.0, "FALSE": 0.0}.get(found[3])
            value = float(found[3]) if value is None else value
            done.append(Do("set" if found[1] else "signal", value=(found[2], value)))
        elif found := re.match(r"WAIT FOR (NOT )?\$IN\[(\d+)\]", line):
            done.append(Do("wait_for", value=(found[2], float(not found[1]))))
        elif found := re.match(r"(take_\w+)\(\)", line):
            done.append(Do("take", value=found[1]))
    return done


def _table(text: str) -> list[Do]:
    header, *rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    joints = [k for k, name in enumerate(header) if name.startswith("position.")]
    grips = [k for k, name in enumerate(header) if name.startswith("gripper.")]
    done: list[Do] = []
    opening: Array | None = None
    for row in rows:
        q = np.array([float(row[k]) for k in joints])
        now = np.array([float(row[k]) for k in grips])
        done.append(Do("to" if done else "at", q))
        if opening is not None and (now != opening).any():
            done.append(Do("fingers", value=now))
        opening = now
        if found := re.match(r"(\w+) (\S+) ==? (\S+)", row[-1]):
            done.append(Do(found[1], value=(found[2], float(found[3]))))
        elif row[-1].startswith("take_"):
            done.append(Do("take", value=row[-1]))
    return done


def _steps(steps: list[dict[str, Any]]) -> list[Do]:
    done: list[Do] = []
    for step in steps:
        ((kind, told),) = step.items()
        if kind in ("trajectory", "follow_joint_trajectory"):
            points = told.get("trajectory", told)["points"]
            rows = [np.array(point["positions"], dtype=float) for point in points]
            done += [Do("to" if done or k else "at", q) for k, q in enumerate(rows)]
        elif kind == "gripper":
            done.append(Do("fingers", value=np.array([*told["positions"].values()])))
        elif kind == "call":
            done.append(Do("take", value=told["name"]))
        elif kind in ("signal", "set", "wait_for"):
            done.append(Do(kind, value=(str(told["port"]), float(told["value"]))))
    return done
