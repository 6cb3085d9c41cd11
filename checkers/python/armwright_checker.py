"""Checker of witnesses: proves from one file that a robot's motion is free and within its limits.

It shares no line with the program that wrote the file and believes nothing in it but its premises:
joints, solids, limits and pairs that may touch, which whoever runs it compares with the robot. All
numbers are balls (python-flint, Arb): a bound holds for every real number that rounding may have
stood for. The format and the bounds are defined in docs/witness.md of Armwright.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from math import comb, isfinite, prod
from pathlib import Path
from struct import unpack
from typing import Any, NoReturn

from flint import arb, arb_mat, ctx

#: The version of the format.
VERSION = 2
#: Bits of the balls' middles.
PRECISION = 96
#: The compact form begins with this.
MAGIC = b"AWTN"
#: Lists of the compact form lie in so many others at most.
DEPTH = 16
#: Numbers lie in so many lists at most.
RANK = 3
#: A position, velocity, acceleration or jerk may exceed its limit by this share of it; a position
#: by so much [rad or m]. Time-optimal motions are on their limits, but for rounding.
LIMIT_TOLERANCE = 1e-8
#: Largest jump of position and velocity between pieces [rad or m, rad/s or m/s].
JUMP = 1e-8
#: Largest jump of the acceleration where jerk is limited [rad/s^2 or m/s^2].
ACCELERATION_JUMP = 2e-6
#: How far the motion's ends may be from start and goal [rad or m].
END = 1e-9
#: Largest entry of R'R - 1 of a joint's frame, and by how much its bounds grow for that.
ORTHONORMAL, FRAMES = 1e-11, 1 + arb(2) ** -20
#: Intervals are halved at most so often in search of an extremum.
HALVINGS = 60

Row = list[arb]
Fact = tuple[int, int, int, Row | None]


class Rejected(Exception):
    """The witness proves nothing: where it fails, and why."""


@dataclass
class Report:
    """Outcome of a check that found nothing wrong.

    Args:
        pairs: Pairs of solids that have to stay apart.
        facts: Facts that were checked.
        cells: Cells of time.
        clearance: Least gap proved, margins not taken off [m].
        unwitnessed: What the file itself says it can't prove.
    """

    pairs: int = 0
    facts: int = 0
    cells: int = 0
    clearance: float = float("inf")
    unwitnessed: list[dict[str, Any]] = field(default_factory=list)


def fail(message: str) -> NoReturn:
    """Reject the witness."""
    raise Rejected(message)


def ball(value: Any) -> arb:
    """A number of the file, exactly."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        fail(f"{value!r} is no finite number")
    return arb(value)


