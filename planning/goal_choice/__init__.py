"""The choice among configurations of a goal."""
