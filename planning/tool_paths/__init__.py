"""Planners of tool motions: lines, arcs and seams."""
