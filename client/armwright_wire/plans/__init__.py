"""Requests for plans, tasks and tours, batches, jobs and stored plans."""
