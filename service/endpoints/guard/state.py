"""State of a session of the gate, as it goes between the server and its workers."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SessionState:
    """State of a session as the server keeps it between messages.

    Args:
        id: The session.
        version: Counts changes of its scene.
        count: Proposals so far.
        scene: The scene as it was changed, pickled; None for that of the opening.
        running: The motion that the arm has, pickled; None where none was accepted.
    """

    id: str
    version: int = 0
    count: int = 0
    scene: bytes | None = None
    running: bytes | None = None


@dataclass(frozen=True, slots=True)
class SessionReply:
    """Answer of a session to a message.

    Args:
        content: The answer, JSON.
        state: State of the session from then on.
    """

    content: bytes
    state: SessionState
