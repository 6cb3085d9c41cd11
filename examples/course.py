"""The whole course on one arm: model, formulas, inverse kinematics, field, spline, control, errors.

    make serve                      # in another terminal
    python examples/course.py [--url http://127.0.0.1:8000] [--output docs/pictures/course]

Every step asks the service, prints what the course notes say about it, and draws one picture; the
pages in docs/course show them.
"""

import argparse
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import ArrayLike, NDArray

from armwright_client import (
    Client,
    Gradient,
    NotFound,
    Obstacle,
    Pose,
    PotentialBatch,
    PotentialOptions,
    Retimed,
    RetimeTiming,
    RobotUpload,
    Scene,
    Simulation,
)

Array = NDArray[np.float64]

NAME = "course_arm"
#: Lengths of the two links [m].
LENGTHS = (0.6, 0.4)
START, GOAL = [0.0, 0.3], [1.4, -0.3]
BALL_CENTRE, BALL_RADIUS = (0.75, 0.55, 0.0), 0.12
FIELD = {"repulsive_weights": 2e-3, "influence_distance": 0.25}
CONTROLLERS = {
    "independent_joint": "independent joint",
    "pd_gravity": "PD + gravity",
    "computed_torque": "computed torque",
    "passivity": "passivity",
    "adaptive": "adaptive",
}
COLOURS = ("#888888", "#dd8800", "#3366cc", "#118855", "#bb2255")
#: Points of the grid along each joint for the arrows of the field.
_GRID = 45
#: The adaptive controller's rate of learning.
_GAMMA = 3.0


def arm_table() -> RobotUpload:
    """The arm: two links in a vertical plane, each a slender rod."""
    rows = []
    for length, mass in zip(LENGTHS, (2.0, 1.0), strict=True):
        inertia = mass * length**2 / 12.0
        rows.append({
            "type": "revolute", "a": length, "alpha": 0.0, "d": 0.0, "theta": 0.0,
            "lower": -3.0, "upper": 3.0, "velocity": 3.0, "acceleration": 20.0, "jerk": 400.0,
            "effort": 60.0, "mass": mass, "center_of_mass": [-length / 2.0, 0.0, 0.0],
            "inertia": [[1e-4, 0.0, 0.0], [0.0, inertia, 0.0], [0.0, 0.0, inertia]],
        })  # fmt: skip
    table = {"convention": "standard", "rows": rows, "gravity": [0.0, -9.81, 0.0],
             "geometry": {"capsules": 0.02}}  # fmt: skip
    return RobotUpload.model_validate({"name": NAME, "dh": table})


def ball() -> Scene:
    """The obstacle between start and goal."""
    shape = {"type": "sphere", "radius": BALL_RADIUS}
    obstacle = {"id": "ball", "shape": shape, "pose": {"position": list(BALL_CENTRE)}}
    return Scene(obstacles=[Obstacle.model_validate(obstacle)])


# -------------------------------------------------------------------------------- drawing


def new_axes(title: str, x: str, y: str, *, equal: bool = False) -> tuple[Figure, Axes]:
    """One plot in the manner of all of them."""
    figure, axes = plt.subplots(figsize=(6.4, 4.4))
    axes.set(title=title, xlabel=x, ylabel=y)
    if equal:
        axes.set_aspect("equal")
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def save(figure: Figure, path: Path) -> None:
    """Write a picture and forget it."""
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_arm(axes: Axes, client: Client, joints: ArrayLike, colour: str, label: str) -> None:
    """The arm in its plane, through the origins that forward kinematics answers."""
    links = client.robots.fk(NAME, np.asarray(joints).tolist()).links
    points = np.array([links[name].position for name in ("base", "link_1", "link_2")])
    axes.plot(points[:, 0], points[:, 1], "o-", color=colour, lw=3.0, ms=6.0, label=label)


def draw_ball(axes: Axes) -> None:
    """The obstacle in the plane of the arm."""
    axes.add_patch(Circle(BALL_CENTRE[:2], BALL_RADIUS, color="#bbbbbb", zorder=0))


# ---------------------------------------------------------------------------------- steps


