"""Settings of hypothesis for all tests: the same examples every time, no clock, nothing on disk."""

from hypothesis import settings

#: Examples of each property: enough for its corners, few enough for a tenth of a second.
_EXAMPLES = 60

settings.register_profile(
    "reproducible", derandomize=True, deadline=None, database=None, max_examples=_EXAMPLES
)
settings.load_profile("reproducible")
