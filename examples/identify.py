"""Run a session from Python, on the simulated bench, and look at what came of it.

python examples/identify.py                       the standard session
python examples/identify.py sessions/quick.toml   a session file, which names its rig
"""

import sys
from pathlib import Path
from tempfile import mkdtemp

from norton_bench.rig.load import load_rig
from norton_bench.session.engine import run_session
from norton_bench.session.schema import load_session, standard_session

RIG = Path(__file__).parent.parent / "rigs" / "sim-odrive.toml"


def main(session_file: str | None = None) -> None:
    session = standard_session() if session_file is None else load_session(session_file)
    rig = load_rig(session.rig or RIG)
    result = run_session(rig, session, out=Path(mkdtemp(prefix="norton-bench-")), seed=1)
    fit = result.fit
    assert fit is not None
    for estimate in fit.estimates:
        print(
            f"{estimate.name:22} {estimate.value:10.4g} ± {estimate.std:.2g} {estimate.unit} ({estimate.status.value})"
        )
    print(f"what the data cannot tell: {'; '.join(fit.verdict) or 'nothing was asked that they cannot'}")
    print(f"recording {result.recording}\nnetwork   {result.network_file}\nreport    {result.report_file}")


if __name__ == "__main__":
    main(*sys.argv[1:])
