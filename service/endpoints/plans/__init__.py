"""Kept plans: documents, bundles, replays and pages."""
