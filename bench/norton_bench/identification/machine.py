"""One machine as its model sees it at the ticks: from what was sent and what arrived to the torque at its port."""

from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.preview import delayed
from norton_bench.identification.results import FitResult
from norton_bench.models.network import NortonNetwork


@dataclass(frozen=True)
class Machine:
    """A network, and the delays of its command and its motion; both count from the arrivals of the same readings."""

    network: NortonNetwork
    command_delay_s: float
    motion_delay_s: float

    @classmethod
    def of_fit(cls, fit: FitResult) -> "Machine":
        return cls(fit.network, fit.command_delay_s, fit.motion_delay_s)

    @classmethod
    def of_load(cls, load: LoadCalibration) -> "Machine":
        motion_s = load.measurement_delay_s if load.motion_delay_s is None else load.motion_delay_s
        return cls(load.network, load.command_delay_s, motion_s)

    def in_drive_units(self) -> "Machine":
        """The same in newton metres as its own drive counts them: with a torque gain of 1."""
        network, gain = self.network, self.network.torque_gain
        scaled = replace(
            network,
            torque_gain=1.0,
            inertia_kgm2=network.inertia_kgm2 / gain,
            viscous_damping_nms_rad=network.viscous_damping_nms_rad / gain,
            coulomb_torque_nm=network.coulomb_torque_nm / gain,
            presliding_stiffness_nm_rad=network.presliding_stiffness_nm_rad / gain,
            presliding_damping_nms_rad=max(network.presliding_damping_nms_rad / gain, 0.0),
            covariance_names=(),
            covariance=(),
        )
        return replace(self, network=scaled)

    def torque_nm(self, command: FloatArray, position_rad: FloatArray, tick_s: float) -> FloatArray:
        """What it exerts at its port, (ticks,), by what was sent to it and what arrived of its position."""
        held = delayed(command, tick_s, self.command_delay_s)
        return self.network.torque(held, delayed(position_rad, tick_s, -self.motion_delay_s), tick_s)

    def command_for(self, motor_nm: FloatArray, tick_s: float) -> FloatArray:
        """The commands, (ticks,), that give this motor torque at the instants at which they arrive."""
        stays = np.exp(-self.network.amplifier_bandwidth_rad_s * tick_s)
        wanted = delayed(motor_nm, tick_s, -self.command_delay_s)
        following = np.append(wanted[1:], wanted[-1])
        return np.asarray((following - stays * wanted) / (1.0 - stays) / self.network.torque_gain)
