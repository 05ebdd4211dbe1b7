"""How near to zero the port torque is held in the zero-torque experiment, through the real loop on the simulated bench.

The same command is run with the load undriven, under the bench's own controller (feedback alone), and with preview of
the free motion, by three movements and over ten seeds; the bench is calibrated anew by its own tare and calibration in
each, and the preview's network is the one just identified there. With the first seed alone there are, besides: a plain
torque PI; networks with every parameter off by the errors named, used as the bench uses a network that says so of
itself; the movement repeated with what each trial taught; and torque sensors of other stiffnesses. Figures are of the
true port torque, which only the simulation knows; decibels include its mean, which is the drift of the sensor's zero.
Run with ``python benchmarks/zero_torque.py [--seeds 1-10] [--json] [--jobs 2]``; some 15 minutes on two cores.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from math import isfinite, log10
from pathlib import Path

import numpy as np
from several import carried_out_by, seeds_in

from norton_bench.arrays import FloatArray
from norton_bench.control.admittance import AdmittanceController
from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.preview import foreseeing, with_preview
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.trials import TRIAL
from norton_bench.loop.devices import guard_for, open_devices
from norton_bench.loop.loop import Loop
from norton_bench.loop.outbox import Outbox
from norton_bench.models.network import NortonNetwork
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.iterate import IterateProcedure
from norton_bench.procedures.knowledge import Knowledge, carry_out
from norton_bench.procedures.options import IterateOptions
from norton_bench.procedures.tare import TareProcedure
from norton_bench.procedures.waves import hold, multisine
from norton_bench.records import Measured
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.sample import Alignment, Sample, Target
from norton_bench.segments import ZERO_TORQUE, LoadMode, Segment, Use
from norton_drivers.registry import load_backend
from norton_sim.backend import SimulatedBackend
from norton_sim.truth import read_truth

RIG = Path(__file__).parents[1] / "rigs" / "sim-odrive.toml"
STIFFNESS_NM_RAD = 200.0
OTHERS_NM_RAD = (50.0, 1000.0)
NETWORK_ERRORS = (0.005, 0.02)
# Bands and amplitudes of the actuator's command; with the first the undriven port sees about 13 mN m.
COMMANDS = {"3 Hz": (3.0, 0.08), "3 Hz, stronger": (3.0, 0.1), "10 Hz": (10.0, 0.1)}
DURATION_S = 8.0
FEEDBACK, PREVIEW = "feedback", "preview, network just identified"
LOOK_NS = 100_000


@dataclass
class PlainPI:
    """The rival: a torque PI, tuned by hand at 200 N m/rad, in the controller's place."""

    proportional: float = 0.6
    integral_per_s: float = 300.0
    lead_ticks: int = 0
    _integral_nm: float = 0.0

    def begin(
        self, sample: Sample, admittance: object, *, leads: bool = False, mends_rad_s: float | None = None
    ) -> None:
        self._integral_nm = 0.0

    def observe(self, sample: Sample) -> None:
        """Nothing to watch."""

    def rest(self) -> None:
        """Nothing to begin anew."""

    def note_sent(self, load_torque_nm: float) -> None:
        """Nothing to remember."""

    def update(self, sample: Sample, target: Target, ahead: Target | None = None) -> float:
        self._integral_nm += self.integral_per_s * 1e-3 * sample.torque_nm
        return self.proportional * sample.torque_nm + self._integral_nm


@dataclass
class Eyes:
    """Looks at the true port torque ten times a tick."""

    backend: SimulatedBackend
    seen_nm: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        world = self.backend.world
        world.every(LOOK_NS, self._look, first_ns=world.now_ns + LOOK_NS)

    def _look(self, _now_ns: int) -> None:
        self.seen_nm.append(self.backend.world.plant.true_port_torque_nm())

    def rms_nm(self) -> float:
        return float(np.sqrt(np.mean(np.square(self.seen_nm))))

    def mean_nm(self) -> float:
        return float(np.mean(self.seen_nm))


@dataclass
class Benchmark:
    """One rig, ready to run: calibrated by its own procedures."""

    rig: Rig
    backend: SimulatedBackend
    loop: Loop
    calibration: LoadCalibration
    actuator_delay_s: float
    eyes: Eyes
    known: Knowledge

    def rms_nm(self, segment: Segment, controller: object) -> float:
        """RMS of the true port torque over ``segment``, from rest."""
        self.loop.controller = controller  # type: ignore[assignment]
        with self.loop.running():
            self.loop.run(Segment("benchmark", "rest", Use.PREPARE, hold(0.0, 0.3, self.rig.tick_s)))
            self.eyes.seen_nm.clear()
            self.loop.run(segment)
            return self.eyes.rms_nm()


