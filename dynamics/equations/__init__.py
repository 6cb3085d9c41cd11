"""Equations of a robot as readable formulas, from its Denavit-Hartenberg table."""
