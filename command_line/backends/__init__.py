"""Backends of commands: this process, or a service at a URL."""
