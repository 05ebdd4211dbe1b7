"""What lies between an actuator's amplifier and its port, as the integrator works on it: one row of numbers.

A *source* is driven and joined to the port's body by a *connection*, as in the paper's Norton network. The columns are
named below; a plant leaves those that it has no use for at zero.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from norton_sim.machines import Body

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
