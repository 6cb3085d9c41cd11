"""OMPL's planners: their names here, and the options of each.

Defaults and ranges are those that OMPL declares; where a range would let a request take all memory
it is narrower, and ``range`` has a default that suits arms.

Options of OMPL's planners: names, values and ranges.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from kinematics.errors import InvalidOption

#: Words of OMPL's names that are not written as words of ours are.
_SPELLINGS = {"cc": "CC", "fmt": "FMT"}

Value = float | int | bool | None


@dataclass(frozen=True, slots=True)
class Parameter:
    """An option of a planner.

    Args:
        name: Name on the wire.
        kind: Kind of its values.
        default: Value where the request names none; None leaves it to OMPL.
        least: Smallest value.
        most: Largest value.
        above: Whether ``least`` itself is too small.
    """

    name: str
    kind: Literal["number", "whole", "switch"]
    default: Value
    least: float = 0.0
    most: float = 1.0
    above: bool = False

    def takes(self, value: object) -> bool:
        """Whether it can have this value."""
        if isinstance(value, bool) or self.kind == "switch":
            return isinstance(value, bool) and self.kind == "switch"
        if not isinstance(value, int if self.kind == "whole" else int | float):
            return False
        assert isinstance(value, int | float)
        fits = math.isfinite(value) and self.least <= value <= self.most
        return fits and not (self.above and value == self.least)

    @property
    def requirement(self) -> str:
        """The values that it takes, for a person."""
        if self.kind == "switch":
            return "true or false"
        noun = "a number" if self.kind == "number" else "a whole number"
        low = f"above {self.least:g}" if self.above else f"from {self.least:g}"
        return f"{noun} {low} to {self.most:g}"

    def setter(self, solver: Any) -> Callable[[Value], None]:
        """The method of an OMPL planner that sets this option."""
        words = (_SPELLINGS.get(word, word.capitalize()) for word in self.name.split("_"))
        method: Callable[[Value], None] = getattr(solver, f"set{''.join(words)}")
        return method


#: Longest edge [rad]: arms in clutter are solved several times sooner with short ones.
DEFAULT_RANGE = 0.5
#: More edges than any planner proves in the longest time a request may take.
_MAX = 100_000_000


@dataclass(frozen=True, slots=True)
class Planner:
    """Description of one of OMPL's planners.

    Args:
        ompl: Name of the planner in OMPL.
        parameters: Options of the planner in OMPL.
        improves: Whether the planner goes on after its first path, for shorter ones.
        roadmap: Whether the planner grows a roadmap, which is searched here.
        batch: The option that says how many states it draws, of those that draw them all at once.
        one_goal: Whether the planner takes one goal alone; several then take turns.
    """

    ompl: str
    parameters: tuple[Parameter, ...] = ()
    improves: bool = False
    roadmap: bool = False
    batch: str | None = None
    one_goal: bool = False

    @property
    def options(self) -> dict[str, Parameter]:
        """All its options by name, those of the search around it too."""
        own = (*self.parameters, *_BUDGETS, *((_THRESHOLD,) if self.improves else ()))
        return {parameter.name: parameter for parameter in own}


def _number(
    name: str, default: float | None, least: float = 0.0, most: float = 1.0, *, above: bool = False
) -> Parameter:
    return Parameter(name, "number", default, least, most, above)


def _integer(name: str, default: int | None, least: int, most: int) -> Parameter:
    return Parameter(name, "whole", default, least, most)


def _switch_on(name: str) -> Parameter:
    return Parameter(name, "switch", True)


def _switch_off(name: str) -> Parameter:
    return Parameter(name, "switch", False)


_BUDGETS = (_integer("max_iterations", None, 1, _MAX), _integer("max_edges", None, 1, _MAX))
_THRESHOLD = _number("cost_threshold", None, 0.0, 1e6, above=True)
_RANGE = _number("range", DEFAULT_RANGE, 0.0, 10_000.0, above=True)
_BIAS = _number("goal_bias", 0.05)
_BORDER = _number("border_fraction", 0.9, 0.01)
_EXPANSION = _number("failed_expansion_cell_score_factor", 0.5, 0.01)
_LEAST_VALID = "min_valid_path_fraction"


def _tree_star(*, informed: bool, ordered: bool) -> tuple[Parameter, ...]:
    """Options of RRT* and of what is made of it."""
    return (
        _RANGE,
        _BIAS,
        _number("rewire_factor", 1.1, 1.0, 10.0),
        _switch_on("k_nearest"),
        _switch_on("delay_cc"),
        (_switch_on if informed else _switch_off)("tree_pruning"),
        _number("prune_threshold", 0.05),
        (_switch_on if informed else _switch_off)("pruned_measure"),
        (_switch_on if informed else _switch_off)("informed_sampling"),
        _switch_off("sample_rejection"),
        _switch_off("new_state_rejection"),
        _switch_on("admissible_cost_to_come"),
        (_switch_on if ordered else _switch_off)("ordered_sampling"),
        _integer("batch_size", 100 if ordered else 1, 1, 100_000),
        _integer("num_sampling_attempts", 100, 10, 100_000),
    )


def _fast_marching_options(*, radius: float, heuristics: bool) -> tuple[Parameter, ...]:
    """Options of fast marching trees."""
    return (
        _integer("num_samples", 1000, 10, 20_000),
        _number("radius_multiplier", radius, 0.1, 50.0),
        _number("free_space_volume", None, 0.0, 1e12, above=True),
        _switch_on("nearest_k"),
        _switch_on("cache_cc"),
        (_switch_on if heuristics else _switch_off)("heuristics"),
        _switch_on("extended_fmt"),
    )


_BATCH_TREES = (
    _number("rewire_factor", 1.1, 1.0, 10.0),
    _integer("samples_per_batch", 100, 1, 10_000),
    _switch_on("use_k_nearest"),
    _switch_on("pruning"),
    _number("prune_threshold_fraction", 0.05),
    _switch_off("drop_samples_on_prune"),
    _switch_off("stop_on_soln_improvement"),
)

_CATALOGUE: Mapping[str, Planner] = {
    "rrt_connect": Planner("RRTConnect", (_RANGE, _switch_off("intermediate_states"))),
    "aorrtc": Planner("AORRTC", (_RANGE,), improves=True, one_goal=True),
    "bfmt": Planner(
        "BFMT",
        _fast_marching_options(radius=1.0, heuristics=True),
        batch="num_samples",
        one_goal=True,
    ),
    "bit_star": Planner("BITstar", _BATCH_TREES, improves=True),
    "bkpiece1": Planner("BKPIECE1", (_RANGE, _BORDER, _EXPANSION, _number(_LEAST_VALID, 0.5))),
    "fmt": Planner(
        "FMT", _fast_marching_options(radius=1.1, heuristics=False), batch="num_samples"
    ),
    "informed_rrt_star": Planner(
        "InformedRRTstar", _tree_star(informed=True, ordered=False), improves=True
    ),
    "kpiece1": Planner("KPIECE1", (_RANGE, _BIAS, _BORDER, _EXPANSION, _number(_LEAST_VALID, 0.2))),
    "lbkpiece1": Planner("LBKPIECE1", (_RANGE, _BORDER, _number(_LEAST_VALID, 0.5))),
    "prm": Planner("PRM", (_integer("max_nearest_neighbors", None, 1, 1000),), roadmap=True),
    "prm_star": Planner("PRMstar", roadmap=True, improves=True),
    "rrt": Planner("RRT", (_RANGE, _BIAS, _switch_off("intermediate_states"))),
    "rrt_star": Planner("RRTstar", _tree_star(informed=False, ordered=False), improves=True),
    "sorrt_star": Planner("SORRTstar", _tree_star(informed=True, ordered=True), improves=True),
}
PLANNERS = tuple(_CATALOGUE)


def planner_by_name(planner: str) -> Planner:
    """The planner of a name.

    Raises:
        InvalidOption: There is none; the message lists those there are.
    """
    if planner not in _CATALOGUE:
        raise InvalidOption(
            f"there is no planner {planner!r}", hint=f"Choose one of: {', '.join(PLANNERS)}."
        )
    return _CATALOGUE[planner]


def complete_options(planner: str, options: Mapping[str, Any]) -> dict[str, Value]:
    """All options of a planner, those that are not given as they are by default.

    Raises:
        InvalidOption: There is no such option, or a value is out of its range.
    """
    known = planner_by_name(planner).options
    hint = f"Its options, with their defaults: {describe_options(planner)}."
    for name, value in options.items():
        if name not in known:
            raise InvalidOption(
                f"planner {planner!r} has no option {name!r}", hint=hint, options=list(known)
            )
        if not known[name].takes(value):
            raise InvalidOption(
                f"planner_options.{name} must be {known[name].requirement}, not {value!r}",
                hint=hint,
                options=list(known),
            )
    values = {name: options.get(name, parameter.default) for name, parameter in known.items()}
    _fit_together(values, hint)
    return values


def _fit_together(values: Mapping[str, Value], hint: str) -> None:
    """Refuse what OMPL takes, but only complains of, or does not survive."""
    informed, rejecting = values.get("informed_sampling"), values.get("sample_rejection")
    if informed and rejecting:
        raise InvalidOption(
            "planner_options: informed_sampling and sample_rejection exclude each other", hint=hint
        )
    for name in ("ordered_sampling", "pruned_measure"):
        if values.get(name) and not informed and not (rejecting and name == "ordered_sampling"):
            raise InvalidOption(f"planner_options.{name} needs informed_sampling", hint=hint)


def describe_options(planner: str) -> str:
    """The options of a planner with what they take and their defaults, for a person."""
    return ", ".join(
        f"{parameter.name} ({parameter.requirement}; {_describe(parameter.default)})"
        for parameter in planner_by_name(planner).options.values()
    )


def _describe(default: Value) -> str:
    return "none" if default is None else str(default).lower()
