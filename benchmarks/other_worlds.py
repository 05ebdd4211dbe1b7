"""What the tool says of actuators that are not the paper's motor, and whether it is right.

Every session is the standard one on the simulated bench of ``rigs/sim-odrive.toml``, through frames and bytes; the
actuator is the paper's motor with one departure (``sim_backend/norton_sim/departures.py``, a gear train or a spring),
at two strengths, and the motor itself as a control. Then the true plant is moved as no experiment moved it: the torque
that its port truly exerts, and its true free motion, are compared with the network's, without noise and without the
identifier.

Printed are: how often the network has the term that is true, and how often one that is not; how many of the valid
values' 95 % intervals hold the true value, and their rms error in deviations; the share of unseen motions whose error
is within the network's stated one; sessions that end with every parameter ``valid`` although an unseen motion is off
by more than twice the stated error; how often the first cause named, as a term or as a departure, is the true one; and
how often anything is named on the control. Run with ``python benchmarks/other_worlds.py
[--seeds 1-5] [--quick] [--json] [--worlds stribeck,ripple] [--jobs 2]``; a session takes about 35 s. Development used
seeds from 101 on.
"""

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import verdicts
from several import one_thread_each, seeds_in

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import HALF_INTERVAL, Estimate, Status
from norton_bench.procedures.waves import Motion, from_velocity, multisine, multisine_motion, sine_motion
from norton_bench.result import Result
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.conclusion import conclude_recording
from norton_bench.session.engine import record_session
from norton_bench.session.schema import standard_session
from norton_sim.plant import Plant
from norton_sim.truth import Truth, read_truth, true_parameters

RIG = Path(__file__).parents[1] / "rigs" / "sim-odrive.toml"
CONTROL = "control"
STRENGTHS = (1.0, 0.5)
QUICK_SEED = "1"
# What is to be reached.
HELD = (0.90, 0.99)
NAMED, QUIET = 0.90, 0.95
COVERED, RIGHT, LEAN = (0.93, 0.97), 0.95, 0.90
TWICE = 2.0

# Finer than a tick, so that differences of the position are no error of the network's.
FINE = 10
UNSEEN_S, PIECE_S = 4.0, 2.0
# Of the session in which they are tried, for plants that change with time.
BEGIN_S = (30.0, 100.0)
# The true plant is moved by its load, whose state is known exactly: a position loop this fast.
LOOP_RAD_S = 2 * np.pi * 25.0

DEPARTURES: Mapping[str, tuple[str, str]] = {
    # By name: the departure at strength 1, in [simulated.actuator.departures], and the cause that is true.
    "stribeck": ('stribeck = {{ drop = "{30} %", velocity = "5 rad/s" }}', "stribeck"),
    "asymmetry": ('asymmetry = "{10} %"', "asymmetry"),
    "load friction": ('load_friction = "{5} %"', "load"),
    "saturation": ('saturation = {{ share = "{10} %", current = "2 A" }}', "saturation"),
    "quadratic drag": ('quadratic_drag = "{3}e-6 N*m*s^2/rad^2"', "drag"),
    "ripple": ('ripple = {{ share = "{3} %", periods_per_turn = 14 }}', "ripple"),
    "damping drift": ('damping_drift = {{ share = "{10} %", over = "120 s" }}', "damping_drift"),
    "friction by position": (
        'friction_by_position = {{ share = "{20} %", periods_per_turn = 3 }}',
        "friction_by_position",
    ),
    "warming": ('warming = {{ share = "-{5} %", over = "60 s" }}', "gain_drift"),
}
BEHIND: Mapping[str, tuple[str, str, str]] = {
    # The same motor behind something else: its model, the connection's table, and the cause that is true.
    "backlash": (
        "gear_train",
        '[simulated.actuator.backlash]\nwidth = "{5} mrad"\nstiffness = "100 N*m/rad"\ndamping = "20 mN*m*s/rad"',
        "backlash",
    ),
    "two masses": (
        "series_elastic",
        '[simulated.actuator.spring]\nstiffness = "{10/} N*m/rad"\ndamping = "4 mN*m*s/rad"',
        "compliance",
    ),
}
WORLDS = (*DEPARTURES, *BEHIND)
# What has no one true value.
IN_TIME = {"damping drift": ("viscous_damping",), "warming": ("torque_gain", "torque_constant")}
MOTOR_BEHIND = """amplifier_gain = "18 A/(N*m)"
amplifier_bandwidth = "600 rad/s"
counts_per_turn = 131072
current_noise = "5 mA"

[simulated.actuator.motor]
torque_constant = "0.05 N*m/A"
inertia = "4e-5 kg*m^2"
viscous_damping = "1e-3 N*m*s/rad"
coulomb_torque = "20 mN*m"
presliding_stiffness = "10 N*m/rad"
presliding_damping = "0.01 N*m*s/rad"

[simulated.actuator.output]
inertia = "1e-5 kg*m^2"
"""


