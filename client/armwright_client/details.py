"""Values in the `details` of problem documents, read without trust."""


def items(value: object) -> list[object]:
    """The items of a list; none of anything else."""
    return list(value) if isinstance(value, list) else []


def joints_of(value: object) -> list[float] | None:
    """The joints of a state; None where it has none."""
    match value:
        case {"joints": [*joints]}:
            numbers = [number(q) for q in joints]
            return [q for q in numbers if q is not None] if None not in numbers else None
    return None


def number(value: object) -> float | None:
    """A number as float; None of anything else, truth values among them."""
    return None if isinstance(value, bool) or not isinstance(value, int | float) else float(value)
