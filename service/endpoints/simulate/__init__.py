"""Closed-loop simulation of a motion under a controller."""
