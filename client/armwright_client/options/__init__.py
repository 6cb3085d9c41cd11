"""Options of requests, as keyword arguments."""