@dataclass(frozen=True)
class Outcome:
    """One session. Errors are true ones, over pieces of unseen motion, and the network's stated ones beside them.

    ``refused`` is the sentence with which the session ended, where it did; the rest is then empty.
    """

    world: str
    strength: float
    seed: int
    refused: str = ""
    named: tuple[str, ...] = ()
    all_valid: bool = False
    network: bool = False
    stated_nm: float = float("nan")
    stated_rad_s: float = float("nan")
    torque_nm: tuple[float, ...] = ()
    velocity_rad_s: tuple[float, ...] = ()
    terms: tuple[str, ...] = ()
    deviations_off: Mapping[str, float] = field(default_factory=dict)  # of each valid value from the true one

    @property
    def right_term(self) -> bool:
        """Whether the network has the term that is true."""
        return self.true_cause in self.terms

    @property
    def superfluous_term(self) -> bool:
        """Whether it has one that is not."""
        return bool(set(self.terms) - {self.true_cause})

    @property
    def true_cause(self) -> str:
        return (DEPARTURES | BEHIND)[self.world][-1] if self.world != CONTROL else ""

    @property
    def ratios(self) -> FloatArray:
        """True errors over those stated, of torque and of free velocity, shape (pieces,)."""
        torque = np.array(self.torque_nm) / self.stated_nm
        return np.concatenate([torque, np.array(self.velocity_rad_s) / self.stated_rad_s])

    @property
    def confidently_wrong(self) -> bool:
        return self.all_valid and bool(np.any(self.ratios > TWICE))


def rig_text(world: str, strength: float) -> str:
    """The rig file with that world's actuator."""
    text = RIG.read_text(encoding="utf-8")
    if world == CONTROL:
        return text
    if world in DEPARTURES:
        table = _scaled(DEPARTURES[world][0], strength).replace("{{", "{").replace("}}", "}")
        return text.replace("[simulated.load]", f"[simulated.actuator.departures]\n{table}\n\n[simulated.load]")
    head, rest = text.split("[simulated.actuator]")
    model, connection, _ = BEHIND[world]
    actuator = f'[simulated.actuator]\nmodel = "{model}"\n{MOTOR_BEHIND}\n{_scaled(connection, strength)}\n\n'
    return f"{head}{actuator}[simulated.load]{rest.split('[simulated.load]')[1]}"


def _scaled(text: str, strength: float) -> str:
    """Every ``{number}`` times ``strength``, and every ``{number/}`` over it."""
    parts = []
    for piece in text.split("{"):
        number, closed, rest = piece.partition("}")
        digits = number.removesuffix("/")
        if closed and digits.replace(".", "").isdigit():
            scaled = float(digits) / strength if number.endswith("/") else float(digits) * strength
            parts.append(f"\0{scaled:g}{rest}")
        else:
            parts.append(piece)
    return "{".join(parts).replace("{\0", "")


