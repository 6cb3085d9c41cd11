"""Checker of witnesses: proves from one file that a robot's motion is free and within its limits.

It shares no line with the program that wrote the file and believes nothing in it but its premises:
joints, solids, limits and pairs that may touch, which whoever runs it compares with the robot. All
numbers are balls (python-flint, Arb): a bound holds for every real number that rounding may have
stood for. The format and the bounds are defined in docs/witness.md of Armwright.
"""

import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import reduce
from itertools import groupby, pairwise
from math import comb, isfinite, prod
from pathlib import Path
from struct import unpack
from typing import Any, NoReturn

from flint import arb, arb_mat, arb_poly, ctx

#: The version of the format, how its compact form begins, and how deep that is nested at most.
VERSION, MAGIC, DEPTH = 2, b"AWTN", 16
#: Bits of the balls' middles.
PRECISION = 96
#: A position, velocity, acceleration or jerk may exceed its limit by this share of it; a position
#: by so much [rad or m]. Time-optimal motions are on their limits, but for rounding.
LIMIT_TOLERANCE = 1e-8
#: Largest jumps between pieces of position, velocity, and acceleration where jerk is limited.
JUMPS = (1e-8, 1e-8, 2e-6)
#: How far the motion's ends may be from start and goal [rad or m].
END = 1e-9
#: Largest entry of R'R - 1 of a frame, and by how much its bounds grow for that.
ORTHONORMAL, FRAMES = 1e-11, 1 + arb(2) ** -20
#: Intervals are halved at most so often in search of an extremum.
HALVINGS = 60

Row = list[arb]


class Rejected(Exception):
    """The witness proves nothing: where it fails, and why."""


@dataclass
class Report:
    """Outcome of a check that found nothing wrong.

    Args:
        pairs: Pairs of solids that have to stay apart.
        facts: Facts that were checked.
        cells: Cells of time.
        unwitnessed: What the file itself says it can't prove.
        clearance: Least gap proved, margins not taken off [m].
    """

    pairs: int
    facts: int
    cells: int
    unwitnessed: list[dict[str, Any]] = field(default_factory=list)
    clearance: float = float("inf")


def fail(message: str) -> NoReturn:
    """Reject the witness."""
    raise Rejected(message)


def ball(value: Any) -> arb:
    """A number of the file, exactly."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        fail(f"{value!r} is no finite number")
    return arb(value)


def size(value: Any) -> arb:
    """A number of the file that may not be negative."""
    if not ball(value) >= 0:
        fail("a solid has a negative size")
    return arb(value)


def index(value: Any, count: int, what: str, first: int = 0) -> int:
    """A number of a row, from 0, or -1, to before ``count``."""
    if isinstance(value, bool) or not isinstance(value, int) or not first <= value < count:
        fail(f"there is no {what} {value!r}")
    return value


def frame(numbers: list[Any], owner: str) -> arb_mat:
    """The frame of a joint or a solid."""
    if len(numbers) != 12:
        fail("a transform has not 12 numbers")
    rows = [[ball(x) for x in numbers[k : k + 4]] for k in (0, 4, 8)]
    R = arb_mat([row[:3] for row in rows])
    for k, x in enumerate((R.transpose() * R).entries()):
        if not abs(x - (k % 4 == 0)) <= ORTHONORMAL:
            fail(f"the frame of {owner} is no rotation")
    return arb_mat([*rows, [0, 0, 0, 1]])


def largest(values: Iterable[arb]) -> arb:
    """Upper end of the largest of some balls."""
    return reduce(arb.max, values).upper()


def length(*v: arb) -> arb:
    """Upper end of a vector's length; never the root of what may be below 0."""
    return sum((x * x for x in v), arb(0)).upper().sqrt().upper()


# ------------------------------------------------------------------ the compact form


