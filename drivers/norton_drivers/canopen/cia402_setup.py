"""A CiA 402 drive set up, brought to "Operation enabled" step by step, and made to watch the host.

Source: CiA 402-2, "State control of the device": Fault → Switch on disabled → Ready to switch on → Switched on →
Operation enabled. A fault is reset by a rising edge of bit 7, so that bit must have been seen low before.

The drive watches the heartbeat of the host (1016h), and does what 6007h says where it is missed. That is off by default
in every drive, and in force only once our first heartbeat has come. What 6007h leaves to the drive is not believed but
tried before an experiment. Sources: CiA 301, objects 1016h and 1029h; CiA 402-2, object 6007h.
"""

from collections.abc import Callable
from typing import Protocol

from norton_drivers.canopen.node import CONSUMER_HEARTBEAT, DEVICE_TYPE, Node
from norton_drivers.canopen.parameters import Pdo, set_up_received, set_up_sent, switch_off_sent
from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs import cia402
from norton_drivers.codecs.canopen import consumer_heartbeat
from norton_drivers.codecs.cia402 import REMOTE, VOLTAGE_ENABLED, Controlword, Mode, Object, State, state_of
from norton_drivers.errors import DeviceError, DeviceTimeoutError

_FIRST = 1
_NO_ACTION, _FAULT = 0, 1


def watch_host(node: Node, master: int, timeout_s: float) -> None:
    """From our next heartbeat on, silence of ``timeout_s`` is a fault. Raises DeviceError where that is not taken."""
    parameters = node.parameters
    if parameters.find_number(Object.ABORT_CONNECTION_OPTION) == _NO_ACTION:
        parameters.write(Object.ABORT_CONNECTION_OPTION, 0, _FAULT)
    wanted = consumer_heartbeat(master, round(timeout_s * 1e3))
    if not parameters.write_if_there(CONSUMER_HEARTBEAT, _FIRST, wanted):
        raise DeviceError(
            f'{node.place}: cannot watch the host\'s heartbeat (no parameter 1016h); give it watchdog = "0 s" only if '
            "it has another watchdog, and set that one in the drive"
        )
    taken = parameters.number(CONSUMER_HEARTBEAT, _FIRST)
    if taken != wanted:
        raise DeviceError(
            f"{node.place}: its watchdog does not take {timeout_s:g} s (1016h says 0x{taken:08X} after 0x{wanted:08X} "
            "was written); check in its manual which times it allows"
        )


def ignore_host(node: Node) -> None:
    """Watch no more. Raises DeviceError."""
    node.parameters.write_if_there(CONSUMER_HEARTBEAT, _FIRST, 0)


def ignore_host_without_waiting(node: Node) -> None:
    """Watch no more. Raises ConnectionFailedError."""
    node.put(CONSUMER_HEARTBEAT, _FIRST, bytes(4))


# In how many statuswords the low bit must have been seen to be sure that the drive has it.
_LOW_BIT_SEEN = 5
_STEPS = (
    (Controlword.SHUTDOWN, State.READY, "shutdown"),
    (Controlword.SWITCH_ON, State.SWITCHED_ON, "switch on"),
    (Controlword.ENABLE_OPERATION, State.OPERATION_ENABLED, "enable operation"),
)
_FAULTS = (State.FAULT, State.FAULT_REACTION)
_UNUSED_PDOS = (3, 4)
_SILENT = ": it says no reason; see its error history (1003h)"


class EnabledDrive(Protocol):
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


def enable_operation(drive: EnabledDrive, timeout_s: float) -> None:
    """Whatever state the drive is in, to "Operation enabled"; ``timeout_s`` is for each step.

    Raises DeviceTimeoutError where a step does not end, DeviceError where the drive has a fault.
    """
    _disable(drive, timeout_s)
    for controlword, goal, name in _STEPS:
        if goal is State.OPERATION_ENABLED:
            _await_mode(drive, timeout_s)
        _step(drive, controlword, goal, name, timeout_s)


def _disable(drive: EnabledDrive, timeout_s: float) -> None:
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


def _await_mode(drive: EnabledDrive, timeout_s: float) -> None:
    """In "Switched on": some drives take a mode only there."""
    if not drive.hold(Controlword.SWITCH_ON, lambda: drive.mode_shown == drive.mode, timeout_s):
        raise DeviceTimeoutError(
            f"{drive.place}: does not take mode of operation {drive.mode} (6060h), and stays in {drive.mode_shown}; "
            "does it have this mode (6502h)?"
        )


def _step(drive: EnabledDrive, controlword: int, goal: State, name: str, timeout_s: float) -> None:
    if not drive.hold(controlword, lambda: _state(drive) in (goal, *_FAULTS), timeout_s) or _state(drive) in _FAULTS:
        raise _stuck(drive, name, goal)


