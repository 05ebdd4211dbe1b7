"""What all plants beside the torque motor have in common."""

from abc import ABC, abstractmethod
from typing import ClassVar

from pydantic import Field

from norton_sim.machines import Body, Commanded, Drive
from norton_sim.plants.link import Link
from norton_sim.quantities import Angle, Damping, Stiffness, Table, TorqueConstant


class Assembled(Drive, Commanded, ABC):
    """An amplifier whose current stands for the command c (i = Ka c once it has settled), and a body at the port.

    The encoder is on the port's body. Everything begins at rest at θ = 0, with c = 0. ``modulated`` says whether a
    second drive sets its impedance.
    """

    modulated: ClassVar[bool] = False
    output: Body

    @property
    @abstractmethod
    def link(self) -> Link:
        """What lies between amplifier and port."""

    @property
    @abstractmethod
    def torque_constant_nm_a(self) -> float:
        """What one ampere pushes the port with, held where everything began [N m/A]."""

    @property
    def command_per_ampere(self) -> float:
        """In the actuator's own unit, and the bench's sense."""
        return self.mounted / self.amplifier_gain


class Motor(Body):
    """A motor behind a transmission, as reflected to the port's side of its gears."""

    torque_constant_nm_a: TorqueConstant = Field(alias="torque_constant", gt=0, examples=["0.05 N*m/A"])


class Servo(Table):
    """A position loop: the command is an angle, τ = stiffness · (c − q) − damping · dq/dt, as long as it has power."""

    stiffness_nm_rad: Stiffness = Field(alias="stiffness", gt=0, examples=["20 N*m/rad"])
    damping_nm_s_rad: Damping = Field(alias="damping", ge=0, examples=["0.1 N*m*s/rad"])


class Spring(Table):
    """A damped spring."""

    stiffness_nm_rad: Stiffness = Field(alias="stiffness", gt=0, examples=["5 N*m/rad"])
    damping_nm_s_rad: Damping = Field(alias="damping", default=0.0, ge=0)


class Backlash(Spring):
    """A spring that takes hold only beyond half of ``width`` to either side; it is damped only while it holds."""

    width_rad: Angle = Field(alias="width", ge=0, examples=["20 mrad"])
