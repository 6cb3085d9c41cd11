"""Sampling-based planning by OMPL, whole certified edges at a time."""
