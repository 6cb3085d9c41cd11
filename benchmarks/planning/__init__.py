"""Kinds of motion planning: clearance, constraints, optimisation and seams."""
