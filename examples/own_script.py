"""A script of one's own: it goes on until friction is known well enough, and sees to it that nobody forgets the clamp.

python examples/own_script.py          until coulomb_torque is known to ± 0.5 %
python examples/own_script.py 0.03     to ± 3 %: quicker
"""

import sys
from pathlib import Path
from tempfile import mkdtemp

from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.imposed import ImposedProcedure
from norton_bench.procedures.options import CalibrateOptions, ImposedOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure
from norton_bench.rig.load import load_rig
from norton_bench.session.engine import run_script
from norton_bench.session.operator import Answers
from norton_bench.session.script import Ask, Remark, Script, SoFar

SHORT = ImposedOptions(amplitude=0.3, velocities_rad_s=(-15.0, 15.0), commands=1, duration_s=1.0)
MOST_ROUNDS = 5


class Friction:
    """Rounds of imposed motion until half of the 95 % interval of the Coulomb torque is within ``wanted``, relative."""

    def __init__(self, wanted: float) -> None:
        self.wanted = wanted

    def __call__(self, so_far: SoFar) -> Script:
        yield TareProcedure(TareOptions(duration_s=0.5))
        yield CalibrateProcedure(CalibrateOptions(duration_s=4.0))
        try:
            for number in range(1, MOST_ROUNDS + 1):
                yield ImposedProcedure(SHORT)
                friction = so_far.parameter("coulomb_torque")
                yield Remark(f"after round {number}: {friction}")
                if friction.interval <= self.wanted:
                    break
        finally:
            yield Ask("clamp", "Take the clamp off.")


def main(wanted: str = "0.005") -> None:
    rig = load_rig(Path(__file__).parent.parent / "rigs" / "sim-odrive.toml")
    out = Path(mkdtemp(prefix="norton-bench-"))
    # Nobody is there: whatever is asked is answered with "yes".
    result = run_script(rig, Friction(float(wanted)), out=out, seed=3, answers=Answers(yes=True), live=False)
    rounds = sum(event.kind == "step" and event.text == "imposed" for event in result.measured.events)
    print(f"{result.parameter('coulomb_torque')} after {rounds} round(s), where 0.02 N*m is true")


if __name__ == "__main__":
    main(*sys.argv[1:])
