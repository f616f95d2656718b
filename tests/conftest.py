"""Settings of every test."""

from hypothesis import settings

# The same examples on every machine, and no limit on time that a busy one would break.
settings.register_profile("reproducible", derandomize=True, database=None, deadline=None)
settings.load_profile("reproducible")
