"""Shapes, scenes, and every question about distance: projection, collision, clearance, motion."""
