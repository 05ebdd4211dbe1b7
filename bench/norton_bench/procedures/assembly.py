"""What is known of an assembly: its load and its actuator, told apart by shaking both."""

from norton_bench.errors import ExperimentError
from norton_bench.identification.assembly import LoadByTwist, Machine, actuator_behind, load_by_twist
from norton_bench.models.network import told_deviations
from norton_bench.models.parameters import HALF_INTERVAL
from norton_bench.procedures.knowledge import Knowledge, why_no_basis
from norton_bench.procedures.learning import Assembly
from norton_bench.procedures.options import InSituOptions
from norton_bench.records import Measured

# A given inertia of the load is ignored if it differs from the measured one by more than both of these.
DEVIATIONS, SHARE = 3.0, 0.01


def assembly_of(known: Knowledge, shaken: Measured, options: InSituOptions) -> Assembly:
    """Load and actuator by ``shaken``, in which both were shaken independently.

    Raises ExperimentError where the load cannot be told from the actuator, or has more than inertia and friction.
    """
    load, said = _load(known, shaken, options)
    actuator, origin = _actuator(known, shaken, load)
    return Assembly(load, actuator, (*said, origin))


def _actuator(known: Knowledge, measured: Measured, load: Machine) -> tuple[Machine | None, str]:
    """The actuator's model, where it has one that the shaking confirms, and a sentence."""
    learned = "its response is learned from the trials"
    if not known.rig.modelled:
        return None, f"the actuator has no model: {learned}"
    if known.rig.servo is not None:
        return None, f"the actuator is a servo: {learned}"
    try:
        fit = actuator_behind(measured, load, known.tick_s, known.rig.command.unit)
    except ExperimentError as error:
        return None, f"the actuator behind its load cannot be fitted ({error}): {learned}"
    fault = why_no_basis(fit, "the actuator behind its load")
    if fault is not None:
        return None, f"{fault}: {learned}"
    return Machine.of_fit(fit), "the trials begin from a fit of the actuator"


def _load(known: Knowledge, measured: Measured, options: InSituOptions) -> tuple[Machine, tuple[str, ...]]:
    """The load: from the twist between the encoders if that is precise enough, else from calibration and options.

    Raises ExperimentError where the data do not separate it from the actuator.
    """
    # The scale of the torque sensor, by which it was calibrated, differs from that of the load's drive.
    calibrated = None if known.calibration is None else Machine.of_load(known.calibration).in_drive_units()
    try:
        by_twist = load_by_twist(measured, known.tick_s)
    except ExperimentError as error:
        if calibrated is None:
            raise ExperimentError(
                "in_situ: load and actuator cannot be separated: the coupling twists too little for their encoders, or "
                "more than inertia and friction acts on the load; run the step 'calibrate' with a torque sensor before "
                "it, or join them less stiffly"
            ) from error
        assert known.calibration is not None
        _refuse_arm(known.calibration.weight_nm)
        assumed = _with(calibrated, options)
        sentence = (
            f"the load's inertia is assumed to be {_kgm2(assumed)} and cannot be checked, because the coupling twists"
        )
        return assumed, (f"{sentence} too little; an error of it is an error of the source, too",)
    _refuse_arm(by_twist.weight_nm)
    return _by_twist(by_twist, calibrated, options)


def _refuse_arm(weight_nm: float) -> None:
    """Raises ExperimentError for the weight of an arm on the load."""
    if weight_nm > 0.0:
        raise ExperimentError(
            f"in_situ: an arm hangs on the load, with a torque of up to {weight_nm:.3g} N*m by position; the step "
            "supplies inertia and friction alone: take the arm off, balance it, or stand its axis upright"
        )


def _by_twist(
    by_twist: LoadByTwist, calibrated: Machine | None, options: InSituOptions
) -> tuple[Machine, tuple[str, ...]]:
    machine, deviation = by_twist.machine, by_twist.inertia_deviation
    half = 100 * HALF_INTERVAL * deviation
    sentences = [f"the load's inertia is {_kgm2(machine)} ±{half:.1f} %, by the twist between the encoders"]
    given_kgm2 = options.inertia_kgm2
    if given_kgm2 is not None:
        off = given_kgm2 / machine.network.inertia_kgm2 - 1.0
        if abs(off) > max(DEVIATIONS * deviation, SHARE):
            sentences.append(f"the given value {given_kgm2:.3g} kg*m^2 differs by {100 * off:+.0f} %, and is ignored")
    if options.viscous_damping_nms_rad is not None:
        machine = machine.knowing("viscous_damping", options.viscous_damping_nms_rad)
    elif calibrated is not None:
        std_nms_rad = told_deviations(calibrated.network).get("viscous_damping", 0.0)
        machine = machine.knowing("viscous_damping", calibrated.network.viscous_damping_nms_rad, std_nms_rad)
    else:
        sentences.append("its viscous damping is computed as if both encoders were read at the same instant")
    return machine, tuple(sentences)


def _with(machine: Machine, options: InSituOptions) -> Machine:
    """The machine with the values given in the options."""
    if options.inertia_kgm2 is not None:
        machine = machine.knowing("inertia", options.inertia_kgm2)
    if options.viscous_damping_nms_rad is not None:
        machine = machine.knowing("viscous_damping", options.viscous_damping_nms_rad)
    return machine


def _kgm2(machine: Machine) -> str:
    return f"{machine.network.inertia_kgm2:.4g} kg*m^2"
