"""Calibration of the load drive and the torque sensor, from which the controller is tuned."""

from dataclasses import dataclass, field, replace
from math import inf
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.calibration import ActuatorFriction, LoadCalibration
from norton_bench.control.design import actuator_inertias
from norton_bench.distributions import normal_hazard
from norton_bench.errors import ExperimentError
from norton_bench.identification.apparent_inertia import apparent_inertia_kgm2
from norton_bench.identification.cleaning import clean
from norton_bench.identification.coupling import surely_damped_nms_rad
from norton_bench.identification.fit import fit_signals
from norton_bench.identification.load import LoadFit, fit_load
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import Port, signals
from norton_bench.models.parameters import Status
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.options import CalibrateOptions
from norton_bench.procedures.servo_room import greatest_shake
from norton_bench.procedures.tare import greatest_load_torque
from norton_bench.procedures.waves import back, coasting, growth, highest_hz, hold, multisine, pushed
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

SEARCH_S = 4.0
REST_S = 0.4
PIECE_S = 2.0
# The shaft should reach this share of the velocity limit. Friction makes speed grow faster than torque, and a
# multisine's later peaks may be higher, so that each piece is scaled by the speed in the last one.
SPEED_SHARE = 0.4
# The load may push so many times harder than the actuator, as a share of what either needed to set the shaft in motion:
# beyond that hardly anything of the port torque is the actuator's own, and the load's part cannot be told from it.
STRONGER = 3.0
# A piece ends early at this share of the velocity limit: what friction held back in one may run away in the next.
TOO_FAST = 0.7
BACK_OFF = 0.3
GREATEST_STEP = 1.5
# Of a fit that did not converge: deviations, relative, that the controller's margins (`design.miscalibrated`)
# allow for twice over; and what it may leave of the torque, noise included.
SURE_OF = {"torque_gain": 0.05, "inertia": 0.05, "coulomb_torque": 0.1}
EXPLAINED = 0.5
# Deviations up to which the controller builds on the actuator's friction, relative.
WELL_KNOWN = {"inertia": 0.05, "coulomb_torque": 0.05, "presliding_stiffness": 0.2}


