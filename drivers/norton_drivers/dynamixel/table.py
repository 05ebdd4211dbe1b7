"""The control table of Dynamixel X servos, its scales, and what differs between models.

Sources: ROBOTIS e-Manual, control tables of XL330-M288, XC330-T181, XM430-W210, XH430-V210 (addresses, units, the goal
values' ranges, "Hardware Error Status", "Bus Watchdog", "Position PID Gain", "Operating Mode"); the model numbers and
addresses are those of ROBOTIS-GIT/DynamixelSDK 4.1, python/src/dynamixel_easy_sdk/control_table. A hundredth of a
voltage is told by nobody: the PWM's unit is 1/885 of the supply.
"""

from enum import IntEnum
from math import tau
from typing import Final, NamedTuple

COUNTS_PER_TURN: Final = 4096
POSITION_STEP_RAD: Final = tau / COUNTS_PER_TURN
VELOCITY_STEP_RAD_S: Final = 0.229 * tau / 60
FULL_PWM: Final = 885
VOLTAGE_STEP_V: Final = 0.1
RETURN_DELAY_STEP_S: Final = 2e-6
WATCHDOG_STEP_S: Final = 0.02
WATCHDOG_MAX: Final = 127
WATCHDOG_EXPIRED: Final = 0xFF
POSITION_P_SCALE: Final = 128  # KPP = the register / 128
TORQUE_ON_BY_GOAL: Final = 0x08  # a bit of Drive Mode: a goal switches the torque on

MODEL_NUMBER, FIRMWARE_VERSION = 0, 6
ID, BAUD_RATE, RETURN_DELAY, DRIVE_MODE, OPERATING_MODE = 7, 8, 9, 10, 11
PWM_LIMIT, CURRENT_LIMIT = 36, 38
MAX_POSITION_LIMIT, MIN_POSITION_LIMIT = 48, 52
TORQUE_ENABLE, STATUS_RETURN_LEVEL, HARDWARE_ERROR = 64, 68, 70
POSITION_D_GAIN, POSITION_I_GAIN, POSITION_P_GAIN = 80, 82, 84
FEEDFORWARD_2ND, FEEDFORWARD_1ST = 88, 90
BUS_WATCHDOG = 98
GOAL_PWM, GOAL_CURRENT, GOAL_VELOCITY, GOAL_POSITION = 100, 102, 104, 116
PROFILE_ACCELERATION, PROFILE_VELOCITY = 108, 112
PRESENT_CURRENT, PRESENT_VELOCITY, PRESENT_POSITION = 126, 128, 132
PRESENT_VOLTAGE, PRESENT_TEMPERATURE = 144, 146
INDIRECT_ADDRESS = 168
EEPROM_END = 64  # what lies below can be written only with the torque off, and is kept


class OperatingMode(IntEnum):
    """Register 11."""

    CURRENT = 0
    VELOCITY = 1
    POSITION = 3
    EXTENDED_POSITION = 4
    CURRENT_BASED_POSITION = 5
    PWM = 16


class Model(NamedTuple):
    """One model: its number, what one unit of its current registers is, and where its Indirect Data 1 may be.

    For the 330 series the manual says 208, the maker's library 224 for older firmware; so it is tried.
    """

    name: str
    number: int
    current_unit_a: float
    indirect_data: tuple[int, ...] = (224,)


_OF_330 = (208, 224)
MODELS: Final = {
    model.name: model
    for model in (
        Model("XL330-M077", 1190, 1e-3, _OF_330),
        Model("XL330-M288", 1200, 1e-3, _OF_330),
        Model("XC330-T181", 1210, 1e-3, _OF_330),
        Model("XC330-T288", 1220, 1e-3, _OF_330),
        Model("XC330-M181", 1230, 1e-3, _OF_330),
        Model("XC330-M288", 1240, 1e-3, _OF_330),
        Model("XM430-W350", 1020, 2.69e-3),
        Model("XM430-W210", 1030, 2.69e-3),
        Model("XM540-W270", 1120, 2.69e-3),
        Model("XM540-W150", 1130, 2.69e-3),
        Model("XH430-W350", 1000, 2.69e-3),
        Model("XH430-W210", 1010, 2.69e-3),
    )
}
NAMES: Final = tuple(MODELS)

_HARDWARE_ERRORS: Final = {
    0: "input voltage out of its limits",
    2: "overheating",
    3: "motor encoder failed",
    4: "electrical shock, or too little power for the motor",
    5: "overload",
}


def model_in_words(number: int) -> str:
    """The name of the model with this number."""
    return next((model.name for model in MODELS.values() if model.number == number), f"model number {number}")


def describe_hardware_error(code: int) -> tuple[str, ...]:
    """The bits of register 70 in words."""
    return tuple(_HARDWARE_ERRORS.get(bit, f"hardware error {1 << bit}") for bit in range(8) if code >> bit & 1)


# The registers that are read in every cycle, through indirect addresses, in this order: address and size.
READ: Final = (
    (TORQUE_ENABLE, 1),
    (HARDWARE_ERROR, 1),
    (BUS_WATCHDOG, 1),
    (PRESENT_CURRENT, 2),
    (PRESENT_VELOCITY, 4),
    (PRESENT_POSITION, 4),
    (PRESENT_VOLTAGE, 2),
    (PRESENT_TEMPERATURE, 1),
)
READ_FORMAT: Final = "<BBBhiiHB"
READ_LENGTH: Final = sum(size for _, size in READ)


def indirect_map() -> bytes:
    """What the indirect addresses must hold for :data:`READ`."""
    return b"".join((first + k).to_bytes(2, "little") for first, size in READ for k in range(size))