def model(client: Client, folder: Path) -> None:
    """Lectures 7 to 9: a Denavit-Hartenberg table becomes a robot."""
    with suppress(NotFound):
        client.robots.delete(NAME)
    robot = client.robots.create(arm_table())
    figure, axes = new_axes("one table, three configurations", "x [m]", "y [m]", equal=True)
    for joints, colour in (
        ([0.0, 0.0], "#3366cc"),
        ([0.6, 0.9], "#118855"),
        ([1.9, -1.2], "#bb2255"),
    ):
        draw_arm(axes, client, joints, colour, f"q = {joints}")
    axes.legend(frameon=False, fontsize=8)
    save(figure, folder / "1_model.png")
    print(f"model: {len(robot.joint_names)} joints, links {', '.join(robot.links)}")


def equations(client: Client, folder: Path) -> None:
    """Lectures 9 and 25 to 27: forward kinematics and the equations of motion as formulas."""
    lines = {}
    for notation in ("text", "latex"):
        answer = client.robots.equations(NAME, notation)
        assert answer.dynamics is not None
        matrices = {"D": answer.dynamics.mass_matrix, "C": answer.dynamics.coriolis_matrix}
        lines[notation] = [
            *zip("xyz", answer.pose.position, strict=True),
            *((f"{name}_{i}{j}", entry) for name, matrix in matrices.items()
              for i, row in enumerate(matrix, 1) for j, entry in enumerate(row, 1)),
            *((f"G_{i}", entry) for i, entry in enumerate(answer.dynamics.gravity, 1)),
        ]  # fmt: skip
    for name, formula in lines["text"]:
        print(f"equations, {name}: {formula}")
    figure, axes = plt.subplots(figsize=(6.4, 4.4))
    axes.set(title="position of the tip, and D(q) q̈ + C(q, q̇) q̇ + G(q) = τ",
             ylim=(len(lines["latex"]), -1))  # fmt: skip
    axes.axis("off")
    for i, (name, formula) in enumerate(lines["latex"]):
        symbol = name.replace("_", "_{") + ("}" if "_" in name else "")
        axes.text(0.0, i, f"${symbol} = {formula}$", fontsize=12, va="center")
    save(figure, folder / "2_equations.png")


def inverse_kinematics(client: Client, folder: Path) -> None:
    """Lectures 10 and 11: the tip at one position, elbow on either side."""
    target = np.array(client.robots.fk(NAME, [0.4, 1.1]).pose.position)
    figure, axes = new_axes("two branches reach one position", "x [m]", "y [m]", equal=True)
    branches = {"elbow up": [1.3, -1.0], "elbow down": [0.4, 1.0]}
    for (label, seed), colour in zip(branches.items(), ("#3366cc", "#bb2255"), strict=True):
        found = client.robots.ik(
            NAME, Pose(position=target.tolist()), axes=["x", "y"], seed_joints=seed,
            method="numeric",
        ).solutions[0]  # fmt: skip
        draw_arm(axes, client, found.joints, colour, label)
        error = np.linalg.norm(
            np.array(client.robots.fk(NAME, found.joints).pose.position) - target
        )
        print(f"ik, {label}: q = {np.round(found.joints, 4)}, error {error:.1e} m")
    axes.plot(*target[:2], "kx", ms=10)
    axes.legend(frameon=False, fontsize=8)
    save(figure, folder / "3_ik.png")


def gradient(client: Client, folder: Path) -> None:
    """Lectures 15 and 16: both gradient rules lead the tip to a position."""
    target = client.robots.fk(NAME, [0.4, 1.1]).pose.position
    figure, axes = new_axes("errors of the two flows", "time [s]", "|e(t)| [m]")
    rules = {"pseudo_inverse": "q̇ = J⁺ K e", "transpose": "q̇ = γ Jᵀ e"}
    for (rule, label), colour in zip(rules.items(), ("#3366cc", "#bb2255"), strict=True):
        answer = client.robots.ik(
            NAME, Pose(position=target), axes=["x", "y"], method="gradient",
            seed_joints=[-0.5, 0.4],
            gradient=Gradient.model_validate({"rule": rule, "form": "flow", "trace": True}),
        )  # fmt: skip
        assert answer.trace is not None
        errors = np.maximum(answer.trace.position_error, 1e-9)
        axes.semilogy(answer.trace.time, errors, color=colour, label=label)
        print(f"gradient, {rule}: {len(errors) - 1} steps, last error {errors[-1]:.1e} m")
    axes.set(xlim=(0.0, 40.0))
    axes.legend(frameon=False, fontsize=8)
    save(figure, folder / "4_gradient.png")


