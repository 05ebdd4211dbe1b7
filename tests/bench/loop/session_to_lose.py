"""A session in a process of its own, to be killed or stopped: it pushes until then. Arguments: the rig file."""

import sys

import numpy as np

from norton_bench.loop.process import LoopProcess
from norton_bench.procedures.waves import coasting
from norton_bench.rig.load import load_rig
from norton_bench.segments import Use

if __name__ == "__main__":
    with LoopProcess(load_rig(sys.argv[1], backend="hardware")) as loop, loop.running():
        print(loop.pid, flush=True)
        loop.run(coasting("test", "push", Use.PREPARE, np.full(30_000, 0.05)))
