"""`python benchmarks/new_rigs.py [--seed 7]`: what `rig new` writes, identified on its simulated twin to the end.

Every drive that is shipped as actuator and as load, and every torque sensor: about 40 s of processor time each.
"""

import argparse
import tempfile
from pathlib import Path

from norton_bench.errors import BenchError
from norton_bench.rig.load import parse_rig
from norton_bench.rig.new.interview import Interview
from norton_bench.rig.new.options import Prepared
from norton_bench.session.engine import run_session
from norton_bench.session.schema import standard_session
from norton_drivers.errors import DeviceError
from tests.bench.rig.answers import COMBINATIONS, answers


def main() -> None:
    """One line for each bench: how its session ended."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=7)
    seed = parser.parse_args().seed
    for devices in COMBINATIONS:
        print(" ".join(f"{kind:<14}" for kind in devices), _ended(devices, seed), flush=True)


def _ended(devices: tuple[str, str, str], seed: int) -> str:
    rig = parse_rig(Interview(Prepared(answers(*devices)), "new").rig(), place="new.toml", backend="simulated")
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = run_session(rig, standard_session(rig), out=Path(folder), seed=seed)
        except (BenchError, DeviceError) as error:
            return f"{type(error).__name__}: {error}"
    return "done" if found.fit is not None else "done, tables alone"


if __name__ == "__main__":
    main()
