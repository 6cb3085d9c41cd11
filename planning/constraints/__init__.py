"""Constraints on configurations and motions, as values."""
