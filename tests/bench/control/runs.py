"""Experiments on the test plant, for the tests of the controller."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.admittance import AdmittanceController
from norton_bench.control.calibration import LoadCalibration
from norton_bench.models.network import NortonNetwork
from norton_bench.procedures.waves import Motion, multisine
from norton_bench.sample import Target
from norton_bench.segments import ZERO_TORQUE, Admittance
from tests.bench.control.plant import ACTUATOR, LOAD, Plant, PlantSettings

TICK_S = 1e-3
LIMIT_NM = 1.0
WARM_TICKS = 50
# A calibration as it comes out of an experiment: a few per cent off, here and there.
ERRORS = {"inertia_kgm2": 1.03, "torque_gain": 0.97, "coulomb_torque_nm": 1.03, "presliding_stiffness_nm_rad": 0.95}


def calibrated(settings: PlantSettings) -> LoadCalibration:
    """With the actuator's inertia estimated 10 % high."""
    return replace(settings.calibration(ERRORS), actuator_inertia_kgm2=1.1 * settings.actuator.inertia)


def resized(heavier: str, factor: float) -> PlantSettings:
    """One side, ``"actuator"`` or ``"load"``, with ``factor`` times its inertia."""
    sides = {"actuator": ACTUATOR, "load": LOAD}
    sides[heavier] = replace(sides[heavier], inertia=factor * sides[heavier].inertia)
    return PlantSettings(**sides)


def slow_command(ticks: int) -> FloatArray:
    """Up to 3 Hz, with many reversals; undriven, the port sees about 13 mN m."""
    return 0.09 * multisine(ticks * TICK_S, TICK_S, low_hz=0.2, high_hz=3.0, seed=2, slope=-0.5)


def undriven_rms_nm(settings: PlantSettings, command: FloatArray, skip: int = 500) -> float:
    plant, squares = Plant(settings), []
    for value in command:
        plant.step(value, 0.0)
        squares.append(plant.mean_square)
    return float(np.sqrt(np.mean(squares[skip:])))


def warmed_up(settings: PlantSettings, calibration: LoadCalibration) -> tuple[Plant, AdmittanceController]:
    """A plant at rest, watched by a controller that has not taken over yet."""
    plant, controller = Plant(settings), AdmittanceController(calibration, TICK_S, LIMIT_NM)
    for _ in range(WARM_TICKS):
        controller.observe(plant.sample())
        controller.note_sent(0.0)
        plant.step(0.0, 0.0)
    return plant, controller


def driven(
    settings: PlantSettings,
    calibration: LoadCalibration,
    command: FloatArray,
    admittance: Admittance,
    motion: Motion,
    held_s: Mapping[int, float] = MappingProxyType({}),
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Load position and velocity at the ticks, and the mean square of the port torque over each; shape (ticks,).

    ``held_s``: for how long readings are held back from each of these ticks on.
    """
    plant, controller = warmed_up(settings, calibration)
    sample = plant.sample()
    controller.begin(sample, admittance)
    rows = []
    last = len(command) - 1
    for tick, value in enumerate(command):
        if tick in held_s:
            plant.hold_readings(held_s[tick])
        near, far = (
            target_at(motion, sample.load_position_rad, at) for at in (tick, min(tick + controller.lead_ticks, last))
        )
        wish = controller.update(plant.sample(), near, far)
        controller.note_sent(wish)
        position, velocity = plant.state[4] - sample.load_position_rad, plant.state[5]
        plant.step(value, wish)
        rows.append((position, velocity, plant.mean_square))
    return tuple(np.array(rows).T)


def target_at(motion: Motion, base_rad: float, tick: int) -> Target:
    return Target(base_rad + motion.position_rad[tick], motion.velocity_rad_s[tick], motion.acceleration_rad_s2[tick])


def at_rest(ticks: int) -> Motion:
    return Motion(np.zeros(ticks), np.zeros(ticks), np.zeros(ticks))


def zero_torque_rms_nm(
    settings: PlantSettings,
    command: FloatArray,
    motion: Motion | None = None,
    *,
    calibration: LoadCalibration | None = None,
    skip: int = 500,
) -> float:
    known = calibration or calibrated(settings)
    squares = driven(settings, known, command, ZERO_TORQUE, motion or at_rest(len(command)))[2]
    return float(np.sqrt(np.mean(squares[skip:])))


def network_of(settings: PlantSettings, error: float) -> NortonNetwork:
    """The plant's actuator, its parameters off by ``error`` up and down by turns."""
    side = settings.actuator
    true = (side.gain, side.beta, side.inertia, side.damping, side.coulomb, side.sigma_0, side.sigma_1)
    off = [value * (1 + error * (-1) ** i) for i, value in enumerate(true)]
    return NortonNetwork(*off, command_unit="N*m")
