"""Every driver that is shipped keeps the contract of :mod:`norton_bench.testing`, against its emulated device.

A new one is a class of a few lines: the rig file that has such a device, and in which role.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from norton_bench.rig.load import load_rig
from norton_bench.testing import AmplifierContract, SetUp, TorqueSensorContract
from norton_drivers.registry import load_backend
from norton_sim.backend import SimulatedBackend
from norton_sim.integrator import ANGLE, CURRENT_TARGET, VELOCITY
from norton_sim.plant import Machine

RIGS = Path(__file__).parents[2] / "rigs"


@dataclass(frozen=True)
class SimulatedDevice:
    """The far end, whatever its firmware: what it does is seen at the plant."""

    backend: SimulatedBackend
    role: Machine

    def vanish(self) -> None:
        self.backend.world.wires[self.role].cut()

    @property
    def armed(self) -> bool:
        return bool(self.backend.world.devices[self.role].armed)

    @property
    def command(self) -> float:
        machine = self.backend.world.plant._machines[self.role]
        return machine.state[CURRENT_TARGET] / machine.amplifier_gain

    def turn(self, position_rad: float, velocity_rad_s: float) -> None:
        plant = self.backend.world.plant
        mounted = 1 if self.role == "actuator" else plant._truth.load.mounted
        # Both machines: the sensor between them is a spring.
        plant._state[:, ANGLE] = mounted * position_rad
        plant._state[:, VELOCITY] = mounted * velocity_rad_s

    def twist(self, torque_nm: float) -> None:
        self.backend.world.devices[self.role].signal.force(torque_nm)


def simulated(rig_file: str, role: str, direction: int) -> SetUp:
    """The device of that role in the rig file, emulated."""
    rig = load_rig(RIGS / rig_file, backend="simulated")
    settings = replace(getattr(rig.wiring, role), direction=direction)
    wiring = replace(rig.wiring, **{role: settings})
    backend = load_backend("simulated")(wiring, rig.simulated, seed=1, place=rig.place)
    return SetUp(backend, settings, SimulatedDevice(backend, role), wiring.buses)


class TestODrive(AmplifierContract):
    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-odrive.toml", "actuator", direction)


class TestODriveAsLoad(AmplifierContract):
    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-odrive.toml", "load", direction)


class TestODriveUart(AmplifierContract):
    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-odrive-uart.toml", "actuator", direction)


class TestODriveUart05(AmplifierContract):
    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-odrive-uart.toml", "load", direction)


class TestVesc(AmplifierContract):
    lets_go_at_zero = True

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-vesc.toml", "actuator", direction)


class TestVescUart(AmplifierContract):
    lets_go_at_zero = True

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-vesc-uart.toml", "actuator", direction)


class TestSimpleFoc(AmplifierContract):
    command_resolution = 1e-5  # the last of the decimals on its line

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-simplefoc.toml", "actuator", direction)


class TestMit(AmplifierContract):
    command_resolution = 0.5e-3  # half a step: exactly zero cannot be sent

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-mit.toml", "actuator", direction)


class TestDamiao(AmplifierContract):
    command_resolution = 0.5e-3  # half a step: exactly zero cannot be sent

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-damiao.toml", "actuator", direction)


class TestRobStride(AmplifierContract):
    command_resolution = 0.1e-3  # half a step of 16 bits

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-robstride.toml", "actuator", direction)


class TestCubeMars(AmplifierContract):
    lets_go_at_zero = True

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-cubemars.toml", "actuator", direction)


class TestMoteus(AmplifierContract):
    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-moteus.toml", "actuator", direction)


class TestDynamixel(AmplifierContract):
    command_resolution = 1.4e-3  # half a unit of its current

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-dynamixel.toml", "actuator", direction)


class TestFeetech(AmplifierContract):
    command_resolution = 1e-3  # a unit of its PWM

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-feetech.toml", "actuator", direction)


class TestFeetechAsLoad(AmplifierContract):
    command_resolution = 2e-3

    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-feetech.toml", "load", direction)


class TestBota(TorqueSensorContract):
    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-odrive.toml", "torque_sensor", direction)


class TestDbc(TorqueSensorContract):
    def set_up(self, direction: int) -> SetUp:
        return simulated("sim-dbc.toml", "torque_sensor", direction)