@contextmanager
def ready(stiffness_nm_rad: float, seed: int) -> Iterator[Benchmark]:
    """The demonstration rig with another torque sensor, tared and calibrated."""
    text = RIG.read_text(encoding="utf-8").replace(
        'stiffness = "200 N*m/rad"', f'stiffness = "{stiffness_nm_rad} N*m/rad"'
    )
    rig = parse_rig(text, place=str(RIG))
    backend = load_backend("simulated")(rig.wiring, rig.simulated, seed=seed, place=rig.place)
    assert isinstance(backend, SimulatedBackend)
    devices = open_devices(rig, backend)
    loop = Loop(devices, guard_for(rig, devices), Outbox(()), Alignment(), rig.tick_ns)
    try:
        known = carry_out(TareProcedure(), Knowledge(rig), loop)
        assert known.tare is not None
        loop.alignment.torque_bias_nm = known.tare.torque_bias_nm
        known = carry_out(CalibrateProcedure(), known, loop)
        assert known.calibration is not None
        assert known.actuator is not None
        loop.alignment.torque_bias_nm = known.calibration.torque_bias_nm
        yield Benchmark(rig, backend, loop, known.calibration, known.actuator.command_delay_s, Eyes(backend), known)
    finally:
        devices.link.close()
        backend.close()


@dataclass
class Watched:
    """The loop, with the eyes open during trials alone."""

    bench: Benchmark
    rms_nm: list[float] = field(default_factory=list)

    def running(self) -> AbstractContextManager[None]:
        return self.bench.loop.running()

    def run(self, segment: Segment) -> Measured:
        self.bench.eyes.seen_nm.clear()
        measured = self.bench.loop.run(segment)
        if segment.name.startswith(TRIAL):
            self.rms_nm.append(self.bench.eyes.rms_nm())
        return measured


def iterated(bench: Benchmark, highest_hz: float, amplitude: float) -> list[float]:
    """RMS of the true port torque [N m], trial by trial, of a movement that is repeated; the first is undriven."""
    bench.loop.controller = AdmittanceController(bench.calibration, bench.rig.tick_s, bench.rig.limits.load_torque_nm)
    known, watched = replace(bench.known, command_span=(-amplitude, amplitude), iteration=None), Watched(bench)
    step = IterateProcedure(IterateOptions(duration_s=DURATION_S, highest_hz=highest_hz))
    while (decision := step.following(known)).procedure is not None:
        known = carry_out(decision.procedure, decision.known, watched)
    return watched.rms_nm


def measure(bench: Benchmark, low_pass_hz: float, amplitude: float, *, rivals: bool) -> dict[str, tuple[float, float]]:
    """RMS and mean of the true port torque [N m] by how the load is driven."""
    tick_s = bench.rig.tick_s
    command = amplitude * multisine(DURATION_S, tick_s, low_hz=0.2, high_hz=low_pass_hz, seed=2, slope=-0.5)
    undriven = Segment("benchmark", "undriven", Use.PREPARE, command)
    zero = Segment("benchmark", "zero torque", Use.PREPARE, command, LoadMode.ADMITTANCE, ZERO_TORQUE)
    controller = AdmittanceController(bench.calibration, tick_s, bench.rig.limits.load_torque_nm)
    assert bench.known.actuator is not None
    ways: dict[str, tuple[Segment, object]] = {
        "undriven": (undriven, None),
        PREVIEW: (as_the_bench_does(bench, zero, bench.known.actuator.network), controller),
        FEEDBACK: (zero, controller),
    }
    if rivals:
        ways["plain PI"] = (zero, PlainPI())
        for error in NETWORK_ERRORS:
            network = nearly_true_network(bench.rig, error)
            ways[f"network {error:.1%} off"] = (as_the_bench_does(bench, zero, network), controller)
    return {way: (bench.rms_nm(segment, driven), bench.eyes.mean_nm()) for way, (segment, driven) in ways.items()}


def as_the_bench_does(bench: Benchmark, zero: Segment, network: NortonNetwork) -> Segment:
    """With the free motion foreseen by ``network`` where the bench would trust it, by feedback alone where not."""
    chosen = foreseeing(network, None, knows_friction=bench.calibration.actuator_friction is not None)
    if chosen is None:
        return zero
    return with_preview(zero, chosen, bench.calibration, bench.actuator_delay_s, bench.rig.tick_s)


def nearly_true_network(rig: Rig, error: float) -> NortonNetwork:
    """The true actuator with every parameter off by ``error``, up or down by turns of a seeded coin."""
    motor = read_truth(rig.simulated, seed=None, place=rig.place).actuator.motor
    true = np.array([motor.Km * motor.Ka, motor.beta, motor.Im, motor.B, motor.tau_c, motor.sigma_0, motor.sigma_1])
    off: FloatArray = true * (1 + error * np.random.default_rng(3).choice([-1.0, 1.0], len(true)))
    covariance = tuple(map(tuple, np.diag((error * true) ** 2).tolist()))
    return NortonNetwork(*off.tolist(), command_unit=rig.command.unit, covariance_names=PHYSICAL, covariance=covariance)


