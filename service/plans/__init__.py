"""Kept plans: their documents, bundles and replays."""
