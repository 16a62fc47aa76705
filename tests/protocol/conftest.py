"""Property tests are not judged by the clock: the machine is shared."""

from hypothesis import settings

settings.register_profile("unspoken", deadline=None)
settings.load_profile("unspoken")