class Reader:
    """Reader of the compact form: the very document that JSON would have.

    Args:
        content: The file.
    """

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def take(self, count: int = 1) -> bytes:
        """The next bytes."""
        if count > len(self.content) - self.at:
            fail("the file ends early")
        self.at += count
        return self.content[self.at - count : self.at]

    def count(self) -> int:
        """A whole number in groups of 7 bits, the lowest first."""
        byte = self.take()[0]
        return byte if byte < 128 else byte - 128 + (self.count() << 7)

    def text(self) -> str:
        """A text behind its length."""
        return self.take(self.count()).decode(errors="surrogateescape")

    def number(self) -> float | int | None:
        """A number in as many bytes as its first one says."""
        first = self.take()[0]
        if first < 128:
            return first - 64
        if first < 192:
            return (first - 128) * 256 + self.take()[0]
        if first < 208:
            zigzag, power = self.count(), float(10 ** (first - 192))
            if zigzag >= 2**53:
                fail("a decimal is too long")
            whole = -(zigzag + 1) // 2 if zigzag % 2 else zigzag // 2
            return whole / power if power > 1 else whole
        if first == 255:
            return float(unpack("<d", self.take(8))[0])
        return None if first == 254 else fail(f"there are no numbers that begin with {first}")

    def value(self, depth: int = 0) -> Any:
        """A value of any kind."""
        kind = self.take()[0]
        if depth > DEPTH or kind > 4:
            fail(f"the file is nested too deep, or there are no values of kind {kind}")
        if kind == 0:
            return None
        if kind == 1:
            return self.text()
        if kind == 2:
            return [self.value(depth + 1) for _ in range(self.count())]
        if kind == 3:
            rows = [(self.text(), self.value(depth + 1)) for _ in range(self.count())]
            return dict(rows) if len(dict(rows)) == len(rows) else fail("a field stands twice")
        sizes = [self.count() for _ in range(self.take()[0])]
        if len(sizes) > 3 or 0 in sizes[1:] or prod(sizes) > len(self.content) - self.at:
            fail("numbers are in too many lists or in empty ones, or the file ends early")
        return self.table(sizes)

    def table(self, sizes: list[int]) -> Any:
        """Numbers in lists of these lengths."""
        return [self.table(sizes[1:]) for _ in range(sizes[0])] if sizes else self.number()


def read(content: bytes) -> Any:
    """The document of a file, compact or JSON."""
    if not content.startswith(MAGIC):
        return json.loads(content)
    reader = Reader(content[len(MAGIC) :])
    document = reader.value()
    return document if reader.at == len(reader.content) else fail("something stands behind it")


# ------------------------------------------------------------------ polynomials


def bernstein(c: arb_poly, s: arb, h: arb, count: int) -> Row:
    """Bernstein coefficients over [s, s + h]: the polynomial is a mean of them at every instant."""
    a = c(arb_poly([s, h])).coeffs()
    return [
        sum((x * comb(i, m) / comb(count - 1, m) for m, x in enumerate(a[: i + 1])), arb(0))
        for i in range(count)
    ]


def derived(c: arb_poly, order: int) -> arb_poly:
    """A derivative of a polynomial."""
    return reduce(lambda c, _: c.derivative(), range(order), c)


def stays_below(c: arb_poly, s: arb, h: arb, bound: arb, depth: int = 0) -> bool:
    """Whether a polynomial is proved to be at most ``bound`` all over [s, s + h]."""
    points, half = bernstein(c, s, h, max(c.length(), 1)), h / 2
    if largest(points) <= bound:
        return True
    if points[0] > bound or points[-1] > bound or depth == HALVINGS:
        return False
    return all(stays_below(c, at, half, bound, depth + 1) for at in (s, s + half))


