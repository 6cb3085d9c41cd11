"""Certificates and problems in words."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

#: Names of limits in sentences.
_LIMITS = {
    "position": "position limits",
    "velocity": "velocity limits",
    "acceleration": "acceleration limits",
    "jerk": "jerk limits",
    "torque": "torque limits",
    "tool_speed": "the limit of the tool's speed",
}
PROVED_HERE = "Proved here, by the code that wrote this page."
NOT_PROVED_HERE = (
    "Not proved here: of the motions and configurations that are shown nothing is known to be free "
    "or within limits. What a file says of that is not repeated."
)
#: Above this part of a limit a sentence says that it is not kept.
_KEPT = 1.0 + 1e-9


def certificate_sentences(certificate: Mapping[str, Any]) -> list[str]:
    """Sentences of a certificate.

    Args:
        certificate: Certificate as the API answers it.
    """
    proved = certificate["proved"]
    sentences = [
        "Everything that the request names is proved, for every instant of the motion."
        if certificate["verified"]
        else "Not everything that the request names is proved.",
        f"It was looked at {against(certificate)}.",
    ]
    if proved["collisions"]:
        sentences.append("Nothing collides at any instant.")
    clearance, pair = certificate.get("min_clearance"), certificate.get("clearance_pair")
    if clearance is not None:
        between = f", between {pair[0]} and {pair[1]}" if pair else ""
        sentences.append(f"The clearance is at least {1000.0 * clearance:.1f} mm{between}.")
    sentences += [_limit(name, use) for name, use in (certificate.get("limits") or {}).items()]
    sentences += [
        f"Constraint {item['name'] or item['constraint']}: violated by at most "
        f"{item['residual']:.3g} {item['unit']}."
        for item in certificate.get("path_constraints", ())
    ]
    sentences += stops_sentences(certificate) + unproved_sentences(certificate)
    return sentences + allowed_sentences(certificate.get("allowed_collisions") or ())


def stops_sentences(certificate: Mapping[str, Any]) -> list[str]:
    """Sentences of the stops that a certificate was asked for.

    Args:
        certificate: Certificate as the API answers it.
    """
    stops = certificate.get("stops")
    if not stops:
        return []
    kind = {"path": "along the path", "joints": "of single joints"}.get(
        stops["kind"], "of both kinds"
    )
    if not stops["proved"]:
        return [f"Stops {kind} are not proved: {stops['message']}."]
    slowed = (
        f" The motion takes {stops['slowed']:.3f} s longer for them." if stops["slowed"] else ""
    )
    return [f"Stops {kind} are proved: at rest within {stops['longest']:.3f} s.{slowed}"]


def allowed_sentences(told: Sequence[Mapping[str, Any]]) -> list[str]:
    """Sentences of the pairs that were not kept apart.

    Args:
        told: Pairs as the API answers them.
    """
    measured = [item for item in told if item["overlap"] is not None]
    sentences = [
        f"{' and '.join(item['pair'])} were not kept apart ({item['reason']}): they overlap by at "
        f"most {1000.0 * item['overlap']:.2f} mm."
        for item in measured
    ]
    rest = len(told) - len(measured)
    if rest:
        sentences.append(f"Not kept apart, depth not measured: {rest} pair(s).")
    return sentences


def unproved_sentences(certificate: Mapping[str, Any]) -> list[str]:
    """Sentences of what a certificate says is not proved, and why.

    Args:
        certificate: Certificate as the API answers it.
    """
    reasons = (certificate.get("proved") or {}).get("reasons") or ()
    sentences = [f"Not proved: {reason}" for reason in reasons]
    violation = certificate.get("violation")
    if violation is not None:
        sentences.append(f"First violation, at {violation['time']:.3f} s: {violation['message']}.")
    return sentences


def against(certificate: Mapping[str, Any]) -> str:
    """The premises of a certificate in words.

    Args:
        certificate: Certificate as the API answers it.
    """
    told = certificate.get("premises")
    if told is None:
        return "against premises that are not told"
    from planning.proof.premises import Premises  # noqa: PLC0415  all of planning, with numba

    return Premises.of_fields(told).against()


def stage_label(stage: Mapping[str, Any]) -> str:
    """Number, name and kind of a stage.

    Args:
        stage: Stage as the API answers it.
    """
    name = stage["kind"] if stage.get("name") is None else f"{stage['name']} ({stage['kind']})"
    return f"{stage['index']}: {name}"


def task_sentences(answer: Mapping[str, Any]) -> Iterator[str]:
    """Sentences of a task: its duration, and the proof of each stage.

    Args:
        answer: Answer as the API gives it.
    """
    stages = answer["stages"]
    proved = sum(stage["certificate"]["verified"] for stage in stages)
    yield f"{answer['duration']:.3f} s; stages proved: {proved} of {len(stages)}."
    if answer["status"] == "partial":
        yield "The later stages could not be done: this is the beginning only."
    for stage in stages:
        words = [f"Stage {stage_label(stage)}", *proof_words(stage["certificate"])]
        if stage.get("choice") is not None:
            words.append(f"choice {stage['choice']}")
        held = ", ".join(item["id"] for item in stage["after"]["attached"])
        if held:
            words.append(f"the robot holds {held}")
        yield "; ".join(words) + "."


def proof_words(certificate: Mapping[str, Any]) -> Iterator[str]:
    """Parts of a sentence on the proof of a stage or leg.

    Args:
        certificate: Certificate as the API answers it.
    """
    yield f"{'proved' if certificate['verified'] else 'not proved'} {against(certificate)}"
    clearance, pair = certificate.get("min_clearance"), certificate.get("clearance_pair")
    if clearance is not None:
        between = f" between {pair[0]} and {pair[1]}" if pair else ""
        yield f"clearance at least {1000.0 * clearance:.1f} mm{between}"


def problem_sentences(problem: Mapping[str, Any]) -> list[str]:
    """Sentences of a problem document.

    Args:
        problem: Problem as the API answers it.
    """
    sentences = [f"{problem['title']} ({problem['code']}).", _sentence(problem["detail"])]
    if problem.get("hint"):
        sentences.append(_sentence(problem["hint"]))
    details = problem.get("details") or {}
    sentences += [
        f"{' and '.join(item['pair'])} overlap by {1000.0 * item['depth']:.1f} mm."
        for item in details.get("collisions") or ()
        if item.get("depth") is not None
    ]
    sentences += [
        f"Stage {stage['name']}: {stage['outcome']}, {stage['milliseconds']:.0f} ms."
        for stage in details.get("stages") or ()
    ]
    return sentences


def _limit(name: str, use: Mapping[str, Any]) -> str:
    ratio = use["worst_ratio"]
    words = _LIMITS.get(name, name)
    if ratio is None:
        return f"Of {words} nothing is used."
    where = f"at {use['time']:.3f} s" + (f" by {use['joint']}" if use.get("joint") else "")
    if ratio > _KEPT:
        return f"{words.capitalize()} are not kept: {100.0 * ratio:.1f} %, {where}."
    return f"At most {100.0 * ratio:.1f} % of {words} is used, {where}."


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")
