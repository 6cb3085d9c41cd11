"""Collision checks of configurations and of joint motions."""
