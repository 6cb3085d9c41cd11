"""Strict readers of untrusted XML, YAML and mesh URIs."""
