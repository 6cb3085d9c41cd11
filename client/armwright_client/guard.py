"""Sessions of the gate: an arm's proposals over one WebSocket, each proved before it is sent."""

from collections.abc import Mapping, Sequence
from typing import Any, Self, TypeVar, Unpack

import httpx
from pydantic import BaseModel, ValidationError

from armwright_client.call import refusal
from armwright_client.errors import TransportError, UnexpectedAnswer, from_problem
from armwright_client.options.plan_options import GuardOptions
from armwright_wire.base import Body
from armwright_wire.errors import InvalidArgument
from armwright_wire.plans.guard import (
    GuardAnswer,
    GuardChange,
    GuardOpening,
    GuardReady,
    GuardState,
    GuardStep,
    Proposal,
    SceneChange,
)
from armwright_wire.plans.job import Problem
from armwright_wire.pose import Pose
from armwright_wire.scenes.scene import Obstacle

A = TypeVar("A", bound=BaseModel)
B = TypeVar("B", bound=Body)

#: Longest wait for an answer [s].
_TIMEOUT = 10.0
#: Characters of an answer that an error shows.
_EXCERPT = 200


class Guard:
    """Gate for the motions of one arm; the service keeps robot, scene and the stop accepted last.

    Needs the package websockets: ``pip install armwright-client[guard]``.

    Args:
        robot: Name of the robot.
        base_url: URL of the service.
        token: API key, where the service has keys.
        options: `scene`, `stop`, `margin`, …: see `GuardOptions`. `timeout` is the longest wait for
            an answer, 10 s if left out.

    Raises:
        InvalidArgument: The package is missing, or an option is none.
        ApiError: The service refuses the session.
        TransportError: The service is not there.
    """

    def __init__(
        self,
        robot: str,
        base_url: str = "http://127.0.0.1:8000",
        *,
        token: str | None = None,
        **options: Unpack[GuardOptions],
    ) -> None:
        try:
            from websockets.exceptions import WebSocketException  # noqa: PLC0415
            from websockets.sync.client import connect  # noqa: PLC0415
        except ImportError:
            raise InvalidArgument(
                "sessions of the gate need the package websockets: "
                "pip install armwright-client[guard]"
            ) from None
        timeout = options.pop("timeout", None) or _TIMEOUT
        opening = _made(GuardOpening, robot=robot, **options)
        url = httpx.URL(base_url.rstrip("/") + "/v1/guard")
        url = url.copy_with(scheme="wss" if url.scheme == "https" else "ws")
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._timeout, self._faults = timeout, (WebSocketException, OSError)
        try:
            self._socket = connect(
                str(url), additional_headers=headers, open_timeout=timeout, compression=None
            )
        except self._faults as error:
            raise TransportError(f"WS /v1/guard: {error}") from error
        self.ready = self._ask(opening.to_json(), GuardReady)

    def propose(
        self,
        positions: Sequence[float] | GuardState,
        proposal: Proposal,
        latency: float = 0.0,
        *,
        scene_hash: str | None = None,
        exact: bool = False,
    ) -> GuardAnswer:
        """The verdict on a proposal: what of it is proved, and the stop that the arm has.

        Args:
            positions: Positions of an arm at rest, or its state.
            proposal: The motion.
            latency: Time from the state to the begin of the proposal [s].
            scene_hash: Hash of the scene that it was made for.
            exact: Whether the first instant of a collision is told.

        Raises:
            ApiError: The message is malformed; the session goes on.
            TransportError: The connection is lost: the arm has the stop accepted last.
        """
        given = isinstance(positions, GuardState)
        state = positions if given else _made(GuardState, positions=positions)
        step = _made(GuardStep, state=state, proposal=proposal, latency=latency, exact=exact,
                     scene_hash=scene_hash)  # fmt: skip
        return self._ask(step.to_json(), GuardAnswer)

    def change(
        self,
        *,
        add: Sequence[Obstacle] | None = None,
        move: Mapping[str, Pose] | None = None,
        remove: Sequence[str] | None = None,
        elapsed: float = 0.0,
    ) -> GuardReady:
        """Change the scene; whether the rest of the accepted motion and its stop are proved in it.

        Args:
            add: Obstacles.
            move: Poses of obstacles by name.
            remove: Names of obstacles that are gone.
            elapsed: Time since the motion accepted last began [s].

        Raises:
            ApiError: There is no such obstacle, or one of that name already.
            TransportError: The connection is lost: the arm has the stop accepted last.
        """
        moved = None if move is None else [{"id": name, "pose": move[name]} for name in move]
        change = _made(SceneChange, add=add, move=moved, remove=remove, elapsed=elapsed)
        return self._ask(GuardChange.of(change=change).to_json(), GuardReady)

    def _ask(self, message: str, kind: type[A]) -> A:
        """The answer to a message."""
        try:
            self._socket.send(message)
            content = self._socket.recv(self._timeout)
        except (*self._faults, TimeoutError) as error:
            raise TransportError(f"WS /v1/guard: {str(error) or 'no answer'}") from error
        text = content if isinstance(content, str) else content.decode()
        try:
            if '"code"' in text and '"status"' in text:
                problem = Problem.read(text.encode())
                if problem.code:
                    raise from_problem(problem, problem.status or 0, None)
            return kind.model_validate_json(text, extra="ignore", strict=False)
        except ValidationError as error:
            raise UnexpectedAnswer(
                "WS /v1/guard was answered with something else", 0, text[:_EXCERPT]
            ) from error

    def close(self) -> None:
        """End the session: the arm has the stop accepted last."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class GuardedActions:
    """Filter of the actions of a control loop: each target that leaves it lies on a proved motion.

    Called once a period with an action and an observation, both with a position for each joint by
    name, and answered with the action to send: the way LeRobot's loops call their
    ``robot_action_processor``. An action is the target of one period later. Where it is reached too
    fast the arm goes there more slowly; where nothing of it is proved the arm goes on with the stop
    that it has. Other entries of an action are passed on as they are.

    Args:
        guard: The session.
        keys: Entries of the joints, in the robot's order.
        period: Period of the loop [s].
        scale: Radians or metres per unit of an entry, one for all or one for each joint.
    """

    def __init__(
        self,
        guard: Guard,
        keys: Sequence[str],
        period: float,
        scale: float | Sequence[float] = 1.0,
    ) -> None:
        scales = [scale] * len(keys) if isinstance(scale, int | float) else list(scale)
        if len(scales) != len(keys):
            raise InvalidArgument(f"scale has {len(scales)} value(s) for {len(keys)} joints")
        self._guard, self._period = guard, period
        self._units = dict(zip(keys, scales, strict=True))
        self._last: GuardAnswer | None = None
        self._elapsed: float | None = None
        self.verdict: GuardAnswer | None = None

    def __call__(self, given: tuple[Mapping[str, Any], Mapping[str, Any]]) -> dict[str, Any]:
        """The action to send in place of one, with what the arm was measured at.

        Raises:
            InvalidArgument: An entry of a joint is missing.
            ApiError: An entry is no position of its joint.
            TransportError: The connection is lost: the arm has the stop accepted last.
        """
        action, observation = given
        target, measured = self._positions(action), self._positions(observation)
        proposal = _made(
            Proposal, samples=[target], period=self._period, interpolation="natural_spline"
        )
        state = _made(GuardState, positions=measured, elapsed=self._elapsed)
        self.verdict = verdict = self._guard.propose(state, proposal)
        if verdict.trajectory is not None:
            self._last, self._elapsed = verdict, 0.0
        if self._last is None or self._elapsed is None:
            return dict(action) | self._entries(measured)
        self._elapsed += self._period
        return dict(action) | self._entries(_place(self._last, self._elapsed))

    def _positions(self, entries: Mapping[str, Any]) -> list[float]:
        missing = [key for key in self._units if key not in entries]
        if missing:
            raise InvalidArgument(f"no entry {missing[0]!r} among {', '.join(entries) or 'none'}")
        return [float(entries[key]) * unit for key, unit in self._units.items()]

    def _entries(self, positions: Sequence[float]) -> dict[str, float]:
        pairs = zip(self._units.items(), positions, strict=True)
        return {key: position / unit for (key, unit), position in pairs}


def _place(verdict: GuardAnswer, elapsed: float) -> list[float]:
    """Where an arm is that runs what was accepted, and its stop after that."""
    motion, stop, until = verdict.trajectory, verdict.stop.trajectory, verdict.accepted_until
    if motion is not None and elapsed <= until:
        return motion.sample([elapsed])[0]
    return stop.sample([min(elapsed - until, stop.duration)])[0]


def _made(kind: type[B], **fields: Any) -> B:
    """A request of fields that are checked here, before anything is sent."""
    try:
        return kind.of(**fields)
    except ValidationError as error:
        raise InvalidArgument(refusal(error)) from error
