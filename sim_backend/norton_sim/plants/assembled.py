"""What all plants beside the torque motor have in common."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from norton_sim.tables import Angle, Body, Commanded, Damping, Drive, Stiffness, Table, TorqueConstant

# Columns.
DRIVE = 0  # what moves the source, one of those below
COMMAND_PER_AMPERE = 1  # command units/A, negative for an actuator mounted the other way round
SPRING = 2  # N m/rad, of the connection
DAMPER = 3  # N m s/rad
HALF_GAP = 4  # rad, what the source may turn before the connection takes hold
LOAD_FRICTION = 5  # N m of friction at the source for each N m that the connection carries
SERVO_STIFFNESS = 6  # N m/rad
SERVO_DAMPING = 7  # N m s/rad
MOVEMENT = 8  # s, how long a reach takes
MOVING_SPRING = 9  # N m/rad, what the spring has more in the middle of a reach
STIFFENING = 10  # N m/rad that the spring has more for each radian of the modulator's motor; 0: there is none
MODULATOR_STOP = 11  # rad, where that meets its upper stop
MODULATOR_TRAVEL = 12  # rad/A, where it is sent
MODULATOR_BANDWIDTH = 13  # rad/s, how fast it goes there
HARDENING = 14  # N m/rad³
LINK_COLUMNS = 15

# Values of DRIVE.
MUSCLE, TORQUE, SERVO, REACH = 0.0, 1.0, 2.0, 3.0


# What lies between an actuator's amplifier and its port, as the integrator works on it: one row of numbers.
#
# A *source* is driven and joined to the port's body by a *connection*, as in the paper's Norton network. The columns
# are named below; a plant leaves those that it has no use for at zero.
@dataclass(frozen=True)
class Link:
    """``row`` has shape (LINK_COLUMNS,). ``source`` is the body that is driven; None where there is none that moves."""

    row: NDArray[np.float64]
    source: Body | None = None
    source_torque_constant_nm_a: float = 0.0


def row_of(**columns: float) -> NDArray[np.float64]:
    """A row with the columns given by their names in small letters."""
    row = np.zeros(LINK_COLUMNS)
    for name, value in columns.items():
        row[globals()[name.upper()]] = value
    return row


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


class GearedMotor(Body):
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
