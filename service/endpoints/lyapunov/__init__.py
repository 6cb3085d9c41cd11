"""Lyapunov functions of linear systems and of formulas."""
