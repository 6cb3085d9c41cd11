"""The command ``armwright``: planning, checking and serving from a shell."""