@dataclass(frozen=True)
class CalibrateProcedure:
    """Shakes the shaft from both ends, and fits the load in the same way as an actuator."""

    options: CalibrateOptions = field(default_factory=CalibrateOptions)
    name: ClassVar[str] = "calibrate"

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "to calibrate")

    def duration_s(self, rig: Rig) -> float:
        return SEARCH_S + self._pieces() * PIECE_S + 2 * REST_S

    def plan(self, known: Knowledge) -> Plan:
        tick_s = known.tick_s
        fast_rad_s = SPEED_SHARE * known.rig.limits.velocity_rad_s
        envelope = growth(1.0, SEARCH_S, tick_s)
        torque_nm, command = self._shake(known, SEARCH_S, seed=11)
        measured = yield pushed(
            self.name,
            "search",
            Use.PREPARE,
            envelope * torque_nm,
            envelope * command,
            stop_at_velocity_rad_s=fast_rad_s,
        )
        share = BACK_OFF * float(envelope[len(measured.ticks) - 1])
        yield back(self.name, "rest", known.rig, measured, REST_S)
        for piece in range(self._pieces()):
            torque_nm, command = self._shake(known, PIECE_S, seed=13 + 2 * piece)
            measured = yield pushed(
                self.name,
                "shake",
                Use.CALIBRATE,
                share * torque_nm,
                share * command,
                stop_at_velocity_rad_s=TOO_FAST * known.rig.limits.velocity_rad_s,
            )
            if len(measured.ticks) < len(command):
                yield back(self.name, "rest", known.rig, measured, REST_S)
            peak_rad_s = float(np.max(np.abs(measured.ticks["velocity_rad_s"]), initial=0.0))
            share = min(share * float(np.clip(fast_rad_s / max(peak_rad_s, 1e-9), 0.5, GREATEST_STEP)), 1.0)
        yield coasting(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, tick_s))

    def _pieces(self) -> int:
        return max(1, round(self.options.duration_s / PIECE_S))

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        if known.tare is None:
            raise ExperimentError("calibrate: needs the noise at rest; run the step 'tare' before it")
        fit = fit_load(measured, tick_s=known.tick_s)
        if not known_well_enough(fit.result):
            raise ExperimentError("calibrate: the load's fit did not converge; " + "; ".join(fit.result.verdict))
        if known.rig.modelled:
            actuator = self._actuator(known, measured)
            calibration = calibration_from(fit, known, first_inertia_kgm2(actuator), first_friction(actuator))
            return replace(known, calibration=calibration, actuator=actuator)
        inertia_kgm2 = apparent_inertia_kgm2(measured, known.tick_s, -fit.result.motion_delay_s)
        calibration, weighed = (calibration_from(fit, known, each) for each in (None, inertia_kgm2))
        (low_kgm2, high_kgm2), (least_kgm2, most_kgm2) = map(actuator_inertias, (calibration, weighed))
        if most_kgm2 < low_kgm2 or high_kgm2 < least_kgm2:  # gains without an estimate do not suit it
            calibration = weighed
        return replace(known, calibration=calibration, actuator=None)

    def _actuator(self, known: Knowledge, measured: Measured) -> FitResult:
        shaken = signals(clean(measured).measured, known.tick_s, Use.CALIBRATE, Port.ACTUATOR)
        return fit_signals(shaken, command_unit=known.rig.command.unit, both_driven=True)

    def _shake(self, known: Knowledge, duration_s: float, seed: int) -> tuple[FloatArray, FloatArray]:
        """Load torque and actuator command, as great as the rig allows; neither may hide the other.

        Both are needed, and must be independent: with a passive actuator the port torque would be a function of the
        motion alone, and no fit could separate inertia and friction of the load from those of the actuator.
        """
        tick_s = known.tick_s
        low_hz, high_hz = 1.0, highest_hz(tick_s)
        load, actuator = (
            multisine(duration_s, tick_s, low_hz=low_hz, high_hz=high_hz, seed=each, slope=-0.25)
            for each in (seed, seed + 1)
        )
        return _load_strength_nm(known) * load, greatest_shake(known.rig) * actuator


def _load_strength_nm(known: Knowledge) -> float:
    command, tare = known.rig.command, known.tare
    greatest_nm = greatest_load_torque(known.rig)
    # A command that is not a torque, such as a position, gives no torque that sets the shaft in motion.
    if command.sent_as is not None or tare is None or not tare.moving_command or not tare.moving_load_nm:
        return greatest_nm
    return min(greatest_nm, STRONGER * abs(tare.moving_load_nm / tare.moving_command) * greatest_shake(known.rig))


def calibration_from(
    fit: LoadFit, known: Knowledge, actuator_kgm2: float | None, friction: ActuatorFriction | None = None
) -> LoadCalibration:
    """What the controller needs, from the load's fit, the tare, and inertia and friction of the actuator."""
    network, tare = fit.result.network.dissipative(), known.tare
    assert tare is not None
    return LoadCalibration(
        torque_gain=network.torque_gain,
        amplifier_bandwidth_rad_s=network.amplifier_bandwidth_rad_s,
        inertia_kgm2=network.inertia_kgm2,
        viscous_damping_nms_rad=network.viscous_damping_nms_rad,
        coulomb_torque_nm=network.coulomb_torque_nm,
        presliding_stiffness_nm_rad=network.presliding_stiffness_nm_rad,
        presliding_damping_nms_rad=likely_presliding_damping_nms_rad(fit.result),
        command_delay_s=fit.result.command_delay_s,
        measurement_delay_s=0.0,
        motion_delay_s=fit.result.motion_delay_s,
        sensor_stiffness_nm_rad=fit.sensor_stiffness_nm_rad,
        sensor_damping_nms_rad=least_sensor_damping_nms_rad(fit, actuator_kgm2),
        torque_noise_nm=tare.torque_noise_nm,
        torque_bias_nm=tare.torque_bias_nm if fit.weight_nm else fit.torque_bias_nm,
        position_resolution_rad=fit.position_resolution_rad,
        position_jitter_s=fit.position_jitter_s,
        actuator_inertia_kgm2=actuator_kgm2,
        actuator_friction=friction,
        weight_nm=fit.weight_nm,
        covariance_names=network.covariance_names,
        covariance=network.covariance,
    )


