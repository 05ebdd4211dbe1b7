"""The same recordings, fitted by this program and by MuJoCo's own system identification (``mujoco.sysid``).

Each seed is one standard session on the simulated bench of ``rigs/sim-odrive.toml``, through frames and bytes; the
actuator is the paper's motor with cogging. Both get the same recording. The peer gets more than a recording has:
signals on one grid, smoothed, their delays taken off as found by this program; values to begin from, within a factor
of two of the true ones; parameters as logarithms. It fits free rollouts of two seconds, as its documents do, with one
of two models of MuJoCo's: ``dry`` (frictionloss) and ``lugre`` (a dcmotor's friction contact, which can be the true
one). Its intervals are its own ``calculate_intervals``. This program is timed twice: as a session concludes, with
simulated records and the test of the residual, and the fit ``alone``, with deviations from the residual.

Printed are, for each: error of the parameters, share of 95 % intervals that hold the truth, rms error of the torque on
motions that no session made (``other_worlds.py``), and processor time over this program's. Run with
``pip install -e .[benchmarks]`` and ``python benchmarks/peers.py [--seeds 1-10] [--json]``; a seed takes some two
minutes. Rhoban's BAM is not on the package index, and is left out.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid
from other_worlds import CONTROL, RIG, rig_text, torque_errors, unseen_motions
from several import seeds_in

from norton_bench.arrays import FloatArray
from norton_bench.identification.cleaning import clean
from norton_bench.identification.judged_fit import fit as fit_alone
from norton_bench.identification.judged_fit import fit_judged
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.results import FitResult
from norton_bench.identification.rows import align
from norton_bench.identification.signals import signals
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Status
from norton_bench.recording.reader import read_recording
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use
from norton_bench.session.engine import record_session
from norton_bench.session.schema import standard_session
from norton_sim.truth import Truth, read_truth, true_parameters

OURS, ALONE, PEERS = "norton-bench", "norton-bench, fit alone", ("dry", "lugre")
WINDOW_S = 2.0
# The contact relaxes within τc/(σ0·|ω|), which is 0.1 ms at 20 rad/s.
TIMESTEP_S = {"dry": 5e-4, "lugre": 1e-4}
WITHIN = np.log(2.0)  # of the values that the peer begins from
REACH = np.log(10.0)  # of its search
# frictionloss has neither.
OF_CONTACT = ("presliding_stiffness", "presliding_damping")
MODEL = """<mujoco>
  <option timestep="{timestep}" integrator="Euler"/>
  <worldbody><body><joint name="shaft" type="hinge" axis="0 0 1" armature="{inertia}" damping="{viscous_damping}"{dry}/>
    <inertial pos="0 0 0" mass="1e-3" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>
  <actuator>
    <general name="command" joint="shaft" gainprm="{torque_gain}" dyntype="filterexact" dynprm="{lag}"/>
    <motor name="port" joint="shaft" gear="-1"/>{contact}
  </actuator>
  <sensor><jointpos name="angle" joint="shaft"/><jointvel name="rate" joint="shaft"/></sensor>
</mujoco>"""
DRY = ' frictionloss="{coulomb_torque}" solreffriction="1e-3 1"'
LUGRE = """
    <dcmotor name="friction" joint="shaft" motorconst="1e-9" resistance="1e9" input="none"
      lugre="{presliding_stiffness} {presliding_damping} {coulomb_torque} {coulomb_torque} 1"/>"""


@dataclass(frozen=True)
class Window:
    """A stretch of equal length on the ticks, arrays (n,): what was commanded and measured."""

    time_s: FloatArray
    command: FloatArray
    port_nm: FloatArray
    position_rad: FloatArray
    velocity_rad_s: FloatArray


@dataclass(frozen=True)
class Outcome:
    """Of one seed and one program: relative errors by parameter, which intervals hold, and the rest."""

    program: str
    seed: int
    errors: Mapping[str, float]
    held: Mapping[str, bool]
    unseen_nm: float
    cpu_s: float


def windows(fit: FitResult, cleaned: Any, tick_s: float) -> list[Window]:
    """All that was to be fitted, in pieces of WINDOW_S: the command as it acts, the torque without the zero."""
    ticks, result = round(WINDOW_S / tick_s), []
    for each in align(signals(cleaned.measured, tick_s, Use.IDENTIFY), fit.motion_delay_s):
        time_s = each.signals.time_s
        command = np.interp(time_s - fit.command_delay_s - fit.motion_delay_s, time_s, each.command)
        for first in range(0, time_s.size - ticks, ticks):
            span = slice(first, first + ticks)
            if each.usable[span].all():
                torque = each.torque_nm[span] - fit.torque_bias_nm
                result.append(
                    Window(time_s[span], command[span], torque, each.position_rad[span], each.velocity_rad_s[span])
                )
    return result


def model_text(program: str, values: Mapping[str, float]) -> str:
    """The peer's model with these values."""
    contact = LUGRE if program == "lugre" else ""
    dry = DRY if program == "dry" else ""
    return MODEL.format(
        timestep=TIMESTEP_S[program],
        lag=1.0 / values["amplifier_bandwidth"],
        dry=dry.format(**values),
        contact=contact.format(**values),
        **values,
    )