def index(value: Any, count: int, what: str) -> int:
    """A number of a row, from 0 to before ``count``."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
        fail(f"there is no {what} {value!r}")
    return value


def upper(value: arb) -> arb:
    """The upper end of a ball."""
    return value.upper()


def largest(values: Row) -> arb:
    """Upper end of the largest of some balls."""
    best = values[0].upper()
    for value in values[1:]:
        end = value.upper()
        best = max(best, end)
    return best


# ------------------------------------------------------------------ the compact form


class Reader:
    """Reader of the compact form: the very document that JSON would have.

    Args:
        content: The file.
    """

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def take(self, count: int) -> bytes:
        """The next bytes."""
        if count > len(self.content) - self.at:
            fail("the file ends early")
        self.at += count
        return self.content[self.at - count : self.at]

    def count(self) -> int:
        """A whole number in groups of 7 bits, the lowest first."""
        value = shift = 0
        while (byte := self.take(1)[0]) >= 128:
            value, shift = value + ((byte - 128) << shift), shift + 7
        return value + (byte << shift)

    def text(self) -> str:
        """A text behind its length."""
        return self.take(self.count()).decode(errors="surrogateescape")

    def number(self) -> float | int | None:
        """A number in as many bytes as its first one says."""
        first = self.take(1)[0]
        if first < 128:
            return first - 64
        if first < 192:
            return (first - 128) * 256 + self.take(1)[0]
        if first < 208:
            zigzag, power = self.count(), float(10 ** (first - 192))
            if zigzag >= 2**53:
                fail("a decimal is too long")
            whole = -(zigzag + 1) // 2 if zigzag % 2 else zigzag // 2
            return whole / power if power > 1 else whole
        if first == 254:
            return None
        if first != 255:
            fail(f"there are no numbers that begin with {first}")
        value: float = unpack("<d", self.take(8))[0]
        return value

    def value(self, depth: int = 0) -> Any:
        """A value of any kind."""
        kind = self.take(1)[0]
        if depth > DEPTH:
            fail("the file is nested too deep")
        if kind == 0:
            return None
        if kind == 1:
            return self.text()
        if kind == 2:
            return [self.value(depth + 1) for _ in range(self.count())]
        if kind == 3:
            rows = [(self.text(), self.value(depth + 1)) for _ in range(self.count())]
            if len(dict(rows)) != len(rows):
                fail("a field stands twice")
            return dict(rows)
        if kind != 4:
            fail(f"there are no values of kind {kind}")
        sizes = [self.count() for _ in range(self.take(1)[0])]
        if len(sizes) > RANK or 0 in sizes[1:]:
            fail("numbers are in too many lists, or in empty ones")
        if prod(sizes) > len(self.content) - self.at:
            fail("the file ends early")
        return self.table(sizes)

    def table(self, sizes: list[int]) -> Any:
        """Numbers in lists of these lengths."""
        if not sizes:
            return self.number()
        return [self.table(sizes[1:]) for _ in range(sizes[0])]


def read(content: bytes) -> Any:
    """The document of a file, compact or JSON."""
    if not content.startswith(MAGIC):
        return json.loads(content)
    reader = Reader(content[len(MAGIC) :])
    document = reader.value()
    if reader.at != len(reader.content):
        fail("something stands behind the document")
    return document


# ------------------------------------------------------------------ polynomials


def taylor(c: Row, s: arb, h: arb) -> Row:
    """Coefficients of a polynomial in x, time being s + h x."""
    row = list(c)
    for first in range(len(row) - 1):
        for i in range(len(row) - 2, first - 1, -1):
            row[i] += s * row[i + 1]
    scale = arb(1)
    for i in range(len(row)):
        row[i] *= scale
        scale *= h
    return row


def bernstein(c: Row, s: arb, h: arb) -> Row:
    """Bernstein coefficients over [s, s + h]: the polynomial is a mean of them at every instant."""
    a, k = taylor(c, s, h), len(c) - 1
    return [
        sum((a[m] * comb(i, m) / comb(k, m) for m in range(i + 1)), arb(0)) for i in range(k + 1)
    ]


def derivative(c: Row) -> Row:
    """Coefficients of a polynomial's derivative."""
    return [c[i] * i for i in range(1, len(c))] or [arb(0)]


def value(c: Row, s: arb) -> arb:
    """A polynomial's value."""
    total = arb(0)
    for factor in reversed(c):
        total = total * s + factor
    return total


def stays_below(c: Row, s: arb, h: arb, bound: arb, depth: int = 0) -> bool:
    """Whether a polynomial is proved to be at most ``bound`` all over [s, s + h]."""
    points = bernstein(c, s, h)
    if largest(points) <= bound:
        return True
    if points[0] > bound or points[-1] > bound or depth == HALVINGS:
        return False
    half = h / 2
    return stays_below(c, s, half, bound, depth + 1) and stays_below(
        c, s + half, half, bound, depth + 1
    )


# ------------------------------------------------------------------ the file


