"""An identified motor for robot simulators: a joint of URDF, an actuator of Isaac Lab, and ranges to draw from.

URDF's joint has ``damping`` [N m s/rad] and ``friction`` [N m] (wiki.ros.org/urdf/XML/joint). Isaac Lab's actuator
configuration has ``armature``, and PhysX's joint friction of Isaac Sim 5.0 and later: ``friction`` at rest and
``dynamic_friction`` in sliding [N m], ``viscous_friction`` [N m s/rad] (isaaclab.actuators.ActuatorBaseCfg, 2.3 and
3.0). Neither has words for the command's path, for presliding or for most terms: what is left out is said, with what
it costs (:mod:`norton_bench.networks.left_out`).
"""

import json
import re
from dataclasses import replace
from textwrap import wrap
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from norton_bench.errors import UsageError
from norton_bench.models.drawn_motor import drawn_values, possible
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import BY_NAME, HALF_INTERVAL
from norton_bench.models.terms import TERM_BY_NAME, TERM_PARAMETERS
from norton_bench.networks.family import Network
from norton_bench.networks.left_out import (
    ExportedModel,
    cost_percent,
    presliding_sentence,
    standard_motion,
    term_sentences,
)

# A lag so much shorter is none.
QUICKER = 1e6
RANGES_FORMAT, RANGES_VERSION = "norton-ranges", 1
DRAWS, SEED = 200, 0
WIDTH = 120


def export_urdf(network: Network, name: str) -> ExportedModel:
    """A link with the rotor's inertia on a continuous joint. Raises UsageError for what is no identified motor."""
    motor = _of_effort(network, "URDF's joint")
    left_out = _left_out(motor)
    inertia = motor.inertia_kgm2
    lines = [
        '<?xml version="1.0"?>',
        f"<robot name={quoteattr(name)}>",
        "  <!-- An equivalent network exported by norton-bench. SI; the joint's effort is the motor's torque. -->",
        *(f"  <!-- {sentence.replace('--', '- -')} -->" for sentence in left_out),
        '  <link name="base"/>',
        '  <joint name="port" type="continuous">',
        '    <parent link="base"/>',
        '    <child link="output"/>',
        '    <axis xyz="0 0 1"/>',
        f'    <dynamics damping="{motor.viscous_damping_nms_rad!r}" friction="{motor.coulomb_torque_nm!r}"/>',
        "  </joint>",
        "  <!-- URDF has no armature: the rotor is a link. What is moved goes in here or on a link behind it. -->",
        '  <link name="output">',
        "    <inertial>",
        f'      <mass value="{max(1e-3, inertia)!r}"/>',
        f'      <inertia ixx="{inertia!r}" ixy="0" ixz="0" iyy="{inertia!r}" iyz="0" izz="{inertia!r}"/>',
        "    </inertial>",
        "  </link>",
        "</robot>",
        "",
    ]
    return ExportedModel("\n".join(lines), left_out)


def export_isaac_lab(network: Network, name: str) -> ExportedModel:
    """A Python file with one actuator configuration. Raises UsageError for what is no identified motor."""
    motor = _of_effort(network, "Isaac Lab's actuator")
    left_out = _left_out(motor)
    more_at_rest_nm = sum(term.values[0] for term in motor.terms if term.name == "stribeck")
    if more_at_rest_nm:
        left_out = (*left_out, "Of the term stribeck the friction at rest is kept.")
    variable = re.sub(r"\W|^(?=\d)", "_", f"{name}_actuator").upper()
    lines = [
        '"""An equivalent network exported by norton-bench, for Isaac Lab 2.3 and newer on Isaac Sim 5.0 and newer.',
        "",
        "SI. The actuator is commanded by effort targets: the motor's torque.",
        *(line for sentence in left_out for line in wrap(sentence, WIDTH)),
        '"""',
        "",
        "from isaaclab.actuators import ImplicitActuatorCfg",
        "",
        f"{variable} = ImplicitActuatorCfg(",
        '    joint_names_expr=[".*"],',
        "    stiffness=0.0,",
        "    damping=0.0,",
        f"    armature={motor.inertia_kgm2!r},  # kg m^2",
        f"    friction={motor.coulomb_torque_nm + more_at_rest_nm!r},  # N m, at rest",
        f"    dynamic_friction={motor.coulomb_torque_nm!r},  # N m, in sliding",
        f"    viscous_friction={motor.viscous_damping_nms_rad!r},  # N m s/rad",
        ")",
        "",
    ]
    return ExportedModel("\n".join(lines), left_out)


def export_ranges(network: Network, name: str) -> ExportedModel:
    """JSON with each parameter's 95 % interval, and DRAWS sets of values that go together as their covariance has it.

    Sets with values that no machine has are left out. Raises UsageError for a network without covariance.
    """
    motor = _identified(network, "a range")
    values, names = motor.values(), motor.covariance_names
    if not names:
        raise UsageError(f"{name}: the network has no covariance, so no range is known; fit its recording again")
    draws = [each for each in drawn_values(motor, SEED).tolist() if possible(names, each)][:DRAWS]
    half = HALF_INTERVAL * np.sqrt(np.diag(np.asarray(motor.covariance)))
    content = {
        "format": RANGES_FORMAT,
        "version": RANGES_VERSION,
        "network": name,
        "parameters": {
            each: _range(each, values[each], float(width), motor.command_unit)
            for each, width in zip(names, half, strict=True)
        },
        "draws": {"names": names, "values": draws},
    }
    return ExportedModel(json.dumps(content, indent=1) + "\n", (ONE_ACTUATOR,))


ONE_ACTUATOR = (
    "The ranges are what one session leaves open of one actuator. Other units of its type differ by more: fit several "
    "sessions or units together, and their spread is in the covariance."
)


def _range(name: str, value: float, half: float, command_unit: str) -> dict[str, Any]:
    parameter = BY_NAME[name] if name in BY_NAME else TERM_PARAMETERS[name]
    low, high = value - half, value + half
    return {"value": value, "low": low, "high": high, "unit": parameter.unit_for(command_unit)}


def _identified(network: Network, target: str) -> NortonNetwork:
    if not isinstance(network, NortonNetwork):
        raise UsageError(f"{target} is made from an identified motor; export this network as C or as an FMU")
    if "scale" in network.provenance:
        raise UsageError(f"{target} needs a scale, and this network holds only ratios; measure torque, too")
    return network


def _of_effort(network: Network, target: str) -> NortonNetwork:
    """One that takes a torque for its command, so that its loop needs no words."""
    motor = _identified(network, target)
    if motor.servo is not None:
        raise UsageError(f"{target} as it is written here takes an effort, and a servo none; export it --to mujoco")
    return motor


def _left_out(motor: NortonNetwork) -> tuple[str, ...]:
    """What neither URDF nor Isaac Lab has words for."""
    return (_path(motor), presliding_sentence(motor), *term_sentences(motor, tuple(TERM_BY_NAME)))


def _path(motor: NortonNetwork) -> str:
    """What the command goes through before it is a torque."""
    at_once = replace(motor, amplifier_bandwidth_rad_s=QUICKER * motor.amplifier_bandwidth_rad_s)
    motion = standard_motion(motor)
    cost = cost_percent(motor, at_once, motion)
    return (
        f"The path of the command is left out: the effort to send is {motor.torque_gain:.5g} N m per "
        f"{motor.command_unit} of command, behind a lag of {1e3 / motor.amplifier_bandwidth_rad_s:.3g} ms. To leave "
        f"the lag out costs {cost:.2g} % of the torque's rms, over {motion.words}."
    )
