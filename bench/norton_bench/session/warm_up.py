"""Compile all compiled code before anything is opened: the first run takes seconds for it, later ones only load it."""

from dataclasses import replace
from functools import cache

import numpy as np

from norton_bench.control.admittance import AdmittanceController, Design
from norton_bench.control.calibration import ActuatorFriction, LoadCalibration
from norton_bench.control.design import DOUBTS, EFFORTS, TorqueGains, Tracking, doubting_observer, nominal_bench
from norton_bench.control.preview import high_passed
from norton_bench.control.regulator import design_regulator
from norton_bench.control.torque_loop import Anticipation
from norton_bench.identification.current import Known, fit_current
from norton_bench.identification.friction_laws import family_for
from norton_bench.identification.friction_model import Path
from norton_bench.identification.friction_operators import part_sums
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.regression import Regression
from norton_bench.identification.shape import Shape
from norton_bench.identification.signals import Port, Signals, signals
from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import NetworkTerm
from norton_bench.records import CURRENT, MOTION, NO_DEVICE_TIME, TICK, TORQUE, Measured, SegmentInfo
from norton_bench.segments import Use

TICK_S = 1e-3
DURATION_S = 3.0
COMMAND_UNIT = "N*m"
# The values do not matter.
NETWORK = NortonNetwork(1.0, 500.0, 1e-4, 1e-3, 0.02, 10.0, 0.01, command_unit=COMMAND_UNIT)
SHAPE = Shape(500.0, 500.0, TICK_S, 0.0)
TERMS = (NetworkTerm("asymmetry", (0.1,)), NetworkTerm("saturation", (0.1,)))
FRICTION = ActuatorFriction(1e-3, 0.02, 10.0, 0.01)
LOAD = LoadCalibration(
    1.0, 1e3, 1e-4, 1e-3, 0.01, 10.0, 0.01, 1.5e-3, 0.0, 200.0, 0.01, 1e-3, 0.0, 5e-5, -1e-3, 1e-4, FRICTION
)


@cache  # once for each process
def warm_up() -> None:
    """Call all compiled code once, with made-up readings; the results are not used."""
    measured = _made_up()
    _warm_fit(signals(measured, TICK_S, Use.CALIBRATE, Port.ACTUATOR))
    AdmittanceController(LOAD, TICK_S, torque_limit_nm=1.0, design=_made_up_design())
    NETWORK.free_motion([0.0], TICK_S)
    high_passed(np.zeros(1), 0.5)
    _warm_friction()


def _warm_fit(stretches: tuple[Signals, ...]) -> None:
    """Call once what a fit computes in every step of its search; the search itself would take a second."""
    regression = Regression.of(stretches, FULL_BAND).recounted(SHAPE)
    columns, _ = regression.columns(SHAPE)
    regression.jacobian(SHAPE, columns, np.ones(len(columns)))
    composed = replace(SHAPE, terms=TERMS)
    regression.with_terms(TERMS, 0.0, regression.middle_s).columns(composed)
    fit_current(stretches, Known(SHAPE.bandwidth_rad_s, 0.1), SHAPE.command_delay_s, Known(1.0, 0.1))


def _warm_friction() -> None:
    """The friction models of the comparison."""
    swing = np.sin(np.arange(20.0))
    path = Path(TICK_S, swing, swing, np.zeros(1, dtype=np.int64))
    for model in family_for(path):
        columns = model.columns(path, np.ones(len(model.unknowns)) * 0.5)
        part_sums(columns, swing, np.zeros(len(swing), dtype=np.int64))


def _made_up_design() -> Design:
    """Of the right shapes: a search for gains with margins takes a second, and compiles nothing."""
    bench = nominal_bench(LOAD, TICK_S)
    observer = doubting_observer(LOAD, bench, DOUBTS[0], (1.0, 1.0, 1.0), TICK_S)
    gains = TorqueGains(0.0, 0.0, 1.0, 0.0)
    tracking = Tracking(observer, design_regulator(bench, EFFORTS[0], TICK_S))
    return Design(tracking, gains, Anticipation(observer, LOAD.drive_delay_s, gains))


def _made_up() -> Measured:
    """Two sines, as an encoder and a sensor would read them."""
    time_s = np.arange(round(DURATION_S / TICK_S)) * TICK_S
    position = np.sin(20 * time_s) + 0.1 * np.sin(90 * time_s)
    command = 0.1 * np.sin(50 * time_s)
    stamp_ns = np.round(time_s * 1e9).astype(np.int64)
    ticks, motion = np.zeros(len(time_s), TICK), np.zeros(len(time_s), MOTION)
    torque, current = np.zeros(len(time_s), TORQUE), np.zeros(len(time_s), CURRENT)
    ticks["tick_ns"], ticks["command"], ticks["load_torque_nm"] = stamp_ns, command, 0.1 * np.cos(30 * time_s)
    for table in (motion, torque, current):
        table["arrival_ns"], table["sequence"] = stamp_ns, np.arange(len(time_s))
        table["device_ns"] = NO_DEVICE_TIME
    motion["position_rad"] = np.round(position / 1e-4) * 1e-4
    torque["torque_nm"], torque["valid"] = NETWORK.torque(command, position, TICK_S), True
    current["current_a"] = command
    segment = SegmentInfo(0, "warm up", "sines", Use.CALIBRATE, "torque", 0, int(stamp_ns[-1]))
    return Measured(ticks, motion, motion, torque, current, segments=(segment,))
