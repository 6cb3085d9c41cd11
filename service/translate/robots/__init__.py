"""Robots from wire to domain and back: descriptions, archives, limits, motors, visuals."""
