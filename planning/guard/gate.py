"""The gate: motions that others make are proved together with the stop behind them, or refused.

What is accepted is proved from the state in which it begins to the instant up to which it is
accepted, and from there to rest. Where that can't be, the last stop that was accepted stays what
the arm has. Searches here only choose what is proved next: what decides is the proof alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidObjectName, InvalidOption
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory, concatenate, stay
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from planning.guard.faults import Look, first_fault, hit_at, look_at, shifted, sound_stops
from planning.guard.proposals import AT_REST, Proposal
from planning.proof.certificate import Certificate
from planning.proof.limits.limit_uses import Violation
from planning.proof.limits.limits import QUANTITIES
from planning.stops.certificate import StopCertificate, Surroundings, check_kind, state_jumps
from planning.stops.family_proof import Worst, prove_family
from planning.stops.stop_family import StopFamily, braking_motion, state_at
from planning.timing.jerk.state_to_state import JointState
from planning.values.limits import RATIO_TOLERANCE, MotionLimits, position_excess
from planning.values.preferences import StopKinds

#: Scales tried where limits alone do not name one.
_SCALES = (0.75, 0.5, 0.25, 0.1)
#: Ends of a prefix that are looked at, and those of them that are proved at most.
_CUTS = 32
_PROOFS = 3
#: Halvings between a scale that looks sound and one that does not.
_BISECTIONS = 3
#: A prefix shorter than this is none [s].
_SHORTEST = 2e-3
#: A pair that begins nearer than its margin may come nearer by this [m].
_NEARER = 1e-6
#: Longest time between a state and the begin of a proposal [s].
_MAX_LATENCY = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class GuardStop:
    """The stop behind a motion.

    Args:
        trajectory: From where the motion ends, or is cut, to rest.
        certificate: Certificate of it, and of the motion before it.
        stops: Stops from any instant of the motion.
        number: Number of the proposal that it belongs to; 0 where the arm had no other.
    """

    trajectory: Trajectory
    certificate: Certificate
    stops: StopCertificate
    number: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """Answer of the gate.

    Args:
        accepted_until: Instant up to which the motion may be run, 0 for not at all [s].
        scale: Share of the proposed speed at which it was proved, 0 where it is refused.
        trajectory: The motion that was proved, up to there; None where it is refused.
        stop: The stop that the arm has: behind this motion, or the last that was accepted.
        violations: Faults of the proposal as it was made, none where it is accepted whole.
        notes: Notes on the state.
    """

    accepted_until: float
    scale: float
    trajectory: Trajectory | None
    stop: GuardStop
    violations: tuple[Violation, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def clearance(self) -> float:
        """Least clearance, a bound for motion and stop [m]; ``stop.stops`` has earlier stops'."""
        return self.stop.certificate.min_clearance

    @property
    def pair(self) -> tuple[str, str] | None:
        """The pair that has it."""
        return self.stop.certificate.clearance_pair


@dataclass(frozen=True, slots=True, eq=False)
class Running:
    """The motion that the arm has: what was accepted last, and its stop.

    Args:
        motion: From the begin of the proposal to rest.
        stop: The stop behind it.
        elapsed: The latest instant of the motion that was told [s].
    """

    motion: Trajectory
    stop: GuardStop
    elapsed: float = 0.0


