"""API keys, scopes and limits of callers."""
