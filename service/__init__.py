"""The HTTP service, its storage, workers, jobs and command line."""
