"""Quadratic Lyapunov functions of linear systems."""