def field(client: Client, folder: Path) -> Array:
    """Lectures 18 and 19: arrows of -grad U over the joint plane, and the descent on it."""
    plan = client.plan(
        NAME, START, GOAL, scene=ball(), planner="potential_field",
        planner_options=FIELD | {"connect": False, "patience": 100_000, "max_iterations": 5000},
    )  # fmt: skip
    assert plan.potential_field is not None
    path = np.array(plan.potential_field.joints)
    first, second = np.linspace(-0.4, 2.2, _GRID), np.linspace(-2.2, 0.8, _GRID)
    grid = np.array([[x, y] for y in second for x in first])
    answer: PotentialBatch = client.robots.potential_batch(
        NAME, grid.tolist(), GOAL, ball(), options=PotentialOptions.model_validate(FIELD)
    )
    force = np.array(answer.joint_force).reshape(_GRID, _GRID, 2)
    U = np.array(answer.potential).reshape(_GRID, _GRID)
    figure, axes = new_axes("the field −∇U and the descent", "q1 [rad]", "q2 [rad]", equal=True)
    axes.contourf(first, second, np.minimum(U, np.quantile(U, 0.9)), 24, cmap="Blues", alpha=0.6)
    axes.streamplot(first, second, force[..., 0], force[..., 1], color="#555555", linewidth=0.6,
                    density=1.3, arrowsize=0.8)  # fmt: skip
    axes.plot(path[:, 0], path[:, 1], color="#bb2255", lw=2.2, label="descent")
    axes.plot(*START, "o", color="#118855", label="start")
    axes.plot(*GOAL, "s", color="#bb2255", label="goal")
    axes.set(xlim=(first[0], first[-1]), ylim=(second[0], second[-1]))
    axes.legend(frameon=False, fontsize=8, loc="lower left")
    save(figure, folder / "5_field.png")
    U_path = np.array(plan.potential_field.potentials)
    print(f"field: {len(path)} configurations, U from {U_path[0]:.3f} to {U_path[-1]:.5f} J")
    print(f"field: clearance {plan.certificate.min_obstacle_clearance:.3f} m, proved")
    return path


def spline(client: Client, folder: Path, path: Array) -> Retimed:
    """Lecture 20: a natural cubic spline through waypoints of the descent at given times."""
    chosen = path[np.linspace(0, len(path) - 1, 6).round().astype(int)]
    chosen[-1] = GOAL
    times = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]
    timing = RetimeTiming(method="spline", interpolation="natural_spline", times=times,
                          sample_period=0.01)  # fmt: skip
    timed = client.retime(chosen.tolist(), robot=NAME, timing=timing)
    samples = timed.trajectory.samples
    assert samples is not None
    t = np.array(samples.time)
    figure, rows = plt.subplots(3, 1, figsize=(6.4, 5.4), sharex=True)
    values = (samples.position, samples.velocity, samples.acceleration)
    for axes, value, name in zip(rows, values, ("q [rad]", "q̇ [rad/s]", "q̈ [rad/s²]"), strict=True):
        axes.plot(t, np.array(value), lw=1.4)
        axes.set(ylabel=name)
        axes.grid(alpha=0.25)
    rows[0].plot(times, chosen, "k.", ms=6)
    rows[0].set(title="a natural cubic spline through six waypoints")
    rows[-1].set(xlabel="time [s]")
    save(figure, folder / "6_spline.png")
    ends = np.abs(np.array(samples.acceleration))[[0, -1]].max()
    print(f"spline: acceleration at the ends {ends:.1e} rad/s², limits hold: "
          f"{timed.certificate.proved.limits}")  # fmt: skip
    return timed


def control(client: Client, folder: Path, timed: Retimed) -> dict[str, Simulation]:
    """Lectures 20 and 28 to 34: five controllers follow the spline with masses 20 % too large."""
    results = {}
    for name in CONTROLLERS:
        gains = {"type": name, "natural_frequency": 15.0}
        if name == "adaptive":
            gains["Gamma"] = _GAMMA
        results[name] = client.simulate(
            NAME, timed.trajectory, gains, model_error={"mass_scale": 1.2}, duration=3.5,
            sample_period=0.02, saturate=False,
        )  # fmt: skip
    figure, axes = new_axes("joint errors, model 20 % too heavy", "time [s]", "|qʳ − q| [mrad]")
    for (name, result), colour in zip(results.items(), COLOURS, strict=True):
        error = 1e3 * np.linalg.norm(result.tracking_error, axis=1)
        axes.semilogy(result.time, np.maximum(error, 1e-3), color=colour, label=CONTROLLERS[name])
        print(
            f"control, {CONTROLLERS[name]}: largest error "
            f"{1e3 * result.max_tracking_error:.2f} mrad"
        )
    axes.legend(frameon=False, fontsize=8)
    save(figure, folder / "7_control.png")
    return results


