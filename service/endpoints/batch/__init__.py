"""Batches of planning problems, always as a job."""
