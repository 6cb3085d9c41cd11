"""Geometric paths: blended corners, merged and simplified waypoints."""