class Motion:
    """The joints' polynomials.

    Args:
        document: The witness.
        n: How many joints follow no other.
    """

    def __init__(self, document: dict[str, Any], n: int) -> None:
        self.knots = [ball(t) for t in document["knots"]]
        pieces = document["polynomials"]
        if len(self.knots) < 2 or len(pieces) != len(self.knots) - 1 or self.knots[0] != 0:
            fail("knots and polynomials do not fit")
        if not all(a < b for a, b in pairwise(self.knots)):
            fail("knots do not ascend")
        if not all(len(piece) == n for piece in pieces):
            fail(f"a piece has not the polynomials of {n} joints")
        self.pieces = [[[ball(c) for c in row] for row in piece] for piece in pieces]
        if len({len(row) for piece in self.pieces for row in piece}) != 1 or not pieces[0][0]:
            fail("polynomials are not of one length")

    def length(self, i: int) -> arb:
        """Length of a piece [s]."""
        return self.knots[i + 1] - self.knots[i]

    def check_joins(self, orders: int, jumps: list[float]) -> None:
        """Values and derivatives of one piece's end are those of the next one's begin."""
        for i, pieces in enumerate(pairwise(self.pieces)):
            for j, rows in enumerate(zip(*pieces, strict=True)):
                before, after = rows
                for order in range(orders):
                    jump = abs(value(before, self.length(i)) - value(after, arb(0)))
                    if not jump <= jumps[order]:
                        fail(f"derivative {order} of joint {j} jumps by {jump} after piece {i}")
                    before, after = derivative(before), derivative(after)

    def check_limits(self, limits: dict[str, list[Any]], n: int) -> None:
        """Every derivative that has a limit keeps it at every instant."""
        for order, quantity in enumerate(("position", "velocity", "acceleration", "jerk")):
            if len(limits[quantity]) != n:
                fail(f"limits of {quantity} are not those of {n} joints")
            for j, limit in enumerate(limits[quantity]):
                low, high = limit if order == 0 else (limit, limit)
                sides = ((1, high), (-1, low if order or low is None else -low))
                for sign, bound in sides:
                    if bound is not None:
                        self.check_limit(quantity, order, j, sign, ball(bound))

    def check_limit(self, quantity: str, order: int, j: int, sign: int, bound: arb) -> None:
        """One side of one limit of one joint."""
        most = bound + (LIMIT_TOLERANCE if order == 0 else LIMIT_TOLERANCE * bound)
        for i, piece in enumerate(self.pieces):
            c = [sign * factor for factor in piece[j]]
            for _ in range(order):
                c = derivative(c)
            if not stays_below(c, arb(0), self.length(i), most):
                fail(f"{quantity} of joint {j} is not proved below its limit in piece {i}")

    def check_end(self, name: str, wanted: list[Any], piece: int, s: arb) -> None:
        """The motion begins, or ends, where the file says."""
        if len(wanted) != len(self.pieces[0]):
            fail(f"{name} is not of as many joints")
        for j, q in enumerate(wanted):
            if not abs(value(self.pieces[piece][j], s) - ball(q)) <= END:
                fail(f"the motion misses its {name} at joint {j}")

    def stretches(self, begin: arb, end: arb) -> list[tuple[int, arb, arb]]:
        """Parts of the pieces that a cell of time covers: piece, begin and length in its time."""
        found = []
        for i, start in enumerate(self.knots[:-1]):
            low = max(start, begin)
            high = min(self.knots[i + 1], end)
            if low < high:
                found.append((i, low - start, high - low))
        return found


class Body:
    """A body, moved by the joint of its number.

    Args:
        row: The joint in the file.
        number: Its number.
        n: How many joints have polynomials of their own.
    """

    def __init__(self, row: dict[str, Any], number: int, n: int) -> None:
        if row["kind"] not in ("revolute", "prismatic"):
            fail(f"joint {number} is neither revolute nor prismatic")
        self.turns = row["kind"] == "revolute"
        self.parent = -1 if row["parent"] == -1 else index(row["parent"], number, "body before")
        self.T = transform(row["transform"])
        self.leader, self.factor, self.offset = number, arb(1), arb(0)
        if "follows" in row:
            self.leader = index(row["follows"][0], n, "joint to follow")
            self.factor, self.offset = ball(row["follows"][1]), ball(row["follows"][2])
        elif number >= n:
            fail("a joint of its own comes behind one that follows another")
        for a in range(3):
            for b in range(3):
                product = sum((self.T[k][a] * self.T[k][b] for k in range(3)), arb(0))
                if not abs(product - (a == b)) <= ORTHONORMAL:
                    fail(f"the frame of joint {number} is no rotation")


def transform(numbers: list[Any]) -> list[Row]:
    """The upper three rows of a frame."""
    if len(numbers) != 12:
        fail("a transform has not 12 numbers")
    return [[ball(x) for x in numbers[4 * k : 4 * k + 4]] for k in range(3)]


