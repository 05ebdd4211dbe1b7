"""The way of a CiA 402 drive to "Operation enabled", step by step, each with a sentence where it fails.

Source: CiA 402-2, "State control of the device": Fault → Switch on disabled → Ready to switch on → Switched on →
Operation enabled. A fault is reset by a rising edge of bit 7, so that bit must have been seen low before.
"""

from collections.abc import Callable
from typing import Protocol

from norton_drivers.codecs.cia402 import REMOTE, VOLTAGE_ENABLED, Controlword, State, state_of
from norton_drivers.errors import DeviceError, DeviceTimeoutError

# In how many statuswords the low bit must have been seen to be sure that the drive has it.
_LOW_BIT_SEEN = 5
_STEPS = (
    (Controlword.SHUTDOWN, State.READY, "shutdown"),
    (Controlword.SWITCH_ON, State.SWITCHED_ON, "switch on"),
    (Controlword.ENABLE_OPERATION, State.OPERATION_ENABLED, "enable operation"),
)
_FAULTS = (State.FAULT, State.FAULT_REACTION)
_SILENT = ": it says no reason; see its error history (1003h)"


class Climber(Protocol):
    """The part of the driver that is needed here."""

    statusword: int
    statuses: int  # how many statuswords have come
    mode_shown: int

    @property
    def place(self) -> str: ...
    @property
    def mode(self) -> int: ...
    def hold(self, controlword: int, until: Callable[[], bool], timeout_s: float) -> bool:
        """Send a controlword, with no torque, until then; False where that did not come to pass."""
        ...

    def troubles(self) -> tuple[str, ...]:
        """The drive's errors in words."""
        ...


def climb(drive: Climber, timeout_s: float) -> None:
    """Whatever state the drive is in, to "Operation enabled"; ``timeout_s`` is for each step.

    Raises DeviceTimeoutError where a step does not end, DeviceError where the drive has a fault.
    """
    _come_down(drive, timeout_s)
    for controlword, goal, name in _STEPS:
        if goal is State.OPERATION_ENABLED:
            _await_mode(drive, timeout_s)
        _step(drive, controlword, goal, name, timeout_s)


def _come_down(drive: Climber, timeout_s: float) -> None:
    before = drive.statuses
    if not drive.hold(Controlword.DISABLE_VOLTAGE, lambda: drive.statuses >= before + _LOW_BIT_SEEN, timeout_s):
        raise DeviceTimeoutError(
            f"{drive.place}: sends no statusword, though it is operational ({timeout_s:g} s waited)"
        )
    reset = _state(drive) in _FAULTS
    if reset and not drive.hold(Controlword.FAULT_RESET, lambda: _state(drive) not in _FAULTS, timeout_s):
        raise _stuck(drive, "reset its fault", State.SWITCH_ON_DISABLED)
    if not drive.hold(Controlword.DISABLE_VOLTAGE, lambda: _state(drive) is State.SWITCH_ON_DISABLED, timeout_s):
        raise _stuck(drive, "disable voltage", State.SWITCH_ON_DISABLED)


def _await_mode(drive: Climber, timeout_s: float) -> None:
    """In "Switched on": some drives take a mode only there."""
    if not drive.hold(Controlword.SWITCH_ON, lambda: drive.mode_shown == drive.mode, timeout_s):
        raise DeviceTimeoutError(
            f"{drive.place}: does not take mode of operation {drive.mode} (6060h), and stays in {drive.mode_shown}; "
            "does it have this mode (6502h)?"
        )


def _step(drive: Climber, controlword: int, goal: State, name: str, timeout_s: float) -> None:
    if not drive.hold(controlword, lambda: _state(drive) in (goal, *_FAULTS), timeout_s) or _state(drive) in _FAULTS:
        raise _stuck(drive, name, goal)


def _stuck(drive: Climber, name: str, goal: State) -> DeviceError:
    state, words = _state(drive), drive.troubles()
    said = f": {'; '.join(words)}" if words else ""
    if state in _FAULTS:
        return DeviceError(
            f'{drive.place}: is in "{state.value}" when told to {name}, instead of "{goal.value}"{said or _SILENT}'
        )
    return DeviceTimeoutError(
        f'{drive.place}: stays in "{state.value}" when told to {name}, instead of "{goal.value}"{said}{_hint(drive)}'
    )


def _hint(drive: Climber) -> str:
    if not drive.statusword & REMOTE:
        return "; it takes no commands from the bus (statusword bit 9): set its source of commands to CANopen"
    if not drive.statusword & VOLTAGE_ENABLED:
        return "; its power stage has no voltage (statusword bit 4): is the supply on?"
    return "; check its enable input and safe torque off"


def _state(drive: Climber) -> State:
    return state_of(drive.statusword)