@dataclass(frozen=True)
class Case:
    """One movement with one sensor at one seed; ``rivals`` adds what is run at the first seed alone."""

    seed: int
    stiffness_nm_rad: float
    command: str
    rivals: bool

    def __str__(self) -> str:
        return f"seed {self.seed}, {self.stiffness_nm_rad:.0f} N m/rad, command to {self.command}"


@dataclass(frozen=True)
class Outcome:
    """``rms_nm`` and ``mean_nm`` of the true port torque by way; ``iterated_rms_nm`` trial by trial."""

    case: Case
    rms_nm: dict[str, float]
    mean_nm: dict[str, float]
    iterated_rms_nm: list[float]

    def below_db(self, way: str) -> float:
        return decibels(self.rms_nm["undriven"], self.rms_nm[way])


def one(case: Case) -> Outcome:
    """Calibrated anew: within minutes the sensor drifts by more than what preview leaves."""
    low_pass_hz, amplitude = COMMANDS[case.command]
    with ready(case.stiffness_nm_rad, case.seed) as bench:
        found = measure(bench, low_pass_hz, amplitude, rivals=case.rivals)
    trials_nm: list[float] = []
    if case.rivals:
        with ready(case.stiffness_nm_rad, case.seed) as bench:
            trials_nm = iterated(bench, low_pass_hz, amplitude)
    rms_nm, mean_nm = ({way: pair[place] for way, pair in found.items()} for place in (0, 1))
    return Outcome(case, rms_nm, mean_nm, trials_nm)


def cases(seeds: range) -> list[Case]:
    first = seeds[0]
    main = [Case(seed, STIFFNESS_NM_RAD, command, seed == first) for seed, command in product(seeds, COMMANDS)]
    main.sort(key=lambda case: case.rivals)  # what takes longest comes last
    return main + [Case(first, stiffness, command, True) for stiffness, command in product(OTHERS_NM_RAD, COMMANDS)]


def progress_line(outcome: Outcome) -> str:
    """The case in a line."""
    ways = ", ".join(f"{way} {outcome.below_db(way):.1f} dB" for way in (FEEDBACK, PREVIEW))
    return f"{outcome.case}: {ways}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1-10", help="first-last, 1-10 unless told")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="cases at a time")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    found = list(carried_out_by(one, cases(seeds_in(options.seeds)), options.jobs, progress_line))
    if options.json:
        json.dump([asdict(outcome) for outcome in found], sys.stdout, indent=2)
        return
    for command in COMMANDS:
        show_seeds(
            command, [o for o in found if o.case.command == command and o.case.stiffness_nm_rad == STIFFNESS_NM_RAD]
        )
    for outcome in found:
        if outcome.case.rivals:
            show(outcome)


def show_seeds(command: str, found: Sequence[Outcome]) -> None:
    """What a movement came to over the seeds: mean, and from the least to the most."""
    print(f"command to {command}, {len(found)} seeds, {STIFFNESS_NM_RAD:.0f} N m/rad")
    for way in (FEEDBACK, PREVIEW):
        below = np.array([outcome.below_db(way) for outcome in found])
        means = 1e3 * np.array([outcome.mean_nm[way] for outcome in found])
        print(f"    {way:32s} {np.mean(below):5.1f} dB below ({np.min(below):.1f} to {np.max(below):.1f})", end="; ")
        print(f"mean torque {np.mean(means):+.3f} mN m ({np.min(means):+.3f} to {np.max(means):+.3f})")
    gains = [outcome.below_db(PREVIEW) - outcome.below_db(FEEDBACK) for outcome in found]
    print(f"    preview over feedback alone {min(gains):+.1f} to {max(gains):+.1f} dB")


def show(outcome: Outcome) -> None:
    """One line a way of driving the load; what is iterated is compared with its own first trial."""
    print(f"{outcome.case}: undriven {1e3 * outcome.rms_nm['undriven']:.1f} mN m")
    for way, rms_nm in outcome.rms_nm.items():
        if way != "undriven":
            print(f"    {way:32s} {1e3 * rms_nm:6.2f} mN m {outcome.below_db(way):6.1f} dB below")
    first_nm, *others_nm = outcome.iterated_rms_nm
    below = ", ".join(f"{decibels(first_nm, rms_nm):.1f}" for rms_nm in others_nm)
    print(f"    iterated, from {1e3 * first_nm:.1f} mN m: trials 2 to {1 + len(others_nm)} {below} dB below")


def decibels(undriven_nm: float, rms_nm: float) -> float:
    """How far below the undriven port torque."""
    return 20 * log10(undriven_nm / rms_nm) if isfinite(rms_nm) and rms_nm > 0 else float("nan")


if __name__ == "__main__":
    main()
