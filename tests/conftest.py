"""Property tests are not judged by the clock: the machine is shared. In CI they repeat the same examples."""

import os

from hypothesis import settings

settings.register_profile("unspoken", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if "CI" in os.environ else "unspoken")
