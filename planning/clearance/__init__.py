"""Preferred clearance: paths led away from what they pass where there is space."""
