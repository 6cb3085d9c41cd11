"""Values of simulations with every field: motors, errors of the model, references, controllers."""

from typing import Any

_EYE = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
_PAYLOAD = {"mass": 1.5, "center_of_mass": [0.0, 0.0, 0.1], "inertia": _EYE, "link": "hand"}
MOTOR = {
    "inertia": 1e-4, "friction": 1e-5, "torque_constant": 0.1, "back_emf": 0.1, "resistance": 1.0,
    "gear_ratio": 100.0, "voltage_limit": 24.0,
}  # fmt: skip
#: What `POST /v1/simulate` takes beside the motion, the controller and what is around the robot.
SIMULATE: dict[str, Any] = {
    "robot": "panda", "scene": "table", "frame": "base",
    "model_error": {
        "mass_scale": 1.2, "payload": _PAYLOAD, "motor_inertia": 0.1,
        "viscous_friction": [0.1, 0.2], "coulomb_friction": 0.1, "gravity": [0.0, 0.0, -9.0],
        "inertias": {"hand": {"mass": 1.0, "center_of_mass": [0.0] * 3, "inertia": _EYE}},
    },
    "disturbance": {"torque": 1.0, "amplitude": [1.0, 2.0], "frequency": 2.0, "wrench": [1.0] * 6,
                    "start": 0.1, "end": 0.5},
    "initial_state": {"joints": [0.1, 0.2], "velocities": [0.1, 0.2], "offset": [0.01, 0.02],
                      "velocity_offset": [0.01, 0.02]},
    "noise": {"position": 1e-4, "velocity": 1e-3, "period": 0.001},
    "control_period": 0.001, "duration": 2.0, "sample_period": 0.01, "saturate": False,
    "settling_tolerance": 1e-3, "relative_tolerance": 1e-8, "absolute_tolerance": 1e-10,
    "timeout": 5.0, "seed": 3, "motor_inertia": 0.1, "viscous_friction": [0.1, 0.2],
    "coulomb_friction": 0.3, "effort_limits": 20.0,
    "joint_stops": {"stiffness": 1e4, "dissipation": 2.0},
}  # fmt: skip
REFERENCES: list[dict[str, Any]] = [
    {"type": "hold", "joints": [0.1, 0.2], "duration": 2.0},
    {"type": "step", "from": [0.1, 0.2], "to": [0.3, 0.4], "at": 0.5, "duration": 2.0},
    {"type": "sine", "center": [0.1, 0.2], "amplitude": 0.3, "frequency": [0.5, 1.0],
     "phase": 0.1, "duration": 2.0},
    {"type": "spline", "points": [[0.1, 0.2], [0.3, 0.4]], "times": [0.0, 1.0],
     "interpolation": "natural_spline"},
]  # fmt: skip
_GAINS = {"natural_frequency": 10.0, "damping": 1.0}
CONTROLLERS: list[dict[str, Any]] = [
    {"type": "independent_joint", "Kp": 1.0, "Kd": [1.0, 2.0], "inertia": 0.1,
     "motors": [MOTOR]} | _GAINS,
    {"type": "computed_torque", "Kp": 1.0, "Kd": 2.0} | _GAINS,
    {"type": "pd_gravity", "Kp": [[1.0, 0.0], [0.0, 1.0]], "Kd": 2.0} | _GAINS,
    {"type": "passivity", "Lambda": 1.0, "K": 2.0} | _GAINS,
    {"type": "adaptive", "Lambda": 1.0, "K": 2.0, "Gamma": 0.5, "estimate": [0.1, 0.2],
     "motors": True, "known_zeros": True, "parameters": ["m1"]} | _GAINS,
]  # fmt: skip