class Solid:
    """A convex solid: the core's support is its own, then a ball is added.

    Args:
        row: The solid in the file.
        bodies: How many bodies there are.
    """

    def __init__(self, row: dict[str, Any], bodies: int) -> None:
        self.name, self.kind = row["name"], row["kind"]
        self.body = -1 if row["body"] == -1 else index(row["body"], bodies, "body")
        self.T = transform(row["transform"])
        self.rounding, self.margin = ball(row["rounding"]), ball(row.get("margin", 0))
        if not (self.rounding >= 0 and self.margin >= 0):
            fail(f"solid {self.name!r} has a negative size")
        if self.kind == "hull":
            vertices: list[list[float]] = row["vertices"]
            corners = [[ball(x) for x in v] for v in vertices]
            if not corners or any(len(v) != 3 for v in corners):
                fail(f"solid {self.name!r} has no corners")
            self.corners = arb_mat(corners)
            ends = [(min(axis), max(axis)) for axis in zip(*vertices, strict=True)]
            middle = [ball((low + high) / 2) for low, high in ends]
            self.reach = largest([length([v[k] - middle[k] for k in range(3)]) for v in corners])
        elif self.kind in ("cylinder", "cone"):
            self.radius, self.half = ball(row["radius"]), ball(row["half_height"])
            if not (self.radius >= 0 and self.half >= 0):
                fail(f"solid {self.name!r} has a negative size")
            middle, self.reach = [arb(0)] * 3, length([self.radius, self.half, arb(0)])
        elif self.kind == "half-space":
            middle, self.reach = [arb(0)] * 3, arb(0)
            if self.body != -1:
                fail("a half-space moves")
        else:
            fail(f"solids of kind {self.kind!r} are not known")
        # A ball about the core: its middle in the body's frame, any point would do, and reach.
        self.center = [dot(R, middle) + R[3] for R in self.T]
        self.reach *= FRAMES

    def support(self, ways: list[Row]) -> Row:
        """How far the core goes along each of some directions of the body's frame."""
        local = [[dot([R[k] for R in self.T], d) for k in range(3)] for d in ways]
        base = [dot([R[3] for R in self.T], d) for d in ways]
        if self.kind == "hull":
            heights = (self.corners * arb_mat(local).transpose()).entries()
            count = len(ways)
            return [b + largest(heights[i::count]) for i, b in enumerate(base)]
        found = []
        for b, (x, y, z) in zip(base, local, strict=True):
            rim = self.radius * (x * x + y * y).sqrt()
            if self.kind == "cylinder":
                found.append(b + self.half * abs(z) + rim)
            else:
                found.append(b + largest([self.half * z, rim - self.half * z]))
        return found


