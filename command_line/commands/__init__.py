"""Commands of ``armwright``, by what they are about."""
