"""Robots by name, built-in ones among them."""
