"""Tools by name."""
