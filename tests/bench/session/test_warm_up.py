"""Nothing is left to compile once the bench is warm."""

import subprocess
import sys

# What Python calls; the others are compiled within them.
COUNT = """
from norton_bench.control import core
from norton_bench.identification import loops
from norton_bench.identification.friction import operators, sums
from norton_bench.models import network_steps
from norton_bench.session.warm_up import warm_up

warm_up()
called = {core: "sense track feed_forward pass_on advance put_first".split(), network_steps: ["free_motion"]}
called[loops] = "count_readings filter_at friction_path lag_of_held mean_lag_of_held".split()
called |= {operators: "bristle stops elasto_plastic".split(), sums: ["part_sums"]}
print([name for module, names in called.items() for name in names if not getattr(module, name).signatures])
"""


def test_every_function_that_is_called_has_been_compiled() -> None:
    told = subprocess.run([sys.executable, "-c", COUNT], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
