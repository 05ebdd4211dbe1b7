"""A made-up experiment on a motor with Dahl friction, computed here with its own crude integrator."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.conditions import Condition
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.friction_laws import model
from norton_bench.identification.impedance_table import ImpedanceTable
from norton_bench.identification.in_situ import InSituResult, SourceMotion
from norton_bench.identification.ladder import Rung
from norton_bench.identification.rendered import Rendered
from norton_bench.identification.residual_tests import Dependence, Harmonic, Memory, ResidualTests
from norton_bench.identification.results import BlockedMap, FitResult, LiveEstimate, SourceMap, Trace, Validation
from norton_bench.identification.trials import TrialFigures
from norton_bench.identification.without_model import Prediction, StopOperator, WithoutModel
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import PARAMETERS, Estimate, Status
from norton_bench.records import MOTION, TICK, TORQUE, Event, Measured, SegmentInfo
from norton_bench.result import Result
from norton_bench.segments import Admittance, Use

TICK_S = 1e-3
START_NS = 5_000_000_000
GAIN, DAMPING, COULOMB, STIFFNESS, INERTIA = 0.9, 1e-3, 0.02, 10.0, 5e-5
VALUES = (GAIN, 600.0, INERTIA, DAMPING, COULOMB, STIFFNESS, 0.01)
TRIALS = tuple(TrialFigures(n, torque, 2.9e-4, 1.5e-4) for n, torque in enumerate((1e-2, 4e-4, 3e-4, 3e-4, 3e-4), 1))
LAW_RENDERED = Rendered(Admittance(5e-4, 2e-2), (4.9e-4, 2.04e-2, 1e-3), (2e-5, 3e-4, 2e-3), 1.2e-2, 1.1e-3, 8e-4)
IN_SITU = InSituResult(
    tuple(
        TrialFigures(n, torque, 1e-4, 1e-4, driven=torque < 1e-3)
        for n, torque in enumerate((1e-2, 2e-4, 1e-4, 1e-2, 1e-4, 1e-4), 1)
    ),
    SourceMotion(TICK_S, np.linspace(0, 0.1, 4000), np.linspace(0, 20, 4000), np.linspace(0, 10, 4000), 8e-3),
    ("the load's inertia is 1.26e-4 kg*m^2",),
)
NETWORK = NortonNetwork(*VALUES, command_unit="N*m")


def friction(velocity_rad_s: np.ndarray) -> np.ndarray:
    """Dahl torque along a motion, by the exact flow over each step."""
    torque = np.zeros(len(velocity_rad_s))
    for k in range(1, len(torque)):
        step = velocity_rad_s[k] * TICK_S
        end = COULOMB * np.sign(step)
        torque[k] = end + (torque[k - 1] - end) * np.exp(-STIFFNESS * abs(step) / COULOMB)
    return torque


def imposed() -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[tuple[str, int], ...]]:
    """Velocity, reference velocity and command of small loops, a velocity grid and a validation; names and lengths."""
    t = np.arange(1000) * TICK_S
    loops = [a * 2 * np.pi * 4 * np.sin(2 * np.pi * 4 * t) for a in (0.5e-3, 1.5e-3, 5e-3)]
    steps = np.repeat([0.0, 6.0, -6.0, 24.0, -24.0, 48.0, -48.0], 400)
    smooth = np.convolve(np.pad(steps, 50, mode="edge"), np.ones(101) / 101, mode="valid")
    grid = [(smooth, level) for level in (-0.08, 0.0, 0.08)]
    wave = sum(np.sin(2 * np.pi * f * np.arange(4000) * TICK_S + f**2) * 12 / f for f in (0.7, 1.9, 4.3, 9.1, 17.3))
    wave *= np.minimum(1.0, np.arange(4000) / 400)
    pieces = [(loop, 0.0) for loop in loops] + grid + [(wave, 0.03)]
    names = [
        *(f"loop {mrad} mrad" for mrad in (0.5, 1.5, 5)),
        "grid -0.08",
        "grid +0",
        "grid +0.08",
        "imposed multisine",
    ]
    velocity = np.concatenate([piece for piece, _ in pieces])
    command = np.concatenate([np.full(len(piece), level) for piece, level in pieces])
    return velocity, velocity, command, tuple(zip(names, (len(piece) for piece, _ in pieces), strict=True))


def measured_from(velocity: np.ndarray, command: np.ndarray, torque: np.ndarray, names) -> Measured:
    rng = np.random.default_rng(1)
    count = len(velocity)
    stamps = START_NS + np.arange(count) * 1_000_000
    ticks = np.zeros(count, TICK)
    ticks["tick_ns"] = stamps
    ticks["lateness_ns"] = rng.gamma(2.0, 3000.0, count)
    ticks["work_ns"] = 60_000 + rng.gamma(2.0, 15_000.0, count)
    ticks["command"] = command
    ticks["reference_velocity_rad_s"] = velocity
    for column in ("torque_age_ns", "motion_age_ns", "load_motion_age_ns"):
        ticks[column] = 300_000 + rng.integers(0, 900_000, count)
    ticks["limited"][100:107] = 1
    motion = np.zeros(count, MOTION)
    motion["arrival_ns"] = stamps + rng.integers(-100_000, 100_000, count)
    motion["sequence"] = np.arange(count)
    motion["position_rad"] = np.cumsum(velocity) * TICK_S
    motion["velocity_rad_s"] = velocity
    sensed = np.zeros(count, TORQUE)
    sensed["arrival_ns"] = stamps
    sensed["sequence"] = np.arange(count)
    sensed["torque_nm"] = torque
    starts = np.cumsum([0, *(length for _, length in names)])
    segments = tuple(
        SegmentInfo(
            index,
            "imposed",
            name,
            Use.VALIDATE if "multisine" in name else Use.IDENTIFY,
            "admittance",
            int(START_NS + first * 1_000_000),
            int(START_NS + last * 1_000_000),
        )
        for index, ((name, _), first, last) in enumerate(zip(names, starts[:-1], starts[1:], strict=True))
    )
    kept = np.delete(np.arange(count), [4000, 4001, 9000])
    return Measured(
        ticks=ticks,
        motion=motion,
        torque=sensed[kept],
        segments=segments,
        events=(Event(START_NS + 2_000_000_000, "note", "tare: bias 3.1 mN·m <removed>"),),
    )


def estimates(factor: float = 1.0, share: float = 0.004) -> tuple[Estimate, ...]:
    return tuple(
        Estimate(parameter.name, value * factor, value * share, parameter.unit_for("N*m"), Status.VALID)
        for parameter, value in zip(PARAMETERS, VALUES, strict=False)
    )


def table() -> ImpedanceTable:
    command, velocity = np.array([-0.08, 0.0, 0.08]), np.array([-40.0, -16.0, -4.0, 4.0, 16.0, 40.0])
    torque = GAIN * command[:, None] - DAMPING * velocity - COULOMB * np.sign(velocity)
    torque[0, 5] = np.nan
    return ImpedanceTable(command, velocity, torque, np.full_like(torque, 1e-4), np.full_like(torque, 0.3))


def without_model(trace: Trace) -> WithoutModel:
    yields = np.geomspace(2e-5, 0.2, 14)
    strength = np.zeros((2, 14))
    strength[1, 6:8] = COULOMB / 2
    operator = StopOperator(yields, strength, np.zeros((2, 14)), INERTIA, DAMPING, np.full(20, GAIN / 20))
    figures = (Prediction(1.56e-2, 0.6, 0.93), Prediction(1.13e-3, 0.0145, 1.0), Prediction(2.2e-3, 0.03, 1.0))
    return WithoutModel(table(), operator, trace, trace, *figures)


def residuals() -> ResidualTests:
    lags_s, input_lags_s = np.arange(1, 26) * 3e-3, np.arange(-4, 9) * 3e-3
    spectrum = np.full(256, 2e-5)
    spectrum[41] = 3e-4
    memory = Memory(lags_s, 0.1 * 0.8 ** np.arange(25), np.full(25, 0.014), 1e-60)
    bell = np.exp(-((input_lags_s / 5e-3) ** 2))
    followed = (
        Dependence("command", input_lags_s, 0.004 * bell, np.full(13, 0.014), 0.6, 0.0, 0.0, 3.0),
        Dependence("velocity", input_lags_s, 0.02 * bell, np.full(13, 0.014), 1e-5, 0.004, 6e-5, 3.0),
        Dependence("acceleration", input_lags_s, 0.2 * bell, np.full(13, 0.014), 1e-20, 0.05, 2.2e-4, 110.0),
    )
    return ResidualTests(1e-3, memory, followed, (Harmonic(42, 3e-4, 1e-30),), spectrum)


def rung(
    name: str, train: float, held_out: float, std: float, *, selected: bool = False, converged: bool = True
) -> Rung:
    """One line of the ladder, its errors over a torque of 0.1 N·m."""
    nothing = np.zeros(0)
    fit = FrictionFit(
        model(name), (), nothing, np.zeros((0, 0)), nothing, nothing, nothing.astype(bool), nothing, converged, ()
    )
    return Rung(model(name), fit, 0.1 * train, 0.1 * held_out, 0.1 * std, 0.1, (), selected)


@pytest.fixture(scope="session")
def full() -> Result:
    """A report with everything in it."""
    rng = np.random.default_rng(2)
    velocity, _, command, names = imposed()
    acceleration = np.clip(np.gradient(velocity, TICK_S), -2000, 2000)
    predicted = GAIN * command - DAMPING * velocity - friction(velocity) - INERTIA * acceleration
    ripple = 3e-4 * np.sin(42 * np.cumsum(velocity) * TICK_S)
    torque = predicted + ripple + 1e-3 * rng.normal(size=len(velocity))
    time_s = np.arange(len(velocity)) * TICK_S
    fitted = np.where(time_s < time_s[-4000], torque, np.nan)
    trace = Trace(time_s, fitted, predicted, "N*m")
    last = slice(-4000, None)
    levels = np.concatenate([np.linspace(-0.08, 0.08, 11), np.linspace(0.08, -0.08, 11)])
    steady = NETWORK.source_velocity(levels) + rng.normal(0, 0.2, 22)
    blocked = np.repeat(np.linspace(-0.06, 0.06, 5), 2)
    above = np.tile([True, False], 5)
    live = tuple(
        LiveEstimate(
            int(START_NS + second * 1e9 / 4),
            estimates(1 + 0.2 * np.exp(-second / 6) * np.cos(second), 0.1 * np.exp(-second / 8) + 0.004),
            None,
            250 * second,
        )
        for second in range(1, 50)
    )
    fit = FitResult(
        estimates=(
            *estimates(),
            Estimate("torque_constant", np.nan, np.nan, "N*m/A", Status.UNEXCITED),
        ),
        network=NETWORK,
        converged=True,
        torque_rms_nm=1.05e-3,
        torque_relative=0.013,
        samples=len(velocity) - 4000,
        command_delay_s=1.2e-4,
        command_delay_std_s=3e-6,
        motion_delay_s=-4.1e-4,
        motion_delay_std_s=2e-6,
        trace=trace,
        verdict=("Km and Ka are known only as a product: no current was measured.",),
    )
    free = 20 * np.sin(2 * np.pi * 1.3 * time_s[last]) + 8 * np.sin(2 * np.pi * 5.1 * time_s[last])
    return Result(
        rig_name="sim-odrive",
        rig_text='[rig]\nname = "sim-odrive"  # <a rig>\n',
        metadata={
            "rig": "sim-odrive",
            "rig_file": "rigs/sim-odrive.toml",
            "backend": "simulated",
            "session": "",
            "seed": "7",
            "command_unit": "N*m",
            "tick_s": "0.001",
            "started": "2026-11-21T10:00:00+00:00",
            "recording": "sim-odrive.mcap",
            "numpy": "2.4.6",
        },
        fit=fit,
        validation=Validation(
            1.1e-3,
            0.014,
            0.21,
            0.012,
            Trace(time_s[last], torque[last], predicted[last], "N*m"),
            Trace(time_s[last], free + 0.2 * rng.normal(size=4000), free, "rad/s"),
        ),
        source_map=SourceMap(
            levels, steady, np.full(22, 0.2), np.arange(22) < 11, steady + rng.normal(0, 0.2, (200, 22))
        ),
        blocked_map=BlockedMap(
            blocked, GAIN * blocked - np.where(above, COULOMB, -COULOMB) * 0.95, np.full(10, 4e-4), above
        ),
        without_model=without_model(replace(trace, predicted=1.01 * predicted)),
        residuals=residuals(),
        conditions=(
            Condition("impedance form", None, "no torque was measured"),
            Condition(
                "unique zero", True, "it vanishes at one velocity", "least fall", 1e-3, (0.9e-3, 1.1e-3), "N*m*s/rad"
            ),
        ),
        ladder=(
            rung("coulomb-viscous", 0.193, 0.196, 0.023),
            rung("dahl", 0.0099, 0.00995, 1.9e-4, selected=True),
            rung("lugre", 0.0099, 0.00996, 1.9e-4, converged=False),
        ),
        trials=TRIALS,
        rendered=(LAW_RENDERED,),
        in_situ=IN_SITU,
        live=live,
        measured=measured_from(velocity, command, torque, names),
        notes=("The staircase was cut short.",),
    )


@pytest.fixture
def without_numbers(full: Result) -> Result:
    """The same, with everything that can be unknown unknown."""
    nothing = np.full(5, np.nan)
    trace = Trace(np.arange(5) * TICK_S, nothing, nothing, "N*m")
    assert full.fit is not None
    lost = tuple(replace(estimate, value=np.nan, std=np.nan) for estimate in full.fit.estimates)
    fit = replace(full.fit, estimates=lost, trace=trace, torque_rms_nm=np.nan, command_delay_s=np.nan, converged=False)
    return replace(
        full,
        fit=fit,
        validation=Validation(np.nan, np.nan, np.nan, np.nan, trace, trace),
        source_map=SourceMap(nothing, nothing, nothing, np.zeros(5, bool)),
        blocked_map=BlockedMap(nothing, nothing, nothing, np.zeros(5, bool)),
        live=tuple(LiveEstimate(k, lost) for k in range(3)),
        measured=Measured(),
    )