def outcome(world: str, strength: float, seed: int, recording: Path | None = None) -> Outcome:
    """One session, or what was recorded of one."""
    rig = replace(parse_rig(rig_text(world, strength), place=str(RIG)), candump=False)
    with TemporaryDirectory() as folder:
        try:
            path = (
                recording
                or record_session(rig, standard_session(rig), out=Path(folder), seed=seed, live=False).recording
            )
            found = conclude_recording(path, Path(folder))
        except ExperimentError as error:
            return Outcome(world, strength, seed, refused=str(error))
        return compared(Outcome(world, strength, seed), rig, found)


def compared(about: Outcome, rig: Rig, found: Result) -> Outcome:
    """What was found, beside the truth."""
    assert found.fit is not None
    error = found.model_error
    truth = read_truth(rig.simulated, seed=about.seed, place=rig.place, command_unit=rig.command.unit)
    terms = tuple(term.name for term in found.fit.network.relative_terms)
    told = replace(
        about,
        terms=terms,
        named=(*terms, *(() if error is None else (each.kind.name for each in error.departures))),
        deviations_off=_deviations_off(about.world, found.fit.estimates, truth),
        all_valid=all(estimate.status is Status.VALID for estimate in found.fit.estimates),
    )
    if found.network_file is None:
        return told
    network = NortonNetwork.load(found.network_file)
    if network.prediction is None:
        return told
    span = network.prediction.ranges["command"]
    rng = np.random.default_rng([about.seed, 7])
    torque = [
        each
        for command, motion in unseen_motions(span, rig, rng)
        for each in torque_errors(truth, network, command, motion, rig.tick_s, float(rng.uniform(*BEGIN_S)))
    ]
    velocity = [
        each
        for command in unseen_commands(span, rig, rng)
        for each in velocity_errors(truth, network, command, rig.tick_s, float(rng.uniform(*BEGIN_S)))
    ]
    return replace(
        told,
        network=True,
        stated_nm=network.prediction.torque_nm,
        stated_rad_s=network.prediction.velocity_rad_s,
        torque_nm=tuple(torque),
        velocity_rad_s=tuple(velocity),
    )


def _deviations_off(world: str, estimates: Sequence[Estimate], truth: Truth) -> dict[str, float]:
    """Of each valid value with one true value."""
    true = {name: value for name, (value, _) in true_parameters(truth).items() if name not in IN_TIME.get(world, ())}
    valid = [each for each in estimates if each.status is Status.VALID and each.name in true]
    return {each.name: (each.value - true[each.name]) / each.std for each in valid}