class Guard:
    """Gate for the motions of one arm: it keeps the robot, the scene and the stop accepted last.

    Args:
        robot: The robot with its geometry.
        scene: The obstacles.
        stop: "path" where the arm stops on its path, "joints" where every joint brakes by itself,
            "both" where either may be.
        margin: Distance to keep from obstacles beyond their own margins [m].
        limits: Limits in place of the robot's.
        tracking: How far a state may be from the motion that the arm has [rad or m].
        chain: Chain with more frames that twists may name; the robot's where None.

    Raises:
        InvalidOption: There is no such stop, or nothing is known of the robot's collisions.
        MissingLimit: The acceleration of a joint has no limit.
    """

    def __init__(
        self,
        robot: RobotGeometry,
        scene: Scene,
        stop: StopKinds = "path",
        *,
        margin: float = 0.0,
        limits: MotionLimits | None = None,
        tracking: float = 0.05,
        chain: Chain | None = None,
    ) -> None:
        check_kind(stop)
        if stop != "path" and not robot.has_solids:
            raise InvalidOption(
                f"stops {stop!r} leave the path, and robot {robot.chain.name!r} has no solids",
                hint='Give the robot solids, or take stops "path".',
            )
        self.kind: StopKinds = stop
        self.tracking, self.count = tracking, 0
        self.running: Running | None = None
        self.chain = chain or robot.chain
        wanted = limits or MotionLimits()
        wanted.check(robot.chain)
        self._set(Surroundings(robot, scene, margin, wanted))
        self.braking = self.around.braking

    def _set(self, around: Surroundings) -> None:
        self.around = around
        self._checker = Checker.of(around.robot, around.scene, around.margin)

    @property
    def scene(self) -> Scene:
        """The obstacles."""
        return self.around.scene

    def propose(
        self,
        state: JointState,
        proposal: Proposal,
        latency: float = 0.0,
        *,
        elapsed: float | None = None,
        scene_hash: str | None = None,
        exact: bool = False,
    ) -> Verdict:
        """Prove a proposal and the stop behind it, as much of it as can be.

        Args:
            state: State of the arm.
            proposal: The motion.
            latency: Time from the state to the begin of the proposal [s]. Until then the arm goes
                on: with the motion it has where ``elapsed`` is given, else at its acceleration.
            elapsed: Time since the motion accepted last began, when the state was measured [s].
            scene_hash: Hash of the scene that the proposal was made for.
            exact: Whether the first instant of a collision is told, which takes longer.

        Raises:
            InvalidRobotState: The state has another number of joints.
            InvalidTrajectory: The proposal is none of this robot's.
            InvalidOption: A number is out of its range, or nothing runs of which time elapsed.
        """
        self.around.robot.chain.configuration(state.position, "state.positions")
        if not 0.0 <= latency <= _MAX_LATENCY:
            raise InvalidOption(
                f"latency is {latency} s", hint=f"Give a time from 0 to {_MAX_LATENCY:g} s."
            )
        if elapsed is not None and not 0.0 <= elapsed < np.inf:
            raise InvalidOption(
                f"elapsed is {elapsed} s", hint="Give the time since the accepted motion began."
            )
        self.count += 1
        begun, lead, faults = self._begin(state, latency, elapsed)
        if scene_hash is not None and scene_hash != self.scene.content_hash:
            message = "the proposal was made for another scene"
            details = {"given": scene_hash, "scene_hash": self.scene.content_hash}
            faults.append(Violation("scene", 0.0, message, details))
        attempt = _Attempt(self, begun, lead, proposal)
        return attempt.verdict(faults, exact=exact)

    def change(
        self,
        *,
        add: Sequence[Obstacle] = (),
        move: Mapping[str, Array] | None = None,
        remove: Sequence[str] = (),
        elapsed: float = 0.0,
    ) -> Certificate | None:
        """Change the scene, and prove what is left of the motion that the arm has in it.

        Args:
            add: Obstacles.
            move: Poses by obstacle, each of shape (4, 4).
            remove: Obstacles to take out, by name.
            elapsed: Time since that motion began [s].

        Returns:
            Certificate of the rest of the motion and its stop: not verified where the stop is void.
            None where nothing was accepted yet.

        Raises:
            InvalidObjectName: There is no such obstacle.
            InvalidScene: There is one of that name already.
        """
        known = dict.fromkeys(self.scene.ids)
        for name in (*remove, *(move or {})):
            if name not in known:
                raise InvalidObjectName(
                    f"there is no obstacle {name!r} in the scene",
                    hint=f"There are: {', '.join(known) or 'none'}.",
                )
        kept = [
            replace(one, T_world_obstacle=move[one.id]) if move and one.id in move else one
            for one in self.scene.obstacles
            if one.id not in set(remove)
        ]
        self._set(self.around._replace(scene=replace(self.scene, obstacles=(*kept, *add))))
        return self._prove_running(elapsed)

    def _prove_running(self, elapsed: float) -> Certificate | None:
        """Certificate in a changed scene of what is left of the motion that the arm has."""
        if self.running is None:
            return None
        motion = rest_of(self.running.motion, elapsed)
        proof, stops = self.prove(motion, self.around, motion)
        self.running = replace(
            self.running,
            stop=replace(self.running.stop, certificate=proof, stops=stops),
            elapsed=max(elapsed, self.running.elapsed),
        )
        if proof.verified and not stops.proved:
            return replace(proof, verified=False)
        return proof

    def _begin(
        self, state: JointState, latency: float, elapsed: float | None
    ) -> tuple[Array, Trajectory | None, list[Violation]]:
        """State (3, n) in which a proposal begins, what leads there, and faults of the state."""
        rows, faults, names = state.rows, [], self.around.robot.chain.joint_names
        if elapsed is not None:
            if self.running is None:
                raise InvalidOption(
                    "no motion was accepted yet of which time could have elapsed",
                    hint="Leave elapsed out.",
                )
            motion = self.running.motion
            if elapsed < self.running.elapsed:
                message = f"the state is stale: {self.running.elapsed:.6g} s had elapsed before"
                faults.append(Violation("stale", 0.0, message, {"elapsed": elapsed}))
            off = np.abs(rows[0] - state_at(motion, min(elapsed, motion.duration))[0])
            if off.max() > self.tracking:
                j = int(off.argmax())
                message = f"joint {names[j]!r} is {off[j]:.6g} off the motion that the arm has"
                details = {"joint": names[j], "jump": float(off[j]), "limit": self.tracking}
                faults.append(Violation("state", 0.0, message, details))
            self.running = replace(self.running, elapsed=max(elapsed, self.running.elapsed))
            at = elapsed + latency
            # What is proved already need not be again, unless the scene has changed since.
            stop, lead = self.running.stop, None
            if latency > 0.0 and not (stop.certificate.verified and stop.stops.proved):
                left = rest_of(motion, elapsed)
                lead = left if left.duration <= latency else left.split(latency)[0]
            if at < motion.duration:
                return state_at(motion, at), lead, faults
            return np.stack([motion.end, 0.0 * motion.end, 0.0 * motion.end]), lead, faults
        if latency == 0.0 or np.abs(rows[1:]).max() == 0.0:
            return rows, None, faults
        c = np.stack([rows[0], rows[1], 0.5 * rows[2]], axis=1)
        lead = Trajectory(names, np.array([0.0, latency]), c[None])
        return state_at(lead), lead, faults

    def prove(
        self, motion: Trajectory, around: Surroundings, stopped: Trajectory
    ) -> tuple[Certificate, StopCertificate]:
        """Certificates of a motion that ends at rest, and of stops from any instant of a part."""
        proof = around.certify(motion)
        worst = Worst(0.0, 0.0, proof.clearance_pair, proof.min_clearance)
        # At full speed to the end of the motion at the latest, which keeps all limits.
        along = StopCertificate(self.kind, proof.verified, worst, stopped.duration)
        if self.kind == "path" or not proof.verified:
            return proof, along
        family = StopFamily(stopped, self.braking)
        found = prove_family(family, around.robot, around.scene, around.margin, sharp=False)
        longest = float(family.durations(family.cells(0.01)).max())
        longest = max(longest, stopped.duration) if self.kind == "both" else longest
        return proof, StopCertificate(self.kind, found.proved, found.worst, longest, found.message)

    def around_start(self, q: Array) -> tuple[Surroundings, Checker, list[Violation], list[str]]:
        """Surroundings for a begin at q (n,): what is nearer than its margin there may stay so."""
        around, checker = self.around, self._checker
        if checker.valid(q):
            return around, checker, [], []
        near, margins, notes = checker.gradient(q, 0.0), dict[str, float](), list[str]()
        own = {one.id: one.margin + around.margin for one in self.scene.obstacles}
        for row, short in zip(near.pairs.tolist(), near.distances.tolist(), strict=True):
            pair = checker.model.pair_name(row)
            name = next((one for one in pair if one in own), None)
            distance = -np.inf if name is None else short + own[name] - _NEARER
            if name is None or distance <= 0.0:
                return around, checker, [fault for fault in [hit_at(q, 0.0, checker)] if fault], []
            margins[name] = min(distance, margins.get(name, np.inf))
        for name, distance in margins.items():
            notes.append(
                f"the proposal begins {own[name] - distance:.6g} m inside the margin of {name!r}, "
                "and was held to come no nearer"
            )
        obstacles = tuple(
            replace(one, margin=margins.get(one.id, own[one.id])) for one in self.scene.obstacles
        )
        relaxed = around._replace(scene=replace(self.scene, obstacles=obstacles), margin=0.0)
        return relaxed, Checker.of(relaxed.robot, relaxed.scene, 0.0), [], notes


