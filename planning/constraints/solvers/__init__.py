"""Solvers of inverse kinematics under constraints."""
