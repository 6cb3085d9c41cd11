"""Scenes of named obstacles, and MoveIt planning scenes."""
