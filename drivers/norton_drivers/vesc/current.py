"""Drives of VESC's kind: they obey every current, have no state "enabled", and let go of the motor where none comes."""

from collections.abc import Callable
from contextlib import suppress
from typing import ClassVar, Protocol

from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc import Packet
from norton_drivers.drive_base import DriveBase
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, wait_until
from norton_drivers.ports import CanPort
from norton_drivers.readings import DriveState
from norton_drivers.vesc.motor import TIMEOUT_LOOK_S, Encoded, SeenFaults
from norton_drivers.wiring import DeviceSettings


class CurrentOptions(Protocol):
    """What the options of such a drive have."""

    @property
    def node(self) -> int: ...
    @property
    def mode(self) -> str: ...
    @property
    def command_unit(self) -> str | None: ...
    @property
    def watchdog_s(self) -> float: ...
    @property
    def watchdog_probe_a(self) -> float: ...
    def encoded(self, value: float) -> Encoded: ...


class CurrentDrive(DriveBase):
    """One motor. Its state is what its frames show: the current that flows, and errors."""

    _kind: ClassVar[str]

    def __init__(self, settings: DeviceSettings, options: CurrentOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings)
        self.command_unit = options.command_unit or ""
        self._common = options
        self._port = port
        self._link = link
        self._frames = 0  # that tell the current
        self._frame_ns = 0
        self._enabled = False
        self._faults = SeenFaults()
        self._released_from = 0  # the count of frames that first tells what became of the last stop
        self._probe_flowed = False
        packet = Packet.SET_DUTY if options.mode == "duty" else Packet.SET_CURRENT
        self._command_id = protocol.arbitration_id(packet, options.node)
        self._current_id = protocol.arbitration_id(Packet.SET_CURRENT, options.node)

    # ---- What a family tells -------------------------------------------------------------------------------------

    @property
    def _heard(self) -> bool:
        return self._frames > 0

    @property
    def _flowing_a(self) -> float:
        """The current in the last frame, whatever its sign means."""
        raise NotImplementedError

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def command(self, value: float) -> float:
        """Command a current, a torque or a duty cycle, which also feeds the timeout; returns what is sent of it.

        Raises ConnectionFailedError, DeviceError.
        """
        try:
            payload, sent = self._common.encoded(self._direction * value)
        except CodecError as error:
            raise DeviceError(f"{self._place}: cannot command {value} {self.command_unit}") from error
        self._port.send(self._command_id, payload, extended=True)
        return self._direction * sent

    @property
    def watchdog_s(self) -> float:
        """The timeout as set, and the interval at which the firmware looks whether it is over."""
        return self._common.watchdog_s + TIMEOUT_LOOK_S if self._common.watchdog_s else 0.0

    def provoke_watchdog(self) -> None:
        """The probe's current, where the rig gives one: what the drive tells of its current shows how it ends."""
        self._probe_flowed = False
        self._send_current(self._direction * self._common.watchdog_probe_a)

    def made_itself_safe(self) -> bool | None:
        return not self._probe_flows if self._probe_flowed else None

    def stop(self) -> None:
        """A command of zero, then a current of zero, which lets go of the motor in every mode."""
        self._enabled, self._status = False, None
        self._released_from = self._frames + 2  # one may have been on its way
        with suppress(Exception):
            self.command(0.0)
        with suppress(Exception):
            self._send_current(0.0)

    # ---- What is sent --------------------------------------------------------------------------------------------

    def _send_current(self, current_a: float) -> None:
        self._port.send(self._current_id, protocol.current_value(current_a), extended=True)

    def _wait_for(self, arrived: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        if not wait_until(arrived, self._link, timeout_s):
            raise DeviceTimeoutError(f"{self._place}: {otherwise} ({timeout_s:g} s waited)")

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _place(self) -> str:
        return f"[{self.role}] {self._kind} {self._common.node} on {self._port.name}"

    def _state(self) -> DriveState:
        if not self._heard:
            return DriveState.UNKNOWN
        if self._faults.words():
            return DriveState.FAULT
        driving = self._frames < self._released_from or self._flowing_a != 0.0
        return DriveState.ENABLED if self._enabled or driving else DriveState.IDLE

    @property
    def _probe_flows(self) -> bool:
        return abs(self._flowing_a) >= 0.5 * self._common.watchdog_probe_a > 0.0

    def _on_current(self, arrival_ns: int) -> None:
        """A frame came that tells the current."""
        self._frames += 1
        self._frame_ns = arrival_ns
        self._status = None
        self._probe_flowed |= self._probe_flows