def _stuck(drive: EnabledDrive, name: str, goal: State) -> DeviceError:
    state, words = _state(drive), drive.troubles()
    message = f": {'; '.join(words)}" if words else ""
    if state in _FAULTS:
        return DeviceError(
            f'{drive.place}: is in "{state.value}" when told to {name}, instead of "{goal.value}"{message or _SILENT}'
        )
    return DeviceTimeoutError(
        f'{drive.place}: stays in "{state.value}" when told to {name}, instead of "{goal.value}"{message}{_hint(drive)}'
    )


def _hint(drive: EnabledDrive) -> str:
    if not drive.statusword & REMOTE:
        return "; it takes no commands from the bus (statusword bit 9): set its source of commands to CANopen"
    if not drive.statusword & VOLTAGE_ENABLED:
        return "; its power stage has no voltage (statusword bit 4): is the supply on?"
    return "; check its enable input and safe torque off"


def _state(drive: EnabledDrive) -> State:
    return state_of(drive.statusword)


class SetupOptions(Protocol):
    """The part of the options that is needed here."""

    @property
    def node(self) -> int: ...
    @property
    def torque_per_unit_nm(self) -> float: ...
    @property
    def current_per_unit_a(self) -> float | None: ...
    @property
    def torque_slope_nm_s(self) -> float | None: ...
    @property
    def feedback(self) -> str: ...
    @property
    def commands(self) -> str: ...
    @property
    def period_s(self) -> float: ...
    @property
    def status_every(self) -> int: ...


def check_profile(node: Node) -> None:
    """Raises DeviceError for a node that is no drive."""
    profile = node.parameters.number(DEVICE_TYPE) & 0xFFFF
    if profile != cia402.PROFILE:
        raise DeviceError(
            f"{node.place}: says that it follows profile {profile}, not {cia402.PROFILE} (drives); is this the "
            "node id meant?"
        )


def check_mode(node: Node, name: str, mode: Mode) -> None:
    """Raises DeviceError for a drive without this mode of operation."""
    supported = node.parameters.find_number(Object.SUPPORTED_MODES)
    if supported is not None and not supported & mode.supported_bit:
        raise DeviceError(
            f'{node.place}: does not have mode = "{name}" (6502h says 0x{supported:X}); try the other torque mode'
        )


def error_code(node: Node) -> int:
    """Why the drive is in fault; 0 where it is not, or does not say."""
    if state_of(node.parameters.number(Object.STATUSWORD)) is not State.FAULT:
        return 0
    return node.parameters.find_number(Object.ERROR_CODE) or 0


def reset_fault(node: Node) -> None:
    """For a fault that only says that the last host went away."""
    for controlword in (Controlword.DISABLE_VOLTAGE, Controlword.FAULT_RESET, Controlword.DISABLE_VOLTAGE):
        node.parameters.write(Object.CONTROLWORD, 0, controlword)


def set_up_process_data(node: Node, options: SetupOptions) -> None:
    """What the drive receives and sends by itself, and when. Raises DeviceError."""
    parameters = node.parameters
    obeyed = 1 if options.commands == "at sync" else protocol.EVENT_DRIVEN
    set_up_received(parameters, Pdo(1, protocol.receive_pdo_id(options.node), cia402.COMMAND_PDO, obeyed))
    status = cia402.STATUS_PDO if options.current_per_unit_a is None else cia402.STATUS_AND_CURRENT_PDO
    for number, entries, every in ((1, status, options.status_every), (2, cia402.MOTION_PDO, 1)):
        identifier = protocol.transmit_pdo_id(options.node, number)
        if options.feedback == "sync":
            set_up_sent(parameters, Pdo(number, identifier, entries, every))
        else:
            timer_ms = every * round(options.period_s * 1e3)
            set_up_sent(parameters, Pdo(number, identifier, entries, protocol.EVENT_DRIVEN, timer_ms))
    for number in _UNUSED_PDOS:
        switch_off_sent(parameters, number)


def set_up_mode(node: Node, options: SetupOptions, mode: Mode) -> None:
    """What the mode of operation needs. Raises DeviceError."""
    parameters = node.parameters
    if mode is Mode.CYCLIC_SYNCHRONOUS_TORQUE:
        parameters.write_if_there(Object.INTERPOLATION_PERIOD, 2, -3)  # in powers of ten of a second
        parameters.write_if_there(Object.INTERPOLATION_PERIOD, 1, round(options.period_s * 1e3))
    elif options.torque_slope_nm_s is not None:
        parameters.write(Object.TORQUE_SLOPE, 0, round(options.torque_slope_nm_s / options.torque_per_unit_nm))
