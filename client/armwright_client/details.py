"""Values in the `details` of problem documents, read without trust."""


def items(value: object) -> list[object]:
    """The items of a list; none of anything else."""
    return list(value) if isinstance(value, list) else []


def joints_of(value: object) -> list[float] | None:
    """The joints of a state; None where it has none."""
    match value:
        case {"joints": [*joints]} if all(isinstance(q, int | float) for q in joints):
            return [float(q) for q in joints]
    return None


def number(value: object) -> float | None:
    """A number as float; None of anything else."""
    return float(value) if isinstance(value, int | float) else None