def lyapunov(client: Client, folder: Path) -> None:
    """Lectures 29 to 32: with an exact model and a reference at rest every V falls."""
    rest = {"type": "hold", "joints": list(GOAL), "duration": 1.5}
    figure, rows = plt.subplots(2, 1, figsize=(6.4, 5.4), sharex=True)
    # Independent joint control ignores the arm, so that its V proves nothing here.
    for name, colour in list(zip(CONTROLLERS, COLOURS, strict=True))[1:]:
        gains = {"type": name, "natural_frequency": 8.0}
        result = client.simulate(
            NAME, rest, gains, initial_state={"offset": [0.4, -0.5]}, sample_period=0.01,
            saturate=False,
        )  # fmt: skip
        V, rate = np.array(result.lyapunov), np.array(result.lyapunov_rate)
        rows[0].semilogy(result.time, V / V[0], color=colour, label=CONTROLLERS[name])
        rows[1].semilogy(result.time, np.maximum(-rate / V[0], 1e-8), color=colour)
        grows = max((after - before for before, after in pairwise(V)), default=0.0)
        print(f"lyapunov, {CONTROLLERS[name]}: largest growth {max(grows, 0.0) / V[0]:.1e} of V(0)")
        print(f"rate, {CONTROLLERS[name]}: at most {rate.max() / V[0]:.1e} of V(0) a second")
    rows[0].set(title="Lyapunov functions, exact model", ylabel="V(t) / V(0)")
    rows[1].set(ylabel="−V̇(t) / V(0) [1/s]", xlabel="time [s]")
    for axes in rows:
        axes.grid(alpha=0.25)
    rows[0].legend(frameon=False, fontsize=8)
    save(figure, folder / "8_lyapunov.png")


def adaptation(client: Client, folder: Path) -> None:
    """Lectures 33 and 34: an arm that knows nothing of its masses learns them on a sine."""
    sine = {"type": "sine", "center": [0.7, 0.0], "amplitude": [0.5, 0.4], "frequency": [0.5, 1.0],
            "duration": 20.0}  # fmt: skip
    learner = {"type": "adaptive", "natural_frequency": 10.0, "Gamma": _GAMMA, "known_zeros": True,
               "estimate": "zero"}  # fmt: skip
    result = client.simulate(NAME, sine, learner, sample_period=0.05, saturate=False)
    labels, true = result.controller.parameter_labels, result.true_parameters
    assert labels is not None
    assert true is not None
    t, estimate = np.array(result.time), np.array(result.estimate)
    figure, rows = plt.subplots(2, 1, figsize=(6.4, 5.4), sharex=True)
    error = 1e3 * np.linalg.norm(result.tracking_error, axis=1)
    rows[0].semilogy(t, np.maximum(error, 1e-3), color=COLOURS[4])
    rows[0].set(title="adaptation from nothing", ylabel="|qʳ − q| [mrad]")
    for label, value, course, colour in zip(labels, true, estimate.T, COLOURS[1:], strict=True):
        rows[1].plot(t, course, color=colour, label=label)
        rows[1].axhline(value, color=colour, ls=":", lw=1.0)
        print(f"adaptation, {label}: {course[-1]:.4f} learned, {value:.4f} true")
    rows[1].set(ylabel="Θ̂(t)", xlabel="time [s]")
    for axes in rows:
        axes.grid(alpha=0.25)
    rows[1].legend(frameon=False, fontsize=8, loc="lower right", ncols=2)
    save(figure, folder / "9_adaptation.png")


def run(client: Client, folder: Path) -> None:
    """All steps in order; pictures go to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    model(client, folder)
    equations(client, folder)
    inverse_kinematics(client, folder)
    gradient(client, folder)
    path = field(client, folder)
    timed = spline(client, folder, path)
    control(client, folder, timed)
    lyapunov(client, folder)
    adaptation(client, folder)


def main() -> None:
    """Ask, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--output", type=Path, default=Path("docs/pictures/course"))
    arguments = parser.parse_args()
    mpl.use("Agg")
    with Client(arguments.url) as client:
        run(client, arguments.output)
    print(f"pictures are in {arguments.output}")


if __name__ == "__main__":
    main()
