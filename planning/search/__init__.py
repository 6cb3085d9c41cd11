"""Planners of free space and what drives them: straight line, RRT-Connect, shortcuts."""
