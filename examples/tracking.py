"""The two models worked out in the lecture notes, and five controllers on one of them, over HTTP.

    make serve                      # in another terminal
    python examples/tracking.py [--url http://127.0.0.1:8000] [--output docs/pictures]

Compares the service's equations of motion with the closed forms, has the same trajectory followed
by the five controllers whose model is 20 % too heavy, and draws what docs/tracking.md shows.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from armwright_client import Client, Samples, Simulation, Trajectory

Array = NDArray[np.float64]

G0 = 9.81
#: The built-in arm and cart, see docs/robots.md.
M1, M2, L1, C1, C2 = 1.0, 1.0, 1.0, 0.5, 0.5
#: As the file has it: a twelfth, to seven digits.
I1 = I2 = 0.0833333
CART, BOB, ROD, I_BOB = 1.0, 0.2, 0.5, 7.2e-5
CONTROLLERS = {
    "independent_joint": "independent joint",
    "computed_torque": "computed torque",
    "pd_gravity": "PD + gravity",
    "passivity": "passivity",
    "adaptive": "adaptive",
}
COLOURS = dict(
    zip(CONTROLLERS, ("#888888", "#3366cc", "#dd8800", "#118855", "#bb2255"), strict=True)
)


def planar_rr(q: Array, qd: Array) -> tuple[Array, Array, Array]:
    """D, C and G of the planar arm, gravity across its first link (lecture 27)."""
    a, h = M2 * L1 * C2 * np.cos(q[1]), -M2 * L1 * C2 * np.sin(q[1])
    d12 = M2 * C2**2 + a + I2
    D = np.array(
        [[M1 * C1**2 + M2 * (L1**2 + C2**2) + 2 * a + I1 + I2, d12], [d12, M2 * C2**2 + I2]]
    )
    C = h * np.array([[qd[1], qd[0] + qd[1]], [-qd[0], 0.0]])
    g2 = M2 * C2 * G0 * np.cos(q[0] + q[1])
    return D, C, np.array([(M1 * C1 + M2 * L1) * G0 * np.cos(q[0]) + g2, g2])


def cart_pendulum(q: Array, qd: Array) -> tuple[Array, Array, Array]:
    """D, C and G of the pendulum on a cart, upright at 0 (lectures 26 and 33, signs restored)."""
    k = BOB * ROD
    D = np.array([[CART + BOB, -k * np.cos(q[1])], [-k * np.cos(q[1]), I_BOB + k * ROD]])
    C = np.array([[0.0, k * np.sin(q[1]) * qd[1]], [0.0, 0.0]])
    return D, C, np.array([0.0, -k * G0 * np.sin(q[1])])


def compare(client: Client) -> None:
    """Print the largest differences between the service and the closed forms."""
    for name, closed in (("planar_rr", planar_rr), ("cart_pendulum", cart_pendulum)):
        q, qd = np.random.default_rng(0).uniform(-1.4, 1.4, (2, 100, 2))
        found = client.robots.dynamics_batch(name, q, velocities=qd)
        parts = [closed(*state) for state in zip(q, qd, strict=True)]
        worst = [
            float(np.abs(np.array(told) - np.array([part[i] for part in parts])).max())
            for i, told in enumerate((found.mass_matrix, found.coriolis_matrix, found.gravity))
        ]
        base = client.robots.regressor(name, q[0], qd[0], qd[0], known_zeros=True)
        groups = ", ".join(f"{p.name} = {p.value:.6g}" for p in base.base_parameters)
        print(f"{name}: D, C, G differ from the closed forms by {worst}; parameters: {groups}")


def wave(duration: float, frequencies: Array, size: float = 0.6) -> Trajectory:
    """Sums of sines for two joints, read as quintics between samples; begins at rest at zero."""
    t = np.linspace(0.0, duration, round(duration / 0.02) + 1)
    w = 2.0 * np.pi * frequencies[:, None, :]
    angle = w * t[:, None]
    # 1 - cos begins and, after whole periods, ends at rest.
    parts = (1.0 - np.cos(angle), w * np.sin(angle), w**2 * np.cos(angle))
    q, qd, qdd = (size * part.mean(axis=0) for part in parts)
    samples = Samples(time=t.tolist(), position=q, velocity=qd, acceleration=qdd)
    return Trajectory(samples=samples, interpolation="quintic")


def five(client: Client) -> dict[str, Simulation]:
    """The same motion under every controller, each believing in masses 20 % too heavy."""
    motion = wave(6.0, np.array([[0.5, 1.0]]))
    return {
        name: client.simulate(
            "planar_rr",
            motion,
            {"type": name, "natural_frequency": 15.0}
            | ({"Gamma": 3.0} if name == "adaptive" else {}),
            model_error={"mass_scale": 1.2},
            duration=8.0,
            sample_period=0.02,
        )
        for name in CONTROLLERS
    }


def learn_parameters(client: Client) -> Simulation:
    """A motion rich enough to learn all parameters from, begun with the same wrong ones."""
    rich = wave(40.0, np.array([[0.35, 0.55], [0.85, 0.65], [1.25, 1.45]]), 0.9)
    controller = {"type": "adaptive", "natural_frequency": 8.0, "Gamma": 10.0}
    return client.simulate(
        "planar_rr", rich, controller, model_error={"mass_scale": 1.2}, saturate=False,
        sample_period=0.1,
    )  # fmt: skip


def save(figure: Figure, path: Path) -> None:
    """Write a figure, its panels with a grid and without a frame."""
    for axes in figure.axes:
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def draw_five(found: dict[str, Simulation], path: Path) -> None:
    """Error and Lyapunov function of all controllers."""
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(7.2, 5.4), sharex=True)
    for name, result in found.items():
        error = 1e3 * np.linalg.norm(result.tracking_error, axis=1)
        top.semilogy(result.time, np.maximum(error, 1e-4), color=COLOURS[name], lw=1.4,
                     label=CONTROLLERS[name])  # fmt: skip
        V = np.array(result.lyapunov)
        bottom.semilogy(result.time, np.maximum(V, 1e-9), color=COLOURS[name], lw=1.4)
    top.set(
        ylabel="|qʳ − q|  [mrad]",
        ylim=(3e-3, 4e2),
        title="planar RR, model 20 % too heavy, w = 15 rad/s",
    )
    bottom.set(ylabel="V(t)", xlabel="time [s]", ylim=(1e-4, 1e2))
    top.legend(ncols=5, frameon=False, fontsize=7.5, loc="lower left")
    save(figure, path)


def draw_parameters(result: Simulation, path: Path) -> None:
    """The estimates on their way to the truth."""
    assert result.estimate is not None
    assert result.true_parameters is not None
    estimate, true = np.array(result.estimate), np.array(result.true_parameters)
    names = result.controller.parameter_names or []
    figure, axes = plt.subplots(figsize=(7.2, 3.2))
    for k, name in enumerate(names):
        (line,) = axes.plot(result.time, estimate[:, k], lw=1.4, label=name)
        axes.axhline(true[k], color=line.get_color(), lw=0.8, ls=":")
    axes.set(xlabel="time [s]", ylabel="estimate", title="adaptive control, exciting reference")
    axes.legend(ncols=3, frameon=False, fontsize=8)
    save(figure, path)


def draw_cart(client: Client, path: Path) -> None:
    """The pendulum swung from hanging to upright while the cart is at rest at both ends."""
    up = [np.pi, 0.0, 0.0, -10.0 * np.pi / 8.0, 15.0 * np.pi / 16.0, -6.0 * np.pi / 32.0]
    side = [0.0, 0.0, 0.0, 10.0 * 0.5 / 8.0, -15.0 * 0.5 / 16.0, 6.0 * 0.5 / 32.0]
    swing = Trajectory.model_validate(
        {"segments": [{"t0": 0.0, "t1": 2.0, "coefficients": [side, up]}]}
    )
    result = client.simulate(
        "cart_pendulum",
        swing,
        {"type": "computed_torque", "natural_frequency": 8.0},
        initial_state={"offset": [0.1, -0.3]},
        duration=2.5,
        saturate=False,
    )
    figure, axes = plt.subplots(1, 2, figsize=(7.2, 2.8))
    q, wanted = np.array(result.position), np.array(result.reference.position)
    for j, (name, colour) in enumerate((("x [m]", "#3366cc"), ("φ [rad]", "#bb2255"))):
        axes[0].plot(result.time, wanted[:, j], color=colour, lw=0.9, ls=":")
        axes[0].plot(result.time, q[:, j], color=colour, lw=1.4, label=name)
    t = np.array(result.time)
    envelope = (1.0 + 8.0 * t) * np.exp(-8.0 * t)
    for j, colour in enumerate(("#3366cc", "#bb2255")):
        error = np.array(result.tracking_error)[:, j]
        axes[1].plot(t, error / error[0], color=colour, lw=1.4)
    axes[1].plot(t, envelope, color="black", lw=0.9, ls=":", label="(1 + wt) exp(−wt)")
    axes[0].set(xlabel="time [s]", title="from hanging to upright")
    axes[1].set(xlabel="time [s]", title="error over its first value")
    for panel in axes:
        panel.legend(frameon=False, fontsize=8)
    save(figure, path)
    off = np.abs(np.array(result.tracking_error)[:, 1] / 0.3 - envelope).max()
    print(f"cart_pendulum: the error differs from the placed poles' by {off:.1e} of its start")


def tell(found: dict[str, Simulation]) -> None:
    """Print the table of the five controllers."""
    print("controller          largest error   in the last second   V never grows")
    for name, result in found.items():
        error = 1e3 * np.linalg.norm(result.tracking_error, axis=1)
        moving = np.array(result.time) <= 6.0
        late = error[moving & (np.array(result.time) >= 5.0)].max()
        V = np.array(result.lyapunov)
        falls = bool((np.diff(V) <= 1e-9 * V.max()).all())
        print(f"{CONTROLLERS[name]:18}{error.max():10.2f} mrad{late:16.2f} mrad   {falls}")


def main() -> None:
    """Ask, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--url", default="http://127.0.0.1:8000")
    parser.add_argument("--output", type=Path, default=Path("docs/pictures"))
    arguments = parser.parse_args()
    mpl.use("Agg")
    arguments.output.mkdir(parents=True, exist_ok=True)
    with Client(arguments.url) as client:
        compare(client)
        found = five(client)
        tell(found)
        draw_five(found, arguments.output / "five_controllers.png")
        draw_parameters(learn_parameters(client), arguments.output / "adaptation.png")
        draw_cart(client, arguments.output / "cart_pendulum.png")
    print(f"pictures are in {arguments.output}")


if __name__ == "__main__":
    main()
