"""CANopen servo drives, profile CiA 402: torque commands out, position, velocity, current and state in.

What the drive exchanges cyclically is set up by the driver when the bench is opened, and lost when the drive restarts.
Positive torque is the torque that the actuator exerts on its load in the drive's positive sense, times ``direction``.
Torque, position and velocity come in units that each drive, and each of its set-ups, has of its own: they stand in the
rig file. Source: CiA 402-2 and CiA 402-3 (IEC 61800-7-201), CiA 301.
"""

from collections.abc import Callable
from contextlib import suppress
from math import tau
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from norton_drivers.canopen import cia402_setup as setup
from norton_drivers.canopen.master import Master, master_of
from norton_drivers.canopen.node import DEVICE_TYPE, Node, answers, load_dictionary, probes, recognise  # noqa: F401  (found here by whoever looks for them)
from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs import cia402
from norton_drivers.codecs.canopen import NmtCommand, describe_nmt_state
from norton_drivers.codecs.cia402 import Controlword, Mode, Object, State
from norton_drivers.codecs.common import CodecError
from norton_drivers.drive_base import DriveBase, FedWatchdog
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, wait_until
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading, Unwrapped
from norton_drivers.wiring import DeviceOptions, DeviceSettings, parse_options

CONNECTION = "can"
OPTION_UNITS = {
    "torque_per_unit": "N*m",
    "velocity_per_unit": "rad/s",
    "current_per_unit": "A",
    "torque_slope": "N*m/s",
    "watchdog": "s",
    "heartbeat": "s",
    "period": "s",
}
OPTION_FILES = ("eds",)  # may stand beside the rig file

_MODES = {"cyclic synchronous torque": Mode.CYCLIC_SYNCHRONOUS_TORQUE, "profile torque": Mode.PROFILE_TORQUE}
# Errors after which a drive wants its communication reset before it takes a fault reset (maxon EPOS4 Firmware
# Specification, chapter 7); they say that the bus was lost, as it is whenever a host goes away.
_BUS_LOST = (0x8120, 0x8130)
_COUNT_SPAN = 1 << 32
_DRIVING = State.OPERATION_ENABLED, State.QUICK_STOP, State.FAULT_REACTION


class Cia402Options(DeviceOptions):
    """What a rig file may say of a CiA 402 drive."""

    command_units: ClassVar = {"N*m": {}}

    node: int = Field(ge=1, le=protocol.NODE_MAX, description="the drive's CANopen node id, 1 to 127", examples=[5])
    torque_per_unit_nm: float = Field(
        alias="torque_per_unit",
        gt=0,
        description="torque of one unit of 6071h, often a thousandth of the motor's rated torque (6076h)",
        examples=["1.27 mN*m"],
    )
    counts_per_turn: int = Field(gt=0, description="units of 6064h in one turn of the shaft", examples=[16384])
    velocity_per_unit_rad_s: float = Field(
        alias="velocity_per_unit", gt=0, description="velocity of one unit of 606Ch", examples=["1 rpm"]
    )
    current_per_unit_a: float | None = Field(
        None,
        alias="current_per_unit",
        gt=0,
        description="current of one unit of 6078h, often a thousandth of the rated current (6075h); without it the "
        "drive's current is not read",
        examples=["5 mA"],
    )
    mode: Literal["cyclic synchronous torque", "profile torque"] = Field(
        "cyclic synchronous torque", description="mode of operation (6060h)"
    )
    torque_slope_nm_s: float | None = Field(
        None,
        alias="torque_slope",
        gt=0,
        validate_default=True,
        description="how fast a profile torque may rise (6087h): a slow ramp looks like a lag",
        examples=["1000 N*m/s"],
    )
    watchdog_s: FedWatchdog = Field(
        0.1,
        alias="watchdog",
        ge=0,
        le=10,
        description='silence of the host that makes the drive stop (1016h); "0 s" leaves that as it is',
        examples=["100 ms"],
    )
    heartbeat_s: float = Field(
        0.1, alias="heartbeat", ge=1e-3, le=10, description="the drive's heartbeat period (1017h)", examples=["100 ms"]
    )
    feedback: Literal["sync", "timer"] = Field(
        "timer", description="what makes the drive send: its own event timer, or our SYNC"
    )
    commands: Literal["at once", "at sync"] = Field("at once", description="when the drive obeys a command")
    period_s: float = Field(
        1e-3,
        alias="period",
        ge=1e-3,
        le=0.1,
        description="of SYNC, of the event timer, and of 60C2h",
        examples=["1 ms"],
    )
    status_every: int = Field(1, ge=1, le=240, description="SYNCs to one statusword; more relieve a busy bus")
    master_node: int = Field(
        protocol.NODE_MAX, ge=1, le=protocol.NODE_MAX, description="our own node id, whose heartbeat the drive watches"
    )
    eds: str = Field("cia402", description="the drive's EDS file, or the name of a shipped one")

    @field_validator("torque_slope_nm_s")
    @classmethod
    def _is_there_for_profile_torque(cls, slope: float | None, info: ValidationInfo) -> float | None:
        if slope is None and info.data.get("mode") == "profile torque":
            raise ValueError('mode = "profile torque" needs it')
        return slope

    @field_validator("period_s")
    @classmethod
    def _in_milliseconds(cls, period_s: float) -> float:
        if abs(period_s * 1e3 - round(period_s * 1e3)) > 1e-6:
            raise ValueError("a drive's timers count whole milliseconds")
        return period_s


