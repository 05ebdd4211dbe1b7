"""One actuator of each kind, as tables of a rig file, with a load and a sensor."""

from typing import Any

from norton_sim.truth import Truth, read_truth

DRIVE = {"amplifier_bandwidth": "600 rad/s"}
OUTPUT = {"inertia": "5e-5 kg*m^2", "viscous_damping": "5e-4 N*m*s/rad"}
ROUGH = {"coulomb_torque": "4 mN*m", "presliding_stiffness": "4 N*m/rad", "presliding_damping": "5 mN*m*s/rad"}
MOTOR = {"torque_constant": "0.05 N*m/A", "inertia": "2e-4 kg*m^2", "viscous_damping": "2e-3 N*m*s/rad", **ROUGH}
SERVO = {"stiffness": "12 N*m/rad", "damping": "0.06 N*m*s/rad"}

# The unit of the command, and the actuator's table.
ACTUATORS: dict[str, tuple[str, dict[str, Any]]] = {
    "pneumatic_muscle": (
        "N*m/rad",
        {"amplifier_gain": "20 A/(N*m/rad)", "spring": "0.3 N*m/rad", "output": {**OUTPUT, **ROUGH}},
    ),
    "series_elastic": (
        "rad",
        {
            "amplifier_gain": "10 A/rad",
            "motor": MOTOR,
            "servo": SERVO,
            "spring": {"stiffness": "3 N*m/rad", "damping": "5 mN*m*s/rad"},
            "output": OUTPUT,
        },
    ),
    "gear_train": (
        "rad",
        {
            "amplifier_gain": "10 A/rad",
            "motor": MOTOR,
            "servo": SERVO,
            "backlash": {"width": "20 mrad", "stiffness": "60 N*m/rad", "damping": "20 mN*m*s/rad"},
            "load_friction": "0.1",
            "output": OUTPUT,
        },
    ),
    "variable_stiffness": (
        "rad",
        {
            "amplifier_gain": "10 A/rad",
            "motor": MOTOR,
            "servo": SERVO,
            "spring": {
                "stiffness": "1 N*m/rad",
                "stiffening": "5 N*m/rad^2",
                "stiffest": "6 N*m/rad",
                "hardening": "4 N*m/rad^3",
                "damping": "5 mN*m*s/rad",
            },
            "output": OUTPUT,
        },
    ),
    "arm": (
        "rad",
        {
            "amplifier_gain": "10 A/rad",
            "stiffness": "2 N*m/rad",
            "moving_stiffness": "1.5 N*m/rad",
            "damping": "20 mN*m*s/rad",
            "movement": "40 ms",
            "output": {"inertia": "4e-4 kg*m^2"},
        },
    ),
}
MODULATOR = {
    "amplifier_gain": "2 A/(N*m/rad)",
    "travel": "0.2 rad/(N*m/rad)",
    "amplifier_bandwidth": "600 rad/s",
    "bandwidth": "40 rad/s",
}
LOAD = {
    "torque_gain": "0.95",
    "amplifier_bandwidth": "1000 rad/s",
    "inertia": "1.2e-4 kg*m^2",
    "viscous_damping": "3e-4 N*m*s/rad",
    "coulomb_torque": "8 mN*m",
    "presliding_stiffness": "8 N*m/rad",
}


def table_of(model: str, **changes: Any) -> dict[str, Any]:
    """The actuator's table, with keys changed, or left out where None."""
    table = {"model": model, **DRIVE, **ACTUATORS[model][1], **changes}
    return {key: value for key, value in table.items() if value is not None}


def truth_of(
    model: str, *, load: dict[str, Any] | None = LOAD, modulator: dict[str, Any] | None = None, **changes: Any
) -> Truth:
    """The bench, with keys of the actuator changed, or left out where None."""
    written = {"actuator": table_of(model, **changes), "load": load, "modulator": modulator}
    given = {key: value for key, value in written.items() if value is not None}
    return read_truth(given, seed=None, place="rig.toml", command_unit=ACTUATORS[model][0])
