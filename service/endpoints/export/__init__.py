"""Exports of motions for robot controllers."""