def likely_presliding_damping_nms_rad(machine: FitResult) -> float:
    """The mean of what it may be: normally distributed about the estimate, and not negative.

    Where encoders do not resolve the contact, the estimate itself may be zero. Such a contact would ring for ever, and
    no feedback is stable on it; it is not what the calibration says. An estimate below zero is wrong by as much as that
    at least, whatever its deviation: a delay that is off by τ turns a stiffness σ0 into a damping of −σ0 τ.
    """
    estimate = machine.estimate("presliding_damping")
    if not 0.0 < estimate.std < inf:
        return max(estimate.value, 0.0)
    std = max(estimate.std, -estimate.value)
    return estimate.value + std * normal_hazard(-estimate.value / std)


def known_well_enough(machine: FitResult) -> bool:
    """Whether controllers and plans can use a fit: it converged, or gain, inertia and Coulomb torque are well known.

    The data do not determine a friction contact much shorter than an encoder count, and the search for it may not end;
    gain, inertia and Coulomb torque do not depend on it.
    """
    if machine.converged:
        return True
    sure = all(
        0.0 < estimate.std <= part * estimate.value
        for estimate, part in ((machine.estimate(name), part) for name, part in SURE_OF.items())
    )
    return sure and machine.torque_relative < EXPLAINED


def first_inertia_kgm2(actuator: FitResult | None) -> float | None:
    """The inertia of the actuator from its calibration; the lag of a winding can make it seem negative.

    With a noisy sensor only the ratio to the torque gain may be known, which is not an inertia.
    """
    if actuator is None or actuator.estimate("inertia").status is Status.RATIO_ONLY:
        return None
    inertia_kgm2 = actuator.network.inertia_kgm2
    return inertia_kgm2 if known_well_enough(actuator) and inertia_kgm2 > 0.0 else None


def first_friction(actuator: FitResult | None) -> ActuatorFriction | None:
    """The friction of the actuator, where the calibration gives it and the inertia well enough."""
    if actuator is None or first_inertia_kgm2(actuator) is None or not well_known(actuator) or actuator.network.servo:
        return None
    network = actuator.network.dissipative()
    return ActuatorFriction(
        network.viscous_damping_nms_rad,
        network.coulomb_torque_nm,
        network.presliding_stiffness_nm_rad,
        likely_presliding_damping_nms_rad(actuator),
    )


def well_known(actuator: FitResult) -> bool:
    """Whether inertia and friction are valid, and known to WELL_KNOWN.

    This may be so although the search did not end, for example for the bandwidth of a very fast amplifier.
    """
    sound = (Status.VALID, Status.NOT_CONVERGED) if known_well_enough(actuator) else (Status.VALID,)
    return all(
        estimate.status in sound and estimate.std <= part * abs(estimate.value)
        for estimate, part in ((actuator.estimate(name), part) for name, part in WELL_KNOWN.items())
    )


def least_sensor_damping_nms_rad(fit: LoadFit, actuator_kgm2: float | None) -> float:
    """What it has with a probability of 95 %, at the resonance of both machines.

    A feedback that is stable with too much damping may not be with what the sensor has. The twist tells little of it: a
    fifth of it, or more, is usual for its deviation.
    """
    mobility = 1 / fit.result.network.inertia_kgm2 + (1 / actuator_kgm2 if actuator_kgm2 else 0.0)
    return surely_damped_nms_rad(
        fit.sensor_damping_nms_rad, fit.sensor_damping_std_nms_rad, fit.sensor_stiffness_nm_rad, mobility
    )
