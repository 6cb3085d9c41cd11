"""Integrators of the closed loop, with error estimates."""
