"""The departure of a client: told to whom it concerns, without a task that waits for it."""

from collections.abc import Callable

#: Key in the scope of a request with the `Departure` of its client, where its server tells it.
DEPARTURE = "armwright.departure"


class Departure:
    """The moment at which the client of a connection leaves.

    Attributes:
        has_come: whether it has left.
    """

    def __init__(self) -> None:
        self.has_come = False
        self._concerned: set[Callable[[], object]] = set()

    def tell(self, concerned: Callable[[], object]) -> None:
        """Have a function called when the client leaves; at once if it has."""
        if self.has_come:
            concerned()
        else:
            self._concerned.add(concerned)

    def forget(self, concerned: Callable[[], object]) -> None:
        """Have a function not called any more."""
        self._concerned.discard(concerned)

    def come(self) -> None:
        """Note that the client has left."""
        self.has_come = True
        while self._concerned:
            self._concerned.pop()()
