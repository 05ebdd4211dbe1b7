"""What an identified network is good for: the free motion under a command, and the torque under an imposed motion.

python examples/use_network.py runs/.../sim-odrive.network.json
"""

import sys
from pathlib import Path

import numpy as np

from norton_bench.models.network import NortonNetwork

TICK_S = 1e-3


def main(path: Path) -> None:
    network = NortonNetwork.load(path)
    low, high = network.thresholds
    for term in network.terms:
        print(f"beside the paper's motor it has {term.name}: {term.term.equation}, {term.named()}")
    print(f"the shaft breaks away at commands of {low:.4g} and {high:.4g} {network.command_unit}")
    command = np.full(2000, 2 * high)
    _, velocity_rad_s, _ = network.free_motion(command, TICK_S)
    print(f"free, at a command of {2 * high:.4g}: {velocity_rad_s[-1]:.4g} rad/s after 2 s")
    print(f"its static source says {network.source_velocity(2 * high):.4g} rad/s")
    held = np.zeros(2000)
    torque_nm = network.torque(command, held, TICK_S)
    print(f"held still from the start, the same command gives {torque_nm[-1]:.4g} N m at the port")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