class Motion:
    """The joints' polynomials.

    Args:
        document: The witness.
        n: How many joints follow no other.
    """

    def __init__(self, document: dict[str, Any], n: int) -> None:
        self.knots, pieces = [ball(t) for t in document["knots"]], document["polynomials"]
        if len(self.knots) < 2 or len(pieces) != len(self.knots) - 1 or self.knots[0] != 0:
            fail("knots and polynomials do not fit")
        if not all(a < b for a, b in pairwise(self.knots)):
            fail("knots do not ascend")
        self.terms = len(pieces[0][0])
        if not self.terms or any({len(row) for row in piece} != {self.terms} for piece in pieces):
            fail("polynomials are not of one length")
        if any(len(piece) != n for piece in pieces):
            fail(f"a piece has not the polynomials of {n} joints")
        self.pieces = [[arb_poly([ball(c) for c in row]) for row in piece] for piece in pieces]
        self.lengths = [b - a for a, b in pairwise(self.knots)]

    def check(self, document: dict[str, Any]) -> None:
        """Pieces join, every derivative keeps its limit at every instant, and the ends fit."""
        limits, n = document["limits"], len(self.pieces[0])
        smooth = any(limit is not None for limit in limits["jerk"])
        for i, pieces in enumerate(pairwise(self.pieces)):
            for j, joined in enumerate(zip(*pieces, strict=True)):
                for order, most in enumerate(JUMPS if smooth else JUMPS[:2]):
                    before, after = (derived(c, order) for c in joined)
                    if not abs(before(self.lengths[i]) - after(0)) <= most:
                        fail(f"derivative {order} of joint {j} jumps after piece {i}")
        for order, quantity in enumerate(("position", "velocity", "acceleration", "jerk")):
            if len(limits[quantity]) != n:
                fail(f"limits of {quantity} are not those of {n} joints")
            for j, limit in enumerate(limits[quantity]):
                low, high = limit if order == 0 else (limit, limit)
                below = -low if order == 0 and low is not None else low
                for sign, bound in ((1, high), (-1, below)):
                    if bound is not None and not self.keeps(order, j, sign, ball(bound)):
                        fail(f"{quantity} of joint {j} is not proved below its limit")
        for name, i, s in (("start", 0, arb(0)), ("goal", -1, self.lengths[-1])):
            for c, q in zip(self.pieces[i], document[name], strict=True):
                if not abs(c(s) - ball(q)) <= END:
                    fail(f"the motion misses its {name}")

    def keeps(self, order: int, j: int, sign: int, bound: arb) -> bool:
        """Whether one joint keeps one side of one limit."""
        most = bound + (LIMIT_TOLERANCE if order == 0 else LIMIT_TOLERANCE * bound)
        for piece, h in zip(self.pieces, self.lengths, strict=True):
            if not stays_below(derived(piece[j] * sign, order), arb(0), h, most):
                return False
        return True


# ------------------------------------------------------------------ bodies and solids


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
        self.T = frame(row["transform"], f"joint {number}")
        self.parent = index(row["parent"], number, "body before", -1)
        self.leader, self.factor, self.offset = number, arb(1), arb(0)
        if "follows" in row:
            leader, factor, offset = row["follows"]
            self.leader = index(leader, n, "joint to follow")
            self.factor, self.offset = ball(factor), ball(offset)
        elif number >= n:
            fail("a joint of its own comes behind one that follows another")

    def placed(self, q: arb) -> arb_mat:
        """Frame in that of the body before."""
        s, c = q.sin_cos() if self.turns else (arb(0), arb(1))
        slide = 0 if self.turns else q
        return self.T * arb_mat(4, 4, [c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, slide, 0, 0, 0, 1])


class Solid:
    """A convex solid: the core's support is its own, then a ball is added.

    Args:
        row: The solid in the file.
        bodies: How many bodies there are.
    """

    def __init__(self, row: dict[str, Any], bodies: int) -> None:
        self.name, self.kind = row["name"], row["kind"]
        self.T = frame(row["transform"], f"solid {self.name!r}")
        self.body = index(row["body"], bodies, "body", -1)
        self.rounding, self.margin = size(row["rounding"]), size(row.get("margin", 0))
        middle, self.reach = [arb(0)] * 3, arb(0)
        if self.kind == "hull":
            self.corners = [[ball(x) for x in v] for v in row["vertices"]]
            if not self.corners or any(len(v) != 3 for v in self.corners):
                fail(f"solid {self.name!r} has no corners")
            axes = zip(*row["vertices"], strict=True)
            middle = [ball((min(axis) + max(axis)) / 2) for axis in axes]
            self.reach = largest(length(*map(arb.__sub__, v, middle)) for v in self.corners)
        elif self.kind in ("cylinder", "cone"):
            self.radius, self.half = size(row["radius"]), size(row["half_height"])
            self.reach = length(self.radius, self.half)
        elif self.kind != "half-space":
            fail(f"solids of kind {self.kind!r} are not known")
        elif self.body != -1:
            fail("a half-space moves")
        # A ball about the core: its middle in the body's frame, any point would do, and reach.
        self.center = self.T * arb_mat([[x] for x in (*middle, arb(1))])
        self.reach *= FRAMES

    def support(self, ways: list[Row]) -> Row:
        """How far the core goes along each of some directions of its own frame."""
        if self.kind == "hull":
            # Corners that are too far below along one direction for all others are left out.
            apart = largest(length(*map(arb.__sub__, way, ways[0])) for way in ways)
            heights = [dot(ways[0], v) for v in self.corners]
            low = reduce(arb.max, heights) - 2 * self.reach * apart
            near = [v for v, x in zip(self.corners, heights, strict=True) if not x < low]
            return [largest(row) for row in (arb_mat(ways) * arb_mat(near).transpose()).tolist()]
        found = []
        for x, y, z in ways:
            rim, end = self.radius * length(x, y), self.half * z
            found.append(rim + abs(end) if self.kind == "cylinder" else largest([end, rim - end]))
        return found