class _Attempt:
    """One proposal before the gate.

    Args:
        guard: The gate.
        begun: State that the proposal begins in, shape (3, n).
        lead: What the arm does until then; None where that is proved already.
        proposal: The proposal.
    """

    def __init__(
        self, guard: Guard, begun: Array, lead: Trajectory | None, proposal: Proposal
    ) -> None:
        self._guard, self._begun, self._lead, self._proposal = guard, begun, lead, proposal
        q = lead.start if lead is not None else begun[0]
        self._around, self._checker, self._overlaps, self._notes = guard.around_start(q)
        self._chain = guard.around.robot.chain

    def verdict(self, faults: list[Violation], *, exact: bool) -> Verdict:
        """The answer, with faults of the state."""
        motion = self._motion(1.0)
        assert motion is not None
        faults = [*faults, *self._state_faults(motion), *self._overlaps]
        refused, found = bool(faults), list(faults)
        whole = self._with_stop(motion)
        look = look_at(whole, self._around, self._checker)
        if not look.faults and not refused:
            accepted, missing = self._accept(motion, whole, 1.0)
            if accepted is not None:
                return accepted
            found += missing
            first = missing[0]
            if first.kind != "stop":
                at = first.time + self._lead_time
                look = look._replace(blocked=min(look.blocked, at), fast=min(look.fast, at))
        else:
            found += shifted(look.faults, -self._lead_time)
        if exact and any(fault.kind == "collision" for fault in look.faults):
            proof, _ = self._guard.prove(whole, self._around, whole)
            if proof.violation is not None and proof.violation.kind == "collision":
                found = [fault for fault in found if fault.kind != "collision"]
                found.append(first_fault(proof, -self._lead_time))
        told = tuple(sorted(found, key=lambda fault: fault.time))
        if not refused:
            less = self._slower(motion, look) or self._prefix(motion, look)
            if less is not None:
                return replace(less, violations=told)
        return Verdict(0.0, 0.0, None, self._present_stop(), told, tuple(self._notes))

    @property
    def _lead_time(self) -> float:
        return 0.0 if self._lead is None else self._lead.duration

    def _motion(self, scale: float) -> Trajectory | None:
        """The motion at a scale; None where it can't be run at that."""
        try:
            return self._proposal.motion(self._guard.chain, self._begun, self._guard.braking, scale)
        except InvalidOption:
            if scale == 1.0:
                raise
            return None

    def _state_faults(self, motion: Trajectory) -> list[Violation]:
        """Faults of the state itself, and of a motion that does not begin in it."""
        limits, names, faults = self._chain.limits, self._chain.joint_names, list[Violation]()
        q = self._begun[0]
        out = np.maximum(limits.lower - q, q - limits.upper)
        j = int(np.nan_to_num(out, nan=-np.inf).argmax())
        if out[j] > RATIO_TOLERANCE:
            limit = float(limits.lower[j] if q[j] < limits.lower[j] else limits.upper[j])
            details = {"joint": names[j], "value": float(q[j]), "limit": limit}
            message = f"the state: {position_excess(names[j], float(q[j]), limit)}"
            faults.append(Violation("position", 0.0, message, details))
        # Where a jerk is named the acceleration may not jump either.
        named = np.isfinite(self._around.limits.bounds.get("jerk", np.inf)).any()
        return faults + state_jumps(motion, self._begun[: 3 if named else 2], "at the begin")

    def _rest(self, motion: Trajectory) -> Trajectory:
        """The stop behind a motion: every joint braking at its end."""
        end = state_at(motion)
        if np.abs(end[1]).max() <= AT_REST:
            return stay(motion.joint_names, end[0])
        return braking_motion(motion.joint_names, end, self._guard.braking)

    def _with_stop(self, motion: Trajectory) -> Trajectory:
        """A motion with what leads to it, and the stop behind it."""
        lead = [] if self._lead is None else [self._lead]
        return concatenate([*lead, motion, self._rest(motion)])

    def _accept(
        self, motion: Trajectory, whole: Trajectory, scale: float
    ) -> tuple[Verdict | None, list[Violation]]:
        """The answer that accepts a motion; None, and why, where it is not proved."""
        guard = self._guard
        run = rest_of(whole, self._lead_time)
        proof, stops = guard.prove(whole, self._around, run)
        if not proof.verified:
            return None, list(
                shifted([proof.violation] if proof.violation else [], -self._lead_time)
            )
        if not stops.proved:
            details = {"pair": list(stops.worst.pair or ()), "after": stops.worst.after}
            return None, [Violation("stop", stops.worst.time, stops.message, details)]
        stop = GuardStop(self._rest(motion), proof, stops, guard.count)
        guard.running = Running(run, stop)
        notes = tuple(self._notes)
        return Verdict(motion.duration, scale, motion, stop, notes=notes), []

    def _slower(self, motion: Trajectory, look: Look) -> Verdict | None:
        """The answer at the largest scale that was found; None where being slower is no help."""
        ends = self._lead_time + motion.duration
        moving = np.abs(self._begun[1]).max() > AT_REST
        if look.slower <= 0.0 or (look.blocked < ends and self._proposal.keeps_path):
            return None
        if look.slower < 1.0 and moving and self._too_fast(motion):
            return None
        known = [look.slower] if look.slower < 1.0 else []
        failed = 1.0
        for scale in (*known, *(one for one in _SCALES if one < look.slower)):
            whole = self._looks_sound(scale)
            if whole is None:
                failed = scale
                continue
            return self._largest(scale, failed, whole)
        return None

    def _too_fast(self, motion: Trajectory) -> bool:
        """Whether rates are beyond limits at the begin already, where no scale applies yet."""
        around, limits = self._around, self._chain.limits
        for order, name in enumerate(QUANTITIES[1:3], start=1):
            most = np.asarray(around.limits.bounds.get(name, getattr(limits, name)))
            if (np.abs(state_at(motion, 0.0)[order]) > most * (1.0 + RATIO_TOLERANCE)).any():
                return True
        return False

    def _looks_sound(self, scale: float) -> tuple[Trajectory, Trajectory] | None:
        """The motion at a scale, and with its stop; None where it has a fault."""
        slower = self._motion(scale)
        if slower is None:
            return None
        whole = self._with_stop(slower)
        return None if look_at(whole, self._around, self._checker).faults else (slower, whole)

    def _largest(
        self, scale: float, failed: float, made: tuple[Trajectory, Trajectory]
    ) -> Verdict | None:
        """The answer at a scale that looks sound, or at a larger one below one that failed."""
        best = scale
        for _ in range(_BISECTIONS if failed < 1.0 or scale in _SCALES else 0):
            middle = 0.5 * (best + failed)
            larger = self._looks_sound(middle)
            if larger is None:
                failed = middle
            else:
                best, made = middle, larger
        for _ in range(_PROOFS):
            accepted, _ = self._accept(*made, best)
            again = None if accepted is not None else self._looks_sound(0.7 * best)
            if again is None:
                return accepted
            best, made = 0.7 * best, again
        return None

    def _prefix(self, motion: Trajectory, look: Look) -> Verdict | None:
        """The answer up to the last instant found from which the arm can stop; None for none."""
        scale = 1.0
        if 0.0 < look.slower < 1.0 and not self._too_fast(motion):
            slower = self._motion(look.slower)
            if slower is not None:
                motion, scale = slower, look.slower
                look = look_at(self._with_stop(motion), self._around, self._checker)
        times = np.linspace(0.0, motion.duration, _CUTS + 1)[1:]
        times = times[(times + self._lead_time < look.fast) & (times >= _SHORTEST)]
        if not len(times):
            return None
        states = np.stack([motion.sample(times, order) for order in range(3)])
        sound = sound_stops(states, self._guard.braking, self._around, self._checker)
        if self._guard.kind != "path":
            sound = np.logical_and.accumulate(sound)
        candidates = times[np.flatnonzero(sound)]
        for _ in range(_PROOFS):
            if not len(candidates):
                return None
            cut = motion if candidates[-1] >= motion.duration else motion.split(candidates[-1])[0]
            accepted, _ = self._accept(cut, self._with_stop(cut), scale)
            if accepted is not None:
                return accepted
            candidates = candidates[: len(candidates) // 2]
        return None

    def _present_stop(self) -> GuardStop:
        """The stop that the arm has: the last accepted, else that from the state it is in."""
        guard = self._guard
        if guard.running is not None:
            return guard.running.stop
        rest = braking_motion(self._chain.joint_names, self._begun, guard.braking)
        whole = rest if self._lead is None else concatenate([self._lead, rest])
        proof, stops = guard.prove(whole, self._around, rest)
        return GuardStop(rest, proof, stops)


def rest_of(motion: Trajectory, at: float) -> Trajectory:
    """A motion from an instant on; at rest where it is over."""
    if at <= 0.0:
        return motion
    if at >= motion.duration - 1e-12:
        return stay(motion.joint_names, motion.end)
    return motion.split(at)[1]