def check_settings(settings: DeviceSettings) -> None:
    """Raises WiringError for an EDS file that cannot be read."""
    options = parse_options(Cia402Options, settings)
    load_dictionary(options.eds, options.node, settings.role)


def open_amplifier(settings: DeviceSettings, link: Link) -> "Cia402Drive":
    """Opens the drive and sets up what it exchanges; nothing moves.

    Raises WiringError for a wrong option, ConnectionFailedError for the bus, DeviceError for the drive.
    """
    options = parse_options(Cia402Options, settings)
    dictionary = load_dictionary(options.eds, options.node, settings.role)
    master = master_of(settings, link, options.master_node)
    drive = Cia402Drive(settings, options, Node(settings.role, options.node, dictionary, master, link), master, link)
    drive.set_up()
    return drive


class Cia402Drive(DriveBase):
    """``actual_torque_nm`` is the drive's own word on its torque (6077h), by the scale of its commands."""

    command_unit = "N*m"

    def __init__(
        self, settings: DeviceSettings, options: Cia402Options, node: Node, master: Master, link: Link
    ) -> None:
        super().__init__(settings)
        self.options = options
        self.node = node
        self.mode = _MODES[options.mode]
        self.statusword = self.statuses = self.mode_shown = 0
        self.actual_torque_nm = 0.0
        self._master = master
        self._link = link
        self._torque_per_unit_nm = settings.direction * options.torque_per_unit_nm
        self._rad_per_count = settings.direction * tau / options.counts_per_turn
        self._velocity_per_unit_rad_s = settings.direction * options.velocity_per_unit_rad_s
        self._current_per_unit_a = settings.direction * (options.current_per_unit_a or 0.0)
        self._with_current = options.current_per_unit_a is not None
        self._command_id = protocol.receive_pdo_id(options.node)
        self._controlword: int = Controlword.DISABLE_VOLTAGE
        self._carried = 0.0  # of the torque, in units: what the last command could not say
        self._enabled_wanted = False
        self._fell_to: State | None = None  # where it went by itself from "Operation enabled"
        # Whether there has been a statusword, and whether it is to exchange process data.
        self._heard = self._set_up = False
        # Whether the drive watches our heartbeat, and whether it shall stop doing so once it is idle.
        self._watching = self._watch_ends = False
        self._counts = Unwrapped(_COUNT_SPAN)
        if options.watchdog_s > 0:
            master.want_heartbeat(options.watchdog_s)
        if options.feedback == "sync" or options.commands == "at sync":
            master.want_sync(options.period_s, settings.role)
        node.listen(protocol.transmit_pdo_id(options.node, 1), self._on_status)
        node.listen(protocol.transmit_pdo_id(options.node, 2), self._on_motion)
        node.on_change = self._on_node_change

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask who it is, whether it has the mode of operation, and see that its readings arrive."""
        if self.node.restarted:
            self.set_up()
        identity = self.node.identity("cia402")
        setup.check_mode(self.node, self.options.mode, self.mode)
        motions, statuses = self._motion.count, self.statuses
        self._await(lambda: self.statuses > statuses, timeout_s, "sends no statusword (TPDO1)")
        self._await(lambda: self._motion.count > motions, timeout_s, "sends no position and velocity (TPDO2)")
        return identity

    def enable(self, timeout_s: float = 2.0) -> None:
        """Let it watch our heartbeat, reset its faults, and enable its operation at zero torque."""
        self._enabled_wanted = self._watch_ends = False
        if self.node.restarted or any(code in _BUS_LOST for code in self.node.emergencies):
            self.set_up()
        if not self.node.operational:
            self.node.start()
        if self.options.watchdog_s > 0:
            setup.watch_host(self.node, self._master.node, self.options.watchdog_s)
            self._master.beat_at_once()
            self._watching = True
        try:
            setup.enable_operation(self, timeout_s)
        except BaseException:
            self.stop()  # or the next command would go on from where it stands
            raise
        self._enabled_wanted, self._fell_to = True, None
        self._status = None

    def command(self, value: float) -> float:
        """Command a torque [N m]; returns that of the whole units sent. Our heartbeat goes with it where it is due.

        What rounding leaves is carried to the next command, so that torque is right on average: rounded each for
        itself, equal commands would all be wrong by the same. Raises ConnectionFailedError, DeviceError.
        """
        try:
            wanted = value / self._torque_per_unit_nm + self._carried if value else 0.0
            units = round(wanted)
            payload = cia402.command_value(self._controlword, self.mode, units)
        except (CodecError, ValueError, OverflowError) as error:
            raise DeviceError(
                f"{self.node.place}: cannot command a torque of {value} N*m; with torque_per_unit = "
                f"{self.options.torque_per_unit_nm:g} N*m it takes up to "
                f"{cia402.TARGET_MAX * self.options.torque_per_unit_nm:g} N*m"
            ) from error
        self._carried = wanted - units
        self._master.port.send(self._command_id, payload)
        self._master.beat()
        return units * self._torque_per_unit_nm

    @property
    def heartbeat_timeout_ns(self) -> int:
        return self.node.heartbeat_timeout_ns

    @property
    def position_resolution_rad(self) -> float:
        return tau / self.options.counts_per_turn

    @property
    def watchdog_s(self) -> float:
        return self.options.watchdog_s

    def provoke_watchdog(self) -> None:
        self.command(0.0)

    def made_itself_safe(self) -> bool | None:
        if not self.node.operational:
            self._ask_statusword()  # it left the exchange of process data
        return self._heard and self._where not in _DRIVING

    def stop(self) -> None:
        """Switch the voltage off by both ways there are, and hear the drive again should it have left operation."""
        self._enabled_wanted = False
        self._watch_ends, self._watching = self._watching, False
        self._controlword = Controlword.DISABLE_VOLTAGE
        self._status = None
        with suppress(Exception):
            self.command(0.0)
        with suppress(Exception):
            self.node.put(Object.CONTROLWORD, 0, bytes(2))
        with suppress(Exception):
            self._start_again()

    # ---- What enabling needs too --------------------------------------------------------------------------------

    @property
    def place(self) -> str:
        return self.node.place

    def hold(self, controlword: int, until: Callable[[], bool], timeout_s: float) -> bool:
        """Send a controlword, with no torque, until then; False where that did not come to pass."""
        self._controlword = controlword
        return wait_until(until, self._link, timeout_s, meanwhile=lambda: self.command(0.0))

    def troubles(self) -> tuple[str, ...]:
        """The drive's errors in words."""
        troubles = self.node.troubles()
        if troubles or not self._enabled_wanted:
            return troubles
        if not self.node.operational and self.node.state is not None:
            return (f"left the exchange of process data (now {describe_nmt_state(self.node.state)})",)
        if self._fell_to is not None:
            return (f'left "Operation enabled" without an error (for "{self._fell_to.value}")',)
        return ()

    # ---- Setting up ----------------------------------------------------------------------------------------------

    def set_up(self) -> None:
        """See that it is a drive, set up what it exchanges, and start that. Raises DeviceError."""
        self._enabled_wanted = self._set_up = False
        self._controlword = Controlword.DISABLE_VOLTAGE
        setup.check_profile(self.node)
        error = setup.error_code(self.node)
        if error in _BUS_LOST:
            self.node.reset_communication()
        self.node.begin(self.options.heartbeat_s)
        if self.options.watchdog_s > 0:
            setup.ignore_host(self.node)
        if error in _BUS_LOST:
            setup.reset_fault(self.node)
        elif error:
            self.node.emergencies.append(error)
        setup.set_up_process_data(self.node, self.options)
        setup.set_up_mode(self.node, self.options, self.mode)
        self._counts = Unwrapped(_COUNT_SPAN)
        self.node.start()
        self._set_up = True
        self._take_statusword(self.node.parameters.number(Object.STATUSWORD))

    def _await(self, arrived: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        if not wait_until(arrived, self._link, timeout_s):
            raise DeviceTimeoutError(
                f"{self.place}: {otherwise} as it was set up, though it is operational ({self.node.malformed} "
                f"malformed frames, {timeout_s:g} s waited)"
            )

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _where(self) -> State:
        return cia402.state_of(self.statusword)

    def _new_status(self) -> DriveStatus:
        return DriveStatus(self._state(), self.node.heartbeat_ns, self.troubles())

    def _state(self) -> DriveState:
        if self.node.heartbeat_ns is None or not self._heard:
            return DriveState.UNKNOWN
        where = self._where
        if self.node.restarted or where in (State.FAULT, State.FAULT_REACTION):
            return DriveState.FAULT
        if self._enabled_wanted and not (self._fell_to is None and self.node.operational):
            return DriveState.FAULT
        return DriveState.ENABLED if where in _DRIVING else DriveState.IDLE

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _on_status(self, data: bytearray, arrival_ns: int) -> None:
        statusword, mode, torque, current = cia402.status_of(data, with_current=self._with_current)
        if self.node.restarted:
            return  # it sends what it was set up for at power-on
        self.statuses += 1
        self.mode_shown = mode
        self.actual_torque_nm = self._torque_per_unit_nm * torque
        if self._with_current:
            self._current.put(CurrentReading(self._current.count, arrival_ns, self._current_per_unit_a * current))
        if statusword != self.statusword or not self._heard or self._watch_ends:
            self._take_statusword(statusword)

    def _on_motion(self, data: bytearray, arrival_ns: int) -> None:
        position, velocity = cia402.motion_of(data)
        if self.node.restarted:
            return
        position_rad = self._rad_per_count * self._counts.follow(position)
        velocity_rad_s, motion = self._velocity_per_unit_rad_s * velocity, self._motion
        motion.put(MotionReading(motion.count, arrival_ns, position_rad, velocity_rad_s))

    def _take_statusword(self, statusword: int) -> None:
        self.statusword = statusword
        self._heard = True
        self._status = None
        if self._enabled_wanted and self._where is not State.OPERATION_ENABLED:
            # What it left by itself, commands must not bring it back to.
            self._fell_to = self._fell_to or self._where
            braking = self._where is State.QUICK_STOP
            self._controlword = Controlword.QUICK_STOP if braking else Controlword.DISABLE_VOLTAGE
        if self._watch_ends and self._where not in _DRIVING:
            # Only now: until it has obeyed, its watch is what would stop it.
            self._watch_ends = False
            with suppress(DeviceError):  # a lost bus shows elsewhere
                setup.ignore_host_without_waiting(self.node)

    def _on_node_change(self) -> None:
        self._status = None
        if self.node.restarted:
            self._controlword = Controlword.DISABLE_VOLTAGE
        if not self.node.operational and self._heard and self._where in _DRIVING:
            with suppress(DeviceError):
                self._ask_statusword()
        if not self._enabled_wanted:  # it may say only now, with a heartbeat, that it left operation before the stop
            with suppress(DeviceError):
                self._start_again()

    def _start_again(self) -> None:
        """Hear a drive again that was set up and has left operation. Raises ConnectionFailedError."""
        if self._set_up and not (self.node.operational or self.node.restarted):
            self.node.order(NmtCommand.START)

    def _ask_statusword(self) -> None:
        self.node.ask(Object.STATUSWORD, 0, lambda value: self._take_statusword(int.from_bytes(value[:2], "little")))
