"""A session of one's own: other steps, other amplitudes, another true actuator behind the same wires.

python examples/own_session.py      8 s of each multisine
python examples/own_session.py 2    2 s: quicker, and less certain
"""

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

from norton_bench.procedures.options import CalibrateOptions, FreeOptions, ImposedOptions, TareOptions
from norton_bench.rig.load import load_rig
from norton_bench.session.engine import run_session
from norton_bench.session.schema import Session, Step


def own_session(multisine_s: float) -> Session:
    steps = (
        Step("tare", TareOptions(duration_s=1.0)),
        Step("calibrate", CalibrateOptions(duration_s=6.0)),
        Step("free", FreeOptions(amplitude=0.5, levels=7, dwell_s=0.3, duration_s=multisine_s)),
        Step("imposed", ImposedOptions(amplitude=0.4, commands=2, duration_s=multisine_s)),
    )
    return Session(steps, place=__file__)


def main(multisine_s: str = "8") -> None:
    rig = load_rig(Path(__file__).parent.parent / "rigs" / "sim-odrive.toml")
    heavier = {**rig.simulated, "actuator": {**rig.simulated["actuator"], "inertia": "8e-5 kg*m^2"}}
    session, out = own_session(float(multisine_s)), Path(mkdtemp(prefix="norton-bench-"))
    # Nobody watches: nothing is to be identified before the end.
    result = run_session(replace(rig, simulated=heavier), session, out=out, seed=2, live=False)
    assert result.fit is not None
    inertia = result.fit.estimate("inertia")
    print(f"inertia {inertia.value:.3g} ± {inertia.std:.1g} {inertia.unit}, where 8e-05 is true")


if __name__ == "__main__":
    main(*sys.argv[1:])
