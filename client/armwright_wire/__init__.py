"""Requests and answers of the service as models: what the client sends and the service checks."""
