"""Timed motions: trajectories, certificates, simulation, exports."""
