"""Property tests draw the same cases in every run; HYPOTHESIS_PROFILE=search draws new ones, to hunt with."""

import os

from hypothesis import settings

settings.register_profile("same", derandomize=True)
settings.register_profile("search", print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))
