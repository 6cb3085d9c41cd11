"""Controllers that make a robot follow a trajectory, and the closed loop to try them in."""
