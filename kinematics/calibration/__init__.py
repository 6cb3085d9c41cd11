"""Kinematic parameters of arms as they are, found from measurements or read from makers' files."""
