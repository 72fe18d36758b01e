"""What holds for all tests."""

from hypothesis import settings

settings.register_profile("untimed", deadline=None)  # machines differ; no test asserts a time
settings.load_profile("untimed")
