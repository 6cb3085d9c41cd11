"""Checks before planning: a valid start, configurations of the goals, the checkers to plan with."""
