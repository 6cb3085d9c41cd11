"""Scenes and checks of states against them."""
