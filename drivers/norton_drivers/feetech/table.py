"""The memory table of Feetech's STS and SCS servos, its scales, and what differs between series.

Sources: Feetech, "Magnetic Encoding STS Servo, Memory Table" and "SCSCL Memory Table", as tables by
huggingface/lerobot, src/lerobot/motors/feetech/tables.py (addresses, model numbers, signs), and wiki.juxitech.com,
"STS Servo - Memory Table Parsing" (the bits of Phase and Status). A unit of current is 6.5 mA, of load and PWM a
thousandth of the supply. The position loop's scale is in no manual: Rhoban/bam, bam/feetech/actuator.py, measured with
an oscilloscope that an error of one radian gives a duty cycle of 0.166 for each unit of P.
"""

from math import radians, tau
from typing import Final, NamedTuple

from norton_drivers.codecs.feetech import Order

IDENTITY, IDENTITY_LENGTH = 0, 5  # firmware (2 bytes), byte order, model number (2 bytes)
ID, RETURN_DELAY, MIN_ANGLE, PHASE = 5, 7, 9, 18
P_GAIN, D_GAIN, I_GAIN, MIN_START_FORCE, DEAD_ZONE = 21, 22, 23, 24, 26
PROTECTION_CURRENT, MODE = 28, 33
TORQUE_ENABLE, ACCELERATION, GOAL_POSITION, GOAL_PWM, GOAL_SPEED, TORQUE_LIMIT = 40, 41, 42, 44, 46, 48
LOCK_STS, LOCK_SCS = 55, 48
PRESENT_POSITION, PRESENT_SPEED, PRESENT_LOAD, PRESENT_VOLTAGE, PRESENT_TEMPERATURE = 56, 58, 60, 62, 63
STATUS, PRESENT_CURRENT = 65, 69

MODE_POSITION, MODE_PWM = 0, 2
SLOW_UNIT_BIT, WHOLE_ANGLE_BIT = 0x04, 0x10  # of Phase: speeds in steps of one; positions of several turns
FULL_PWM: Final = 1000
PWM_SIGN, POSITION_SIGN, CURRENT_SIGN = 10, 15, 15
VOLTAGE_STEP_V: Final = 0.1
CURRENT_STEP_A: Final = 6.5e-3
RETURN_DELAY_STEP_S: Final = 2e-6
COARSE_SPEED_COUNTS_S: Final = 50  # a unit of speed where SLOW_UNIT_BIT is clear
# The position loop's own ramp cannot be switched off: goals move no faster than this register's value, in counts a
# second, whose greatest is that of Maximum Speed (84), 3400 as delivered.
FASTEST_COUNTS_S: Final = 3400
DUTY_PER_RAD: Final = 0.166  # for each unit of P


class Model(NamedTuple):
    """``together``: whether it knows Sync Read; ``currents``: whether it measures its current; ``read`` are the
    registers of a cycle, from torque switch to the last reading. It tells the places from 0 to ``counts``, less one."""

    name: str
    number: int
    order: Order = "little"
    counts_per_turn: float = 4096.0
    together: bool = True
    currents: bool = True
    counts: int = 4096

    @property
    def turns(self) -> bool:
        """Whether it tells every angle of a turn, and so may go on for many turns."""
        return self.counts >= self.counts_per_turn

    @property
    def step_rad(self) -> float:
        return tau / self.counts_per_turn

    @property
    def read(self) -> tuple[int, int]:
        last = PRESENT_CURRENT + 2 if self.currents else STATUS + 1
        return TORQUE_ENABLE, last - TORQUE_ENABLE


MODELS: Final = {
    model.name: model
    for model in (
        Model("STS3215", 777),
        Model("STS3250", 2825),
        Model("SM8512BL", 11272),
        # A potentiometer: its 1024 counts span 300 degrees.
        Model("SCS0009", 1284, "big", tau / radians(300.0) * 1024, together=False, currents=False, counts=1024),
    )
}


def model_in_words(number: int) -> str:
    """The name of the model with this number."""
    return next((model.name for model in MODELS.values() if model.number == number), f"model number {number}")
