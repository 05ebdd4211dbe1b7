"""Benches whose actuators are the joints of one arm: their plants move together, in one time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from norton_drivers.errors import WiringError
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend, simulated_backend
from norton_sim.plant import Plant
from norton_sim.plants import two_joints
from norton_sim.plants.muscles import ArmTruth
from norton_sim.plants.two_joints import TwoJointsTruth
from norton_sim.tables import complaints
from norton_sim.truth import read_truth
from norton_sim.world import Timeline

JOINTS = ("shoulder", "elbow")


@dataclass
class TwoJoints:
    """The plants of two benches, both of model "arm", as shoulder and elbow; ``row`` joins them."""

    joints: list[Plant]
    row: NDArray[np.float64]

    def advance(self, to_ns: int) -> None:
        """Let time pass for both until ``to_ns``."""
        shoulder, elbow = self.joints
        first, second = shoulder.mechanics, elbow.mechanics
        assert first.bench.link is not None
        assert second.bench.link is not None
        two_joints.advance(
            (first.state, second.state),
            (first.bench.machines, second.bench.machines),
            ((first.bench.stiffness, first.bench.damping), (second.bench.stiffness, second.bench.damping)),
            (first.bench.link, second.bench.link),
            (first.reach, second.reach),
            self.row,
            min(first.substep_s, second.substep_s),
            shoulder.now_ns,
            to_ns,
        )
        shoulder.now_ns = elbow.now_ns = to_ns


def open_two_joints(
    benches: Sequence[tuple[Wiring, Mapping[str, Any], str]], arm: Mapping[str, Any], *, seed: int | None, place: str
) -> tuple[SimulatedBackend, ...]:
    """Shoulder and elbow, each by its wiring, the ``[simulated]`` of its rig file, and that file's place.

    ``arm`` is the table that joins them, from the file ``place``. Everything is at standstill at time zero. With a
    ``seed`` the elbow's noise has the next one. Raises WiringError, with place and mend, for true values that are wrong
    or missing.
    """
    joined = TwoJoints([], _arm(arm, place).row)
    for name, bench in zip(JOINTS, benches, strict=True):
        _arm_of(name, *bench)
    timeline = Timeline(joined.advance)
    backends = []
    for joint, (wiring, simulated, rig_place) in enumerate(benches):
        own_seed = None if seed is None else seed + joint
        backend = simulated_backend(wiring, simulated, seed=own_seed, place=rig_place, timeline=timeline)
        joined.joints.append(backend.world.plant)
        backends.append(backend)
    joined.advance(0)  # compiled here, rather than within the first tick
    return tuple(backends)


def true_joints(
    benches: Sequence[tuple[Wiring, Mapping[str, Any], str]], arm: Mapping[str, Any], *, place: str
) -> dict[str, NDArray[np.float64]]:
    """What is true of the joined plants about where they begin, each of shape (2, 2), by row the joint that exerts.

    ``inertia`` [kg m²], ``damping`` [N m s/rad] and ``stiffness`` [N m/rad] of the posture. Raises WiringError.
    """
    table = _arm(arm, place)
    row = table.row
    own = [_arm_of(each, *bench) for each, bench in zip(JOINTS, benches, strict=True)]
    stiffness = np.diag([each.stiffness_nm_rad for each in own])
    stiffness += [[0.0, row[two_joints.STIFFNESS_12]], [row[two_joints.STIFFNESS_21], 0.0]]
    damping = np.diag([each.damping_nm_s_rad + each.output.viscous_damping_nm_s_rad for each in own])
    damping += [[0.0, row[two_joints.DAMPING_12]], [row[two_joints.DAMPING_21], 0.0]]
    inertia = table.inertia_kg_m2(0.0) + np.diag([each.output.inertia_kg_m2 for each in own])
    return {"inertia": inertia, "damping": damping, "stiffness": stiffness}


def _arm(written: Mapping[str, Any], place: str) -> TwoJointsTruth:
    try:
        return TwoJointsTruth.model_validate(dict(written))
    except ValidationError as error:
        told = complaints(error, TwoJointsTruth, written, place=place, name="simulated")
        raise WiringError("\n".join(told)) from error


def _arm_of(joint: str, wiring: Wiring, simulated: Mapping[str, Any], place: str) -> ArmTruth:
    truth = read_truth(simulated, seed=None, place=place, command_unit=wiring.command_unit)
    if not isinstance(truth.actuator, ArmTruth) or wiring.load is None:
        raise WiringError(
            f'{place}: the simulated {joint} must be of model = "arm" in [simulated.actuator], with a load; or leave '
            "the [simulated] table out of the file of the joints"
        )
    return truth.actuator
