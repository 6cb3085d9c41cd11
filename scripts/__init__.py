"""Programs for developers: documentation, wheels, audits."""
