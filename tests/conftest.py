"""Settings of the whole suite."""

import os

# Two workers share two cores: linear algebra that waits with threads of its own would take them from the other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypothesis import settings

# The same examples every time, for a suite must not fail by luck; the first may wait for a compiler.
settings.register_profile("house", deadline=None, derandomize=True)
settings.load_profile("house")
