"""A process that is nothing but a loop, on systems that allow more or less."""

import os
import resource
import subprocess
import sys

import pytest

from norton_drivers import settling
from norton_drivers.settling import settle_in

# In a process of its own: what is taken is taken for good.
SETTLE = """
import os
from norton_drivers.settling import settle_in
settled = settle_in(3)
locked = next(line for line in open("/proc/self/status") if line.startswith("VmLck"))
print(int(locked.split()[1]) > 0, settled.words, settled.notes, sep="|")
"""


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="root on Linux is allowed everything")
def test_where_all_is_allowed_it_is_taken() -> None:
    said = subprocess.run([sys.executable, "-c", SETTLE], capture_output=True, text=True, check=True).stdout
    locked, words, notes = said.strip().split("|")
    assert locked == "True"
    assert words.startswith("in a process of its own, real-time priority 80, memory locked, core 3")
    assert notes == "()"


def test_what_is_not_allowed_is_said_in_a_sentence_with_the_mend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settling, "permitted_priority", lambda _: 0)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (8 << 20, 8 << 20))
    settled = settle_in(None)
    assert settled.words == "in a process of its own"
    assert settled.core is None
    real_time, memory = settled.notes
    assert "may not run in real time" in real_time
    assert "rtprio 80" in real_time
    assert "memlock unlimited" in memory
