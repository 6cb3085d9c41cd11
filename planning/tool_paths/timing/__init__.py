"""Timing of joint paths that lead the tool."""
