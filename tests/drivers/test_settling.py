"""A process that is nothing but a loop, on systems that allow more or less."""

import os
import resource
import subprocess
import sys

import pytest

from drivers import settling
from drivers.settling import settle_in

# In a process of its own: what is taken is taken for good.
SETTLE = """
import os
from drivers.settling import settle_in
settled = settle_in()
locked = next(line for line in open("/proc/self/status") if line.startswith("VmLck"))
print(int(locked.split()[1]) > 0, settled.words, settled.notes, sep="|")
"""


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="root on Linux is allowed everything")
def test_where_all_is_allowed_it_is_taken() -> None:
    said = subprocess.run([sys.executable, "-c", SETTLE], capture_output=True, text=True, check=True).stdout
    locked, words, notes = said.strip().split("|")
    assert locked == "True"
    assert words.startswith("in a process of its own, real-time priority 80, memory locked")
    assert notes == "()"


def test_what_is_not_allowed_is_said_in_a_sentence_with_the_mend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settling, "permitted_priority", lambda _: 0)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (8 << 20, 8 << 20))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    settled = settle_in()
    assert settled.words == "in a process of its own"
    real_time, memory = settled.notes
    assert "may not run in real time" in real_time
    assert "rtprio 80" in real_time
    assert "memlock unlimited" in memory


def test_of_many_cores_it_takes_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[set[int]] = []
    monkeypatch.setattr(settling, "_lock_memory", lambda: True)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 2, 5})
    monkeypatch.setattr(os, "sched_setaffinity", lambda _, cores: taken.append(cores))
    assert settle_in().words.endswith("memory locked, core 5")
    assert taken == [{5}]