def unseen_motions(
    span: tuple[float, float], rig: Rig, rng: np.random.Generator
) -> Iterator[tuple[FloatArray, Motion]]:
    """Commands and motions, within what the experiments reached, and unlike each other."""
    tick_s, fast = rig.tick_s, 0.4 * rig.limits.velocity_rad_s

    def wave(high_hz: float) -> FloatArray:
        return multisine(UNSEEN_S, tick_s, low_hz=0.3, high_hz=high_hz, seed=int(rng.integers(1 << 30)), lines=25)

    def moved(high_hz: float, slope: float) -> Motion:
        seed = int(rng.integers(1 << 30))
        return multisine_motion(UNSEEN_S, tick_s, low_hz=0.4, high_hz=high_hz, seed=seed, slope=slope)

    ticks = len(wave(10.0))
    yield 0.8 * span[1] * wave(80.0), moved(40.0, -0.6).scaled(0.75 * fast)
    yield 0.4 * span[1] * wave(20.0), moved(12.0, 0.0).scaled(0.1 * fast)
    # Sliding at four speeds, a command beneath.
    speeds = fast * np.repeat(rng.uniform(0.05, 1.0, 4) * rng.choice([-1.0, 1.0], 4), ticks // 4)
    smooth = np.hanning(301)[1:-1]
    sliding = np.convolve(np.pad(speeds, (0, ticks - speeds.size)), smooth / smooth.sum(), "same")
    yield np.full(ticks, rng.uniform(0.5, 1.0) * span[int(rng.integers(2))]), from_velocity(sliding, tick_s)
    # Small loops, within a few presliding lengths.
    yield np.zeros(ticks), _as_long(sine_motion(rng.uniform(1e-3, 1e-2), 5.0, 18, tick_s), ticks)
    # Reversals at full stroke.
    stroke_rad = rng.uniform(0.3, 0.8) * fast / (2 * np.pi * 2.0)
    yield 0.5 * span[1] * wave(5.0), _as_long(sine_motion(stroke_rad, 2.0, 7, tick_s), ticks)


def _as_long(motion: Motion, ticks: int) -> Motion:
    def held(values: FloatArray, last: float) -> FloatArray:
        return np.concatenate([values, np.full(max(0, ticks - values.size), last)])[:ticks]

    return Motion(
        held(motion.position_rad, float(motion.position_rad[-1])),
        held(motion.velocity_rad_s, 0.0),
        held(motion.acceleration_rad_s2, 0.0),
    )


def unseen_commands(span: tuple[float, float], rig: Rig, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Commands of free motion, within those that were given."""
    ticks = round(UNSEEN_S / rig.tick_s)
    wave = multisine(UNSEEN_S, rig.tick_s, low_hz=0.3, high_hz=50.0, seed=int(rng.integers(1 << 30)))
    yield 0.9 * span[1] * wave
    levels = rng.uniform(0.4, 1.0, 4) * rng.choice([span[0], span[1]], 4)
    yield np.repeat(levels, ticks // 4)


def torque_errors(
    truth: Truth, network: NortonNetwork, command: FloatArray, motion: Motion, tick_s: float, begin_s: float
) -> Iterator[float]:
    """The network's rms error of the torque that the true port exerts, over pieces of PIECE_S [N m]."""
    assert truth.load is not None
    plant = Plant(truth, 0)
    plant.advance(round(begin_s * 1e9))
    inertia = truth.load.inertia_kg_m2 + network.inertia_kgm2
    step_ns = round(tick_s * 1e9 / FINE)
    positions, torques = [], []
    start = plant.true_position_rad("load")
    for asked, at, speed, acceleration in zip(
        command, motion.position_rad, motion.velocity_rad_s, motion.acceleration_rad_s2, strict=False
    ):
        off = at + start - plant.true_position_rad("load")
        slow = speed - plant.true_velocity_rad_s("load")
        push = inertia * (acceleration + 2 * LOOP_RAD_S * slow + LOOP_RAD_S**2 * off) - network.torque_gain * asked
        plant.command("load", truth.load.mounted * push / truth.load.torque_gain)
        plant.command("actuator", asked)
        for _ in range(FINE):
            positions.append(plant.true_position_rad("actuator"))
            torques.append(plant.true_port_torque_nm())
            plant.advance(plant.now_ns + step_ns)
    held = np.repeat(command, FINE)[: len(positions)]
    predicted = network.torque(held, np.array(positions), tick_s / FINE)
    yield from _pieces(np.array(torques) - predicted, tick_s)


def velocity_errors(
    truth: Truth, network: NortonNetwork, command: FloatArray, tick_s: float, begin_s: float
) -> Iterator[float]:
    """The network's rms error of the true free velocity, over pieces of PIECE_S [rad/s]."""
    plant = Plant(truth.model_copy(update={"load": None}), 0)
    plant.advance(round(begin_s * 1e9))
    velocities = []
    for asked in command:
        plant.command("actuator", asked)
        velocities.append(plant.true_velocity_rad_s("actuator"))
        plant.advance(plant.now_ns + round(tick_s * 1e9))
    predicted = network.free_motion(command, tick_s)[1]
    yield from _pieces(np.repeat(np.array(velocities) - predicted, FINE), tick_s)


def _pieces(error: FloatArray, tick_s: float) -> Iterator[float]:
    """The rms of ``error``, given FINE times a tick, in the band of the fit."""
    reach = round(FULL_BAND.half_width * FINE)
    taps = FULL_BAND.taps(np.arange(-reach, reach + 1) / FINE, 0)
    seen = np.convolve(error, taps, "valid")
    for piece in np.array_split(seen, max(1, round(seen.size * tick_s / FINE / PIECE_S))):
        yield float(np.sqrt(np.mean(piece**2)))


def figures(found: Sequence[Outcome]) -> dict[str, Any]:
    """What came out, in all and by world."""
    told = [each for each in found if each.network]
    ratios = np.concatenate([each.ratios for each in told]) if told else np.empty(0)
    others = [each for each in found if each.world != CONTROL]
    control = [each for each in found if each.world == CONTROL]
    held = verdicts.share(ratios <= 1.0)
    named = verdicts.share(np.array([each.named[:1] == (each.true_cause,) for each in others], dtype=bool))
    quiet = verdicts.share(np.array([not each.named and not each.refused for each in control], dtype=bool))
    right = verdicts.share(np.array([each.right_term for each in others], dtype=bool))
    lean = verdicts.share(np.array([not each.superfluous_term for each in found], dtype=bool))
    off = np.array([value for each in found for value in each.deviations_off.values()])
    covered = verdicts.share(np.abs(off) <= HALF_INTERVAL)
    return {
        "sessions": len(found),
        "refused": sum(bool(each.refused) for each in found),
        "held": held.value,
        "held_interval": held.interval,
        "held_reached": held.within(*HELD, len(told)),
        "confidently_wrong": sum(each.confidently_wrong for each in found),
        "named": named.value,
        "named_interval": named.interval,
        "named_reached": named.within(NAMED, 1.0, len(others)),
        "values": off.size,
        "values_rms_deviations": _rms(off) if off.size else float("nan"),
        "covered": covered.value,
        "covered_interval": covered.interval,
        "covered_reached": covered.within(*COVERED, off.size),
        "right_term": right.value,
        "right_term_interval": right.interval,
        "right_term_reached": right.within(RIGHT, 1.0, len(others)),
        "no_superfluous_term": lean.value,
        "no_superfluous_term_interval": lean.interval,
        "no_superfluous_term_reached": lean.within(LEAN, 1.0, len(found)),
        "control_quiet": quiet.value,
        "control_quiet_interval": quiet.interval,
        "control_quiet_reached": quiet.within(QUIET, 1.0, len(control)),
    }


def show(found: Sequence[Outcome]) -> None:
    """A line for each world and strength, then the whole."""
    print(
        f"{'':22}{'':>9}{'sessions':>9}{'refused':>8}{'valid':>6}{'term':>6}{'named':>6}{'stated':>8}{'true rms':>9}",
        end="",
    )
    print(f"{'greatest':>9}{'stated':>8}{'true rms':>9}{'greatest':>9}{'held':>6}")
    print(f"{'':66}{'':8}{'mN*m':>8}{'mN*m':>9}{'mN*m':>9}{'rad/s':>8}{'rad/s':>9}{'rad/s':>9}")
    for world, strength in dict.fromkeys((each.world, each.strength) for each in found):
        rows = [each for each in found if (each.world, each.strength) == (world, strength)]
        told = [each for each in rows if each.network]
        print(f"{world:22}{strength:>9g}{len(rows):>9}{sum(bool(each.refused) for each in rows):>8}", end="")
        right = sum(each.named[:1] == ((each.true_cause,) if each.true_cause else ()) for each in rows)
        terms = sum(each.right_term and not each.superfluous_term for each in rows)
        print(f"{sum(each.all_valid for each in rows):>6}{terms:>6}{right:>6}", end="")
        if told:
            torque = np.concatenate([each.torque_nm for each in told])
            velocity = np.concatenate([each.velocity_rad_s for each in told])
            held = np.mean(np.concatenate([each.ratios for each in told]) <= 1.0)
            print(f"{1e3 * np.median([each.stated_nm for each in told]):>8.2f}{1e3 * _rms(torque):>9.2f}", end="")
            print(f"{1e3 * np.max(torque):>9.2f}{np.median([each.stated_rad_s for each in told]):>8.2f}", end="")
            print(f"{_rms(velocity):>9.2f}{np.max(velocity):>9.2f}{held:>6.0%}", end="")
        print()
    for refused in (each for each in found if each.refused):
        print(f"refused: {refused.world} {refused.strength:g}, seed {refused.seed}: {refused.refused}")
    of = figures(found)
    print(f"\n{of['sessions']} sessions, {of['refused']} refused")
    print(f"rms error of the valid values: {of['values_rms_deviations']:.2f} deviations")
    for what, key, wanted in (
        ("the network has the true term", "right_term", f">= {RIGHT:.0%}"),
        ("it has no superfluous term", "no_superfluous_term", f">= {LEAN:.0%}"),
        (f"intervals that hold the true value, of {of['values']}", "covered", f"{COVERED[0]:.0%}-{COVERED[1]:.0%}"),
        ("unseen motions within the stated error", "held", f"{HELD[0]:.0%}-{HELD[1]:.0%}"),
        ("the first cause named is the true one", "named", f">= {NAMED:.0%}"),
        ("nothing named on the control", "control_quiet", f">= {QUIET:.0%}"),
    ):
        if np.isfinite(of[key]):
            low, high = of[f"{key}_interval"]
            print(f"{what}: {of[key]:.1%} ({low:.0%}-{high:.0%}); {wanted}: {verdicts.WORDS[of[f'{key}_reached']]}")
    print(f"all valid, yet off by more than {TWICE:g} times the stated error: {of['confidently_wrong']}; none wanted")


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default=None, help="FIRST-LAST, or one (default: 1-5)")
    parser.add_argument("--worlds", default=",".join((*WORLDS, CONTROL)), help="separated by commas")
    parser.add_argument("--quick", action="store_true", help=f"seed {QUICK_SEED}, the full strength alone")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="sessions at a time")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    seeds = seeds_in(options.seeds or (QUICK_SEED if options.quick else "1-5"))
    strengths = STRENGTHS[:1] if options.quick else STRENGTHS
    one_thread_each()
    worlds = options.worlds.split(",")
    if unknown := set(worlds) - {*WORLDS, CONTROL}:
        parser.error(f"--worlds: there is no {', '.join(sorted(unknown))}; there are {', '.join((*WORLDS, CONTROL))}")
    todo = list(product([world for world in worlds if world != CONTROL], strengths, seeds))
    if CONTROL in worlds:
        todo += [(CONTROL, 1.0, seed) for seed in seeds]
    found = list(carried_out(todo, outcome, options.jobs))
    if options.json:
        told = [asdict(each) for each in found]
        json.dump({"figures": figures(found), "outcomes": told}, sys.stdout, indent=2)
    else:
        show(found)


def carried_out(
    todo: Sequence[tuple[str, float, int]], one: Callable[[str, float, int], Outcome], jobs: int
) -> Iterator[Outcome]:
    """Each in its turn, in processes of their own; what is done is kept where the user ends it."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = [pool.submit(one, *each) for each in todo]
        try:
            for job in waiting:
                done = job.result()
                said = done.refused or f"named {', '.join(done.named) or 'nothing'}"
                print(f"{done.world} {done.strength:g}, seed {done.seed}: {said}", file=sys.stderr, flush=True)
                yield done
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)


if __name__ == "__main__":
    main()
