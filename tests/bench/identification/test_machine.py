"""A machine in other newton metres: those that its own drive counts."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.assembly import Machine
from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import NetworkTerm

GAIN, TICK_S = 0.95, 1e-3
MACHINE = Machine(
    NortonNetwork(
        torque_gain=GAIN,
        amplifier_bandwidth_rad_s=1000.0,
        inertia_kgm2=1.2e-4,
        viscous_damping_nms_rad=3e-4,
        coulomb_torque_nm=8e-3,
        presliding_stiffness_nm_rad=8.0,
        presliding_damping_nms_rad=5e-3,
        command_unit="N*m",
    ),
    command_delay_s=1e-3,
    motion_delay_s=5e-4,
)


TERMS = (
    NetworkTerm("stribeck", (2e-3, 2.0)),
    NetworkTerm("load", (0.05,)),
    NetworkTerm("saturation", (3.0,)),
    NetworkTerm("drag", (1e-5,)),
    NetworkTerm("cogging", (1e-3, 2e-3), 7),
)


@pytest.mark.parametrize("terms", [(), TERMS], ids=["plain", "with terms"])
def test_in_its_drives_units_the_same_motion_takes_as_much_more_as_the_drive_counts(
    terms: tuple[NetworkTerm, ...],
) -> None:
    machine = replace(MACHINE, network=replace(MACHINE.network, terms=terms))
    time_s = np.arange(2000) * TICK_S
    command, position_rad = 0.1 * np.sin(9 * time_s), 0.5 * np.sin(7 * time_s)
    scaled = machine.in_drive_units()
    assert scaled.network.torque_gain == 1.0
    expected = machine.torque_nm(command, position_rad, TICK_S) / GAIN
    assert scaled.torque_nm(command, position_rad, TICK_S) == pytest.approx(expected, abs=1e-9)
