"""Trajectory optimisation: the shape and the timing of a motion found together."""