def dot(a: Row, b: Row) -> arb:
    """Product of two rows' first three numbers."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def length(v: Row) -> arb:
    """Length of a vector; never the root of what may be below 0."""
    return upper(dot(v, v)).sqrt()


# ------------------------------------------------------------------ facts


class Cell:
    """A cell of time: each joint's value in the middle, and its Bernstein steps from there.

    Args:
        motion: The polynomials.
        bodies: The bodies.
        begin: When it begins [s].
        end: When it ends [s].
    """

    def __init__(self, motion: Motion, bodies: list[Body], begin: arb, end: arb) -> None:
        self.motion, self.bodies = motion, bodies
        parts = motion.stretches(begin, end)
        middle = (begin + end) / 2
        i = next(i for i, _, _ in reversed(parts) if motion.knots[i] <= middle)
        at = middle - motion.knots[i]
        # Any numbers would do: exact ones near the middle lose the least.
        own = [arb(float(value(c, at).mid())) for c in motion.pieces[i]]
        columns = []
        for j, q in enumerate(own):
            rows = (bernstein(motion.pieces[p][j], s, h) for p, s, h in parts)
            columns.append([point - q for row in rows for point in row])
        self.steps = [[b.factor * x for x in columns[b.leader]] for b in bodies]
        self.most = [largest([abs(x) for x in row]) for row in self.steps]
        self.frames = [self.placed(b, b.factor * own[b.leader] + b.offset) for b in bodies]

    @staticmethod
    def placed(body: Body, q: arb) -> list[Row]:
        """Frame of a body in that of the one before it."""
        if not body.turns:
            return [[*R[:3], R[3] + R[2] * q] for R in body.T]
        s, c = q.sin_cos()
        return [[R[0] * c + R[1] * s, R[1] * c - R[0] * s, R[2], R[3]] for R in body.T]

    def reach(self, solid: Solid, meeting: int, way: Row) -> tuple[Row, arb]:
        """How far a solid goes along a direction of the meeting body's frame.

        Returns:
            Bounds whose means bound it to first order, and a bound of all that is left.
        """
        path, body = list[int](), solid.body
        while body != meeting:
            path.append(body)
            body = self.bodies[body].parent
        rest, far, center = arb(0), arb(0), solid.center
        for body in path:
            most = self.most[body]
            if self.bodies[body].turns:
                lever = length([center[0], center[1], arb(0)]) + solid.reach + far
                rest += most * (far + lever * most / 2)
                far += lever * most
            else:
                far += most
            center = [dot(R, center) + R[3] for R in self.frames[body]]
        rest *= FRAMES * length(way)
        # Directions, each with an offset, are carried outwards: w.(R p + t) = (R'w).p + w.t
        w, base, tilts = way, arb(0), list[tuple[int, Row, arb]]()
        for body in reversed(path):
            F = self.frames[body]
            tilts = [(k, carried(F, v), d + dot([R[3] for R in F], v)) for k, v, d in tilts]
            base += dot([R[3] for R in F], w)
            w = carried(F, w)
            if self.bodies[body].turns:
                tilts.append((body, [w[1], -w[0], arb(0)], arb(0)))
            else:
                tilts.append((body, [arb(0)] * 3, w[2]))
        base += solid.rounding * length(way)
        if not path:
            return [solid.support([w])[0] + base], arb(0)
        ways, shifts = [], []
        for at in range(len(self.steps[0])):
            steps = [(self.steps[k][at], v, d) for k, v, d in tilts]
            ways.append([w[x] + sum((q * v[x] for q, v, _ in steps), arb(0)) for x in range(3)])
            shifts.append(base + sum((q * d for q, _, d in steps), arb(0)))
        return [h + shift for h, shift in zip(solid.support(ways), shifts, strict=True)], rest

    def meeting(self, a: int, b: int) -> int:
        """The last body that two bodies hang on, -1 for the base; a body hangs on itself."""
        while a != b:
            if a > b:
                a = self.bodies[a].parent
            else:
                b = self.bodies[b].parent
        return a

    def gap(self, a: Solid, b: Solid, way: Row | None) -> arb:
        """Lower bound of the distance of two solids all over the cell [m].

        Args:
            a: One solid.
            b: The other.
            way: Direction from a to b in the frame of the body where both meet; None along the
                normal of the half-space b.
        """
        meeting = self.meeting(a.body, b.body)
        if way is None:
            if b.kind != "half-space" or meeting != -1:
                fail(f"{b.name!r} is no half-space")
            way = [-R[2] for R in b.T]
            top = -dot([R[3] for R in b.T], way) + b.rounding * length(way)
            others, more = [top], arb(0)
        else:
            if "half-space" in (a.kind, b.kind):
                fail("only its normal parts a half-space from anything")
            others, more = self.reach(b, meeting, [-x for x in way])
        heights, rest = self.reach(a, meeting, way)
        if len(others) == 1:
            others *= len(heights)
        elif len(heights) == 1:
            heights *= len(others)
        size = dot(way, way).sqrt()
        if not size > 0:
            fail("a direction is 0")
        gap = -largest([x + y for x, y in zip(heights, others, strict=True)]) - rest - more
        return gap / size


def carried(F: list[Row], w: Row) -> Row:
    """The direction w in the axes of the frame F."""
    return [F[0][k] * w[0] + F[1][k] * w[1] + F[2][k] * w[2] for k in range(3)]


def required(solids: list[Solid], may_touch: list[list[str]]) -> set[tuple[int, int]]:
    """Pairs of solids that have to stay apart: all but those of one body and those allowed."""
    allowed = {frozenset(row[:2]) for row in may_touch}
    return {
        (a, b)
        for b in range(len(solids))
        for a in range(b)
        if solids[a].body != solids[b].body
        and frozenset((solids[a].name, solids[b].name)) not in allowed
    }


def check(document: dict[str, Any]) -> Report:
    """Check a witness.

    Args:
        document: The witness, as its JSON is read.

    Raises:
        Rejected: It proves nothing.
    """
    try:
        before, ctx.prec = ctx.prec, PRECISION
        return _check(document)
    except (KeyError, TypeError, IndexError, ValueError, AttributeError) as error:
        raise Rejected(f"the file is malformed: {error!r}") from error
    finally:
        ctx.prec = before


def _check(document: dict[str, Any]) -> Report:
    if document["format"] != "armwright-witness" or document["version"] != VERSION:
        fail(f"this is no witness of version {VERSION}")
    n = sum("follows" not in row for row in document["joints"])
    bodies = [Body(row, k, n) for k, row in enumerate(document["joints"])]
    solids = [Solid(row, len(bodies)) for row in document["solids"]]
    motion = Motion(document, n)
    smooth = any(limit is not None for limit in document["limits"]["jerk"])
    motion.check_joins(3 if smooth else 2, [JUMP, JUMP, ACCELERATION_JUMP])
    motion.check_limits(document["limits"], n)
    last = len(motion.pieces) - 1
    motion.check_end("start", document["start"], 0, arb(0))
    motion.check_end("goal", document["goal"], last, motion.length(last))
    cells = [(ball(begin), ball(end)) for begin, end in document["cells"]]
    if not all(0 <= begin < end <= motion.knots[-1] for begin, end in cells):
        fail("a cell is not within the motion")
    facts = list(_facts(document["facts"], len(solids), len(cells)))
    told = list(document["unwitnessed"])
    covered: dict[tuple[int, int], list[tuple[arb, arb]]] = {}
    for cell, a, b, _ in facts:
        covered.setdefault((min(a, b), max(a, b)), []).append(cells[cell])
    for row in told:
        if row["what"] == "pair":
            a, b = sorted(row["pair"])
            own = [cells[index(k, len(cells), "cell")] for k in row["cells"]]
            covered.setdefault((a, b), []).extend(own)
    wanted = required(solids, document["may_touch"])
    for pair in sorted(wanted):
        reached = arb(0)
        for begin, end in sorted(covered.get(pair, []), key=lambda span: float(span[0])):
            if begin <= reached and end > reached:
                reached = end
        if not reached >= motion.knots[-1]:
            names = " and ".join(repr(solids[k].name) for k in pair)
            fail(f"nothing parts solids {pair} ({names}) from {float(reached):.6g} s on")
    report = Report(len(wanted), len(facts), len(cells), unwitnessed=told)
    facts.sort(key=lambda fact: fact[0])
    for number, group in groupby(facts, key=lambda fact: fact[0]):
        moving = Cell(motion, bodies, *cells[number])
        for _, a, b, way in group:
            gap = moving.gap(solids[a], solids[b], way)
            if not gap > solids[a].margin + solids[b].margin:
                names = f"{solids[a].name!r} and {solids[b].name!r}"
                fail(f"cell {number}: {names} are not proved apart, gap {float(gap.lower()):.6g} m")
            report.clearance = min(report.clearance, float(gap.lower()))
    return report


def _facts(facts: dict[str, list[Any]], solids: int, cells: int) -> Iterator[Fact]:
    """Facts one by one: cell, the two solids, and the direction of a plane."""
    if set(facts) - {"plane", "half-space"}:
        fail("there are facts of a kind that is not known")
    for kind, rows in facts.items():
        for row in rows:
            a, b, cell, *way = row
            if len(way) != (3 if kind == "plane" else 0):
                fail("a fact has not the numbers of its kind")
            pair = index(a, solids, "solid"), index(b, solids, "solid")
            yield index(cell, cells, "cell"), *pair, [ball(x) for x in way] or None


def main(arguments: list[str] | None = None) -> int:
    """Command: 0 where all is proved, 2 where all but what the file names is, 1 where it is not."""
    paths = sys.argv[1:] if arguments is None else arguments
    if len(paths) != 1:
        sys.stderr.write("usage: armwright-checker FILE\n")
        return 3
    try:
        report = check(read(Path(paths[0]).read_bytes()))
    except (OSError, ValueError, Rejected) as error:
        sys.stdout.write(f"rejected: {error}\n")
        return 1
    sys.stdout.write(
        f"accepted: {report.pairs} pairs apart by {report.clearance:.6g} m at every instant, "
        f"{report.facts} facts in {report.cells} cells; limits and joins hold\n"
    )
    for row in report.unwitnessed:
        names = " and ".join(row.get("names", []))
        sys.stdout.write(f"not witnessed: {row['what']} ({row['count']}) {names}\n")
    return 2 if report.unwitnessed else 0


if __name__ == "__main__":
    sys.exit(main())
