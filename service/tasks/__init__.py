"""The functions that workers run, one module an endpoint."""