def dot(a: Row, b: Row) -> arb:
    """Product of two rows' first three numbers."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


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
        middle, own, columns = (begin + end) / 2, list[arb](), list[Row]()
        parts = [
            (piece, start, max(start, begin), min(stop, end))
            for piece, (start, stop) in zip(motion.pieces, pairwise(motion.knots), strict=True)
            if start < end and begin < stop
        ]
        used, since, _, _ = [part for part in parts if part[1] <= middle][-1]
        for j, c in enumerate(used):
            # Any number would do: an exact one near the middle loses the least.
            q = arb(float(c(middle - since).mid()))
            points = [
                bernstein(piece[j], low - start, high - low, motion.terms)
                for piece, start, low, high in parts
            ]
            own.append(q)
            columns.append([point - q for row in points for point in row])
        self.bodies, self.count = bodies, len(columns[0])
        self.steps = [[b.factor * x for x in columns[b.leader]] for b in bodies]
        self.most = [largest(map(abs, row)) for row in self.steps]
        self.frames = [b.placed(b.factor * own[b.leader] + b.offset) for b in bodies]

    def reach(self, solid: Solid, meeting: int, way: Row) -> tuple[Row, arb]:
        """How far a solid goes along a direction of the meeting body's frame.

        Returns:
            Bounds whose means bound it to first order, and a bound of all that is left.
        """
        path, body = list[int](), solid.body
        rest, far, center = arb(0), arb(0), solid.center
        while body != meeting:
            path.append(body)
            most = self.most[body]
            if self.bodies[body].turns:
                lever = length(center[0, 0], center[1, 0]) + solid.reach + far
                rest += most * (far + lever * most / 2)
                far += lever * most
            else:
                far += most
            center = self.frames[body] * center
            body = self.bodies[body].parent
        # The direction, then its change by each joint, all with an offset: a row (w, e) times a
        # frame is what it is in that frame.
        rows = [[*way, arb(0)]]
        for body in reversed(path):
            rows = (arb_mat(rows) * self.frames[body]).tolist()
            x, y, z, _ = rows[0]
            turns = self.bodies[body].turns
            rows.append([y, -x, arb(0), arb(0)] if turns else [arb(0), arb(0), arb(0), z])
        steps = zip(*(self.steps[body] for body in reversed(path)), strict=True)
        factors = [[arb(1), *row] for row in steps] if path else [[arb(1)]]
        ways = (arb_mat(factors) * arb_mat(rows) * solid.T).tolist()
        heights = solid.support([row[:3] for row in ways])
        round_ = solid.rounding * length(*way)
        found = [h + row[3] + round_ for h, row in zip(heights, ways, strict=True)]
        return found, rest * FRAMES * length(*way)

    def meeting(self, a: int, b: int) -> int:
        """The last body that two bodies hang on, -1 for the base; a body hangs on itself."""
        while a != b:
            a, b = min(a, b), self.bodies[max(a, b)].parent
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
        if (way is None) is not (b.kind == "half-space") or a.kind == "half-space":
            fail("along its normal, and only so, a half-space is parted: it is no half-space")
        if way is None:
            way = [-b.T[k, 2] for k in range(3)]
            plane = dot([b.T[k, 3] for k in range(3)], [-x for x in way])
            others, more = [plane + b.rounding * length(*way)], arb(0)
        else:
            others, more = self.reach(b, meeting, [-x for x in way])
        heights, rest = self.reach(a, meeting, way)
        count = max(len(heights), len(others))
        both = zip(heights * (count // len(heights)), others * (count // len(others)), strict=True)
        if not dot(way, way) > 0:
            fail("a direction is 0")
        return -(largest(x + y for x, y in both) + rest + more) / dot(way, way).sqrt()


# ------------------------------------------------------------------ all of it


def check(document: dict[str, Any]) -> Report:
    """Check a witness.

    Args:
        document: The witness, as its JSON is read.

    Raises:
        Rejected: It proves nothing.
    """
    try:
        with ctx.workprec(PRECISION):
            return _check(document)
    except (KeyError, TypeError, IndexError, ValueError, AttributeError) as error:
        raise Rejected(f"the file is malformed: {error!r}") from error


def _check(document: dict[str, Any]) -> Report:
    if document["format"] != "armwright-witness" or document["version"] != VERSION:
        fail(f"this is no witness of version {VERSION}")
    n = sum("follows" not in row for row in document["joints"])
    bodies = [Body(row, k, n) for k, row in enumerate(document["joints"])]
    solids = [Solid(row, len(bodies)) for row in document["solids"]]
    motion = Motion(document, n)
    motion.check(document)
    cells = [(ball(begin), ball(end)) for begin, end in document["cells"]]
    if not all(0 <= begin < end <= motion.knots[-1] for begin, end in cells):
        fail("a cell is not within the motion")
    facts, covered = [], dict[tuple[int, int], list[tuple[arb, arb]]]()
    told: list[dict[str, Any]] = list(document["unwitnessed"])
    open_ = [(*row["pair"], k) for row in told if row["what"] == "pair" for k in row["cells"]]
    for kind, rows in {**document["facts"], "open": open_}.items():
        if kind not in ("plane", "half-space", "open") or "open" in document["facts"]:
            fail(f"facts {kind!r} are not known")
        for a, b, number, *way in rows:
            if len(way) != (3 if kind == "plane" else 0):
                fail("a fact has not the numbers of its kind")
            pair = index(a, len(solids), "solid"), index(b, len(solids), "solid")
            k = index(number, len(cells), "cell")
            covered.setdefault((min(pair), max(pair)), []).append(cells[k])
            if kind != "open":
                facts.append((k, *pair, [ball(x) for x in way] or None))
    report = Report(_check_cover(document, solids, covered), len(facts), len(cells), told)
    facts.sort(key=lambda fact: fact[0])
    for number, group in groupby(facts, key=lambda fact: fact[0]):
        cell = Cell(motion, bodies, *cells[number])
        for _, a, b, way in group:
            gap = cell.gap(solids[a], solids[b], way)
            if not gap > solids[a].margin + solids[b].margin:
                names = f"{solids[a].name!r} and {solids[b].name!r}"
                fail(f"cell {number}: {names} are not proved apart, gap {float(gap.lower()):.6g} m")
            report.clearance = min(report.clearance, float(gap.lower()))
    return report


def _check_cover(
    document: dict[str, Any],
    solids: list[Solid],
    covered: dict[tuple[int, int], list[tuple[arb, arb]]],
) -> int:
    """Cells cover all of time for every pair but those of one body and those allowed."""
    allowed, pairs = {frozenset(row[:2]) for row in document["may_touch"]}, 0
    for b, two in enumerate(solids):
        for a, one in enumerate(solids[:b]):
            if one.body == two.body or frozenset((one.name, two.name)) in allowed:
                continue
            pairs, reached = pairs + 1, arb(0)
            for begin, end in sorted(covered.get((a, b), []), key=lambda span: float(span[0])):
                if begin <= reached < end:
                    reached = end
            if not reached >= document["knots"][-1]:
                fail(f"nothing parts solids {a} and {b}, {one.name!r} and {two.name!r}, all along")
    return pairs


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
