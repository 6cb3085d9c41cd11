"""Trajectories as piecewise polynomials of time."""