def fitted_by_peer(
    program: str, data: Sequence[Window], start: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Values, and 95 % intervals, by name; ``start`` are the values to begin from."""
    names = [name for name in PHYSICAL if program == "lugre" or name not in OF_CONTACT]
    params = sysid.ParameterDict({name: sysid.Parameter(name, 0.0, -REACH, REACH) for name in names})

    def values(now: Any) -> dict[str, float]:
        return {name: float(start[name] * np.exp(now[name].value[0])) for name in names}

    def build(now: Any, _spec: object) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(model_text(program, values(now)))

    text = model_text(program, start)
    sequences = sysid.ModelSequences(
        program,
        mujoco.MjSpec.from_string(text),
        [str(place) for place in range(len(data))],
        *zip(*(_sequence(mujoco.MjModel.from_xml_string(text), each) for each in data), strict=True),
    )
    residual = sysid.build_residual_fn(models_sequences=[sequences], build_model=build)
    with redirect_stdout(StringIO()):
        found, result = sysid.optimize(params, residual, optimizer="scipy", verbose=False)
    left, _, _ = residual(found.as_vector(), found)
    _, half = sysid.calculate_intervals([np.ravel(each) for each in left], result.jac)
    best = values(found)
    spans = {
        name: (best[name] * np.exp(-width), best[name] * np.exp(width)) for name, width in zip(names, half, strict=True)
    }
    return best, spans


def _sequence(model: mujoco.MjModel, window: Window) -> tuple[FloatArray, Any, Any]:
    """State to begin with, controls and sensors as the peer takes them."""
    time_s = window.time_s - window.time_s[0]
    controls = np.stack([window.command, window.port_nm], axis=1)
    if model.nu > controls.shape[1]:  # the contact's input, which it does not use
        controls = np.concatenate([controls, np.zeros((time_s.size, model.nu - controls.shape[1]))], axis=1)
    activation = np.zeros(model.na)
    activation[0] = window.command[0]
    begin = sysid.create_initial_state(model, window.position_rad[:1], window.velocity_rad_s[:1], activation)
    sensed = np.stack([window.position_rad, window.velocity_rad_s], axis=1)
    return (
        begin,
        sysid.TimeSeries(time_s, controls, sysid.TimeSeries.compute_all_control_mapping(model)),
        sysid.TimeSeries(time_s, sensed, sysid.TimeSeries.compute_all_sensor_mapping(model)),
    )


def unseen_nm(truth: Truth, network: NortonNetwork, span: tuple[float, float], rig: Rig, seed: int) -> float:
    """The rms error of the torque on motions that no session made [N m]."""
    rng = np.random.default_rng([seed, 7])
    pieces = [
        error
        for command, motion in unseen_motions(span, rig, rng)
        for error in torque_errors(truth, network, command, motion, rig.tick_s, 0.0)
    ]
    return float(np.sqrt(np.mean(np.square(pieces))))


def outcomes(seed: int) -> Iterator[Outcome]:
    """One session, fitted by all."""
    rig = replace(parse_rig(rig_text(CONTROL, 1.0), place=str(RIG)), candump=False)
    truth = read_truth(rig.simulated, seed=seed, place=rig.place, command_unit=rig.command.unit)
    true = {name: value for name, (value, _) in true_parameters(truth).items()}
    with TemporaryDirectory() as folder:
        path = record_session(rig, standard_session(rig), out=Path(folder), seed=seed).recording
        cleaned = clean(read_recording(path).measured)
    began_s = time.process_time()
    fit = fit_judged(cleaned, command_unit=rig.command.unit, tick_s=rig.tick_s).result
    ours_s = time.process_time() - began_s
    assert fit.network.prediction is not None
    span = fit.network.prediction.ranges["command"]

    def outcome(
        program: str,
        values: Mapping[str, float],
        spans: Mapping[str, tuple[float, float]],
        network: NortonNetwork,
        cpu_s: float,
    ) -> Outcome:
        errors = {name: values[name] / true[name] - 1.0 for name in PHYSICAL if name in values}
        held = {name: low <= true[name] <= high for name, (low, high) in spans.items()}
        return Outcome(program, seed, errors, held, unseen_nm(truth, network, span, rig, seed), cpu_s)

    began_s = time.process_time()
    alone = fit_alone(cleaned.measured, command_unit=rig.command.unit, tick_s=rig.tick_s, draws=0)
    alone_s = time.process_time() - began_s
    for program, result, cpu_s in ((OURS, fit, ours_s), (ALONE, alone, alone_s)):
        estimates = [result.estimate(name) for name in PHYSICAL]
        intervals = {
            each.name: (each.value - each.half_interval, each.value + each.half_interval)
            for each in estimates
            if each.status is Status.VALID
        }
        yield outcome(program, {each.name: each.value for each in estimates}, intervals, result.network, cpu_s)
    data = windows(fit, cleaned, rig.tick_s)
    rng = np.random.default_rng([seed, 11])
    start = {name: float(true[name] * np.exp(rng.uniform(-WITHIN, WITHIN))) for name in PHYSICAL}
    for program in PEERS:
        began_s = time.process_time()
        values, spans = fitted_by_peer(program, data, start)
        cpu_s = time.process_time() - began_s
        # Dry friction is a contact with hardly any presliding.
        stiff = {"presliding_stiffness": 1e4 * values["coulomb_torque"], "presliding_damping": 1e-6}
        network = NortonNetwork.of_parameters({**stiff, **values}, rig.command.unit)
        yield outcome(program, values, spans, network, cpu_s)


def summary(found: Sequence[Outcome]) -> dict[str, dict[str, float]]:
    """By program: rms error of the parameters, coverage, unseen torque with its spread, and time over ours."""
    ours_s = np.array([each.cpu_s for each in found if each.program == OURS])
    result = {}
    for program in (OURS, ALONE, *PEERS):
        own = [each for each in found if each.program == program]
        held = [one for each in own for one in each.held.values()]
        unseen = [1e3 * each.unseen_nm for each in own]
        result[program] = {
            **{
                f"{name}_percent": _rms([100 * each.errors[name] for each in own])
                for name in PHYSICAL
                if name in own[0].errors
            },
            "coverage_percent": 100 * float(np.mean(held)),
            "unseen_mnm": float(np.median(unseen)),
            "unseen_mnm_least": min(unseen),
            "unseen_mnm_most": max(unseen),
            "time_over_ours": float(np.median([each.cpu_s for each in own] / ours_s)),
        }
    return result


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="1-10", help="FIRST-LAST, or one")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    arguments = parser.parse_args()
    found = []
    for seed in seeds_in(arguments.seeds):
        for each in outcomes(seed):
            found.append(each)
            worst = max(each.errors, key=lambda name: abs(each.errors[name]))
            print(
                f"seed {seed}, {each.program}: {1e3 * each.unseen_nm:.3f} mN*m on unseen motion, "
                f"{sum(each.held.values())} of {len(each.held)} intervals hold, worst {worst} "
                f"{100 * each.errors[worst]:+.1f} %, {each.cpu_s:.1f} s",
                file=sys.stderr,
            )
    told = summary(found)
    if arguments.json:
        print(json.dumps(told, indent=1))
        return 0
    for program, figures in told.items():
        print(program)
        for name, value in figures.items():
            print(f"  {name:32} {value:10.3g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
