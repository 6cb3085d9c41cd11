"""The layer around the application: connections, checks, admission, and one middleware."""
