"""One whole session on the simulated bench, performed once in a run: many look at what it left."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from norton_bench.events import Ended, PartMeasured, SessionEvent
from norton_bench.identification.results import LiveEstimate
from norton_bench.procedures.options import CalibrateOptions, FreeOptions, ImposedOptions, TareOptions, ValidateOptions
from norton_bench.result import Result
from norton_bench.rig.load import load_rig
from norton_bench.session.engine import run_session
from norton_bench.session.schema import Session, Step
from tests.bench.once import once

RIG = load_rig(Path(__file__).parents[2] / "rigs" / "sim-odrive.toml")
SEED = 5
TARE = Step("tare", TareOptions(duration_s=0.5))
CALIBRATE = Step("calibrate", CalibrateOptions(duration_s=4.0))
SESSION = Session(
    (
        TARE,
        CALIBRATE,
        Step("free", FreeOptions(levels=5, dwell_s=0.2, duration_s=3.0)),
        Step("imposed", ImposedOptions(velocities_rad_s=(-20.0, 20.0), commands=2, duration_s=4.0)),
        Step("validate", ValidateOptions(duration_s=2.0)),
    ),
    place="sessions/short.toml",
)


@dataclass(frozen=True)
class Performed:
    """The session, its live estimates, one a part, and its folder, in which nobody else writes."""

    result: Result
    live: list[LiveEstimate]
    summary: Ended
    out: Path


def whole_session(factory: pytest.TempPathFactory) -> Performed:
    return once(factory, "whole session", _perform)


def _perform(out: Path) -> Performed:
    events: list[SessionEvent] = []
    result = run_session(RIG, SESSION, out=out, seed=SEED, on_event=events.append)
    assert isinstance(events[-1], Ended)
    live = [event.live for event in events if isinstance(event, PartMeasured)]
    return Performed(result, live, events[-1], out)
