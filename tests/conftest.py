"""Settings of the whole suite."""

import gc
import os
import sys

# Two workers share two cores: linear algebra that waits with threads of its own would take them from the other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

from tests.workers import ByClock, spares_one, stand_back

# All that is imported stays: there is nothing to look for until then.
gc.disable()

# Hundreds of interpreters are started here: none is to compile anew what another one has compiled.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# The same examples every time, for a suite must not fail by luck; the first may wait for a compiler.
settings.register_profile("house", deadline=None, derandomize=True)
settings.load_profile("house")

# A file that takes a minute and begins last keeps the other core waiting.
LONGEST = (
    "tests/test_",
    "tests/bench/datasheet/",
    "tests/bench/session/",
    "tests/bench/screen/",
    "tests/bench/gallery/",
    "tests/bench/identification/sanity/",
    "tests/bench/sweep/",
    "tests/bench/faults/",
    "tests/bench/cli/test_at_the_terminal.py",
    "tests/sim_backend/test_serve.py",
)


def pytest_configure(config: pytest.Config) -> None:
    stand_back(config)


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> ByClock | None:
    return ByClock(config, log) if spares_one(config) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first; all else as it was."""
    items.sort(key=lambda item: not item.nodeid.startswith(LONGEST))


def pytest_collection_finish() -> None:
    """What was imported stays: going through all of it takes 0.2 s, before every session and a few times in it."""
    gc.enable()
    gc.collect()
    gc.freeze()
