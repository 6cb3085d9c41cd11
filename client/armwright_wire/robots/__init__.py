"""Robots, and what follows from a robot and a state alone."""
