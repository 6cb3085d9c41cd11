"""Constraints on configurations and motions, as values: one kind a file."""
