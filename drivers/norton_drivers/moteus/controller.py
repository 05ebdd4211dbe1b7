"""moteus controllers (mjbots) on CAN FD: torques or goals out, motion in.

A controller speaks only when it is asked; every command asks, too, and the reply tells the state before it. So there is
motion as often as there are commands; while it is not enabled it is asked a hundred times a second. A command of
position mode, a torque with all gains zero or a goal, is good for the watchdog's time; after it the controller goes to
its mode "timeout", and obeys no command until it was stopped. Questions do not count for that. Sources: mjbots/moteus,
docs/protocol/registers.md, docs/guides/control-modes.md, docs/troubleshooting/timeout-mode-11.md;
fw/moteus_controller.cc (commands are obeyed after the reply), fw/bldc_servo_control.h (``ISR_MaybeChangeMode``: a fault
and a timeout are left by a stop alone), fw/bldc_servo.cc (``ISR_DoSense``: only commands renew the time).
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import nan, tau

import can

from norton_drivers.codecs import moteus as protocol
from norton_drivers.codecs.common import CodecError, float32_step
from norton_drivers.codecs.moteus import Identity, Mode, Register, State
from norton_drivers.codecs.multiplex import Address
from norton_drivers.drive_base import DriveBase
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, wait_until
from norton_drivers.moteus.options import MoteusOptions
from norton_drivers.ports import CanPort
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading
from norton_drivers.servo import Lead
from norton_drivers.wiring import DeviceSettings

SILENT_NS = 150_000_000
QUESTION_PERIOD_NS = 10_000_000
OLDEST_REGISTER_MAP = 4  # velocities and positions have had their scales since
_AT_REST = (Mode.STOPPED, Mode.FAULT)
_WITHOUT_CURRENT = (*_AT_REST, Mode.ENABLING, Mode.CALIBRATING, Mode.CALIBRATION_COMPLETE)


class MoteusController(DriveBase):
    """One controller. ``malformed`` counts its replies that could not be decoded."""

    heartbeat_timeout_ns = SILENT_NS

    def __init__(self, settings: DeviceSettings, options: MoteusOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings)
        self.options = options
        self.command_unit = options.command_unit or ""
        self.malformed = 0
        self._port = port
        self._link = link
        self._rad_per_turn = settings.direction * tau
        self._to = Address(options.host_node, options.node, asks=True, prefix=options.prefix)
        self._lead = Lead() if options.mode == "position" else None
        make, self._unit = protocol.FORMS[options.mode]
        self._form = make(options.watchdog_s)
        self._reply: State | None = None
        self._replies, self._reply_ns = 0, 0
        self._identities: list[Identity] = []  # as it has told since it was last asked
        self._enabled = False
        self._resting = True  # whether it is asked, and brought to rest where it is not
        self._faults: tuple[str, ...] = ()  # since it was enabled
        self._asked_ns: dict[bytes, int] = {}  # by the question
        self._provoked = False
        port.subscribe(self._on_frame, {Address(options.node, options.host_node, prefix=options.prefix).identifier})
        link.questions.append(self._ask_now_and_then)

    # ---- What the bench asks -------------------------------------------------------------------------------------

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask who it is, and for its motion."""
        self._identities.clear()
        replies, ask = self._replies, partial(self._now_and_then, protocol.ASK_IDENTITY)
        if not wait_until(lambda: self._replies > replies and self._identities != [], self._link, timeout_s, ask):
            raise DeviceTimeoutError(
                f"{self._place}: does not answer ({timeout_s:g} s waited); is it powered, is node its id.id and prefix "
                "its can.prefix, and does the bus have 1 and 5 Mbit/s with sample points at two thirds of a bit?"
            )
        who = self._identities[-1]
        if who.register_map < OLDEST_REGISTER_MAP:
            raise DeviceError(f"{self._place}: its firmware ({who.firmware_words}) is too old; update it")
        hardware = f"model 0x{who.model:04X}"
        return DeviceIdentity("moteus", f"{self._port.name} node {self.options.node}", hardware, who.firmware_words)

    def enable(self, timeout_s: float = 2.0) -> None:
        """Stop it, which clears faults and a timeout; then command nothing until it says that it obeys."""
        self.stop()
        self._faults = ()
        stop = partial(self._now_and_then, protocol.STOP)
        self._await(lambda: self._mode == Mode.STOPPED, timeout_s, "does not stop", stop)
        self._begin_goals()
        self._resting, replies = False, self._replies
        try:
            self._await(lambda: self._replies > replies and self._runs(), timeout_s, "does not start", self._feed)
        except DeviceError:
            self._resting = True
            raise
        self._enabled, self._status = True, None

    def command(self, value: float) -> float:
        """Command a torque [N m], a position [rad] or a velocity [rad/s]; returns what is sent: the nearest, or where
        it is led that was enabled away from a position of zero. Raises ConnectionFailedError, DeviceError."""
        wanted = self._direction * value
        if self._lead is not None:
            wanted = self._lead.led_rad(wanted, self._link.clock.now_ns())
        try:
            frame, sent = self._form.frame(wanted / self._unit)
        except CodecError as error:
            raise DeviceError(f"{self._place}: cannot command {value} {self.command_unit}") from error
        self._provoked = False
        self._send(frame)
        return self._direction * self._unit * sent

    @property
    def position_resolution_rad(self) -> float:
        """The encoder's step, or that of the float32 turns on the wire at the present position if it is larger."""
        turns = 0.0 if self._reply is None else self._reply.position_turns
        encoder_turns = 1 / self.options.counts_per_turn if self.options.counts_per_turn else 0.0
        return tau * max(float32_step(turns), encoder_turns)

    @property
    def watchdog_s(self) -> float:
        return self.options.watchdog_s

    def provoke_watchdog(self) -> None:
        self.command(0.0)
        self._provoked = True

    def made_itself_safe(self) -> bool | None:
        return self._mode is not None and self._mode != Mode.POSITION

    def stop(self) -> None:
        """Stopped, which ends the current; again and again until it says so."""
        self._enabled, self._resting, self._provoked, self._status = False, True, False, None
        with suppress(Exception):
            self._send(protocol.STOP)

    # ---- What is sent --------------------------------------------------------------------------------------------

    def _send(self, data: bytes) -> None:
        self._port.send(self._to.identifier, data, extended=self._to.extended, fd=True)

    def _feed(self) -> None:
        if self._is_time():
            self.command(0.0)

    def _ask_now_and_then(self) -> None:
        """Called before every poll."""
        if self._resting and self._mode is not None and self._mode not in _AT_REST:
            self._now_and_then(protocol.STOP)
        elif self._resting or self._provoked:
            self._now_and_then(protocol.ASK)

    def _now_and_then(self, question: bytes) -> None:
        if self._is_time(question):
            self._send(question)

    def _is_time(self, question: bytes = b"") -> bool:
        now_ns = self._link.clock.now_ns()
        due = now_ns - self._asked_ns.get(question, now_ns - QUESTION_PERIOD_NS) >= QUESTION_PERIOD_NS
        if due:
            self._asked_ns[question] = now_ns
        return due

    def _begin_goals(self) -> None:
        if self._lead is not None and self._reply is not None:
            try:
                self._lead.begin(tau * self._reply.position_turns, self._link.clock.now_ns())
            except DeviceError as error:
                raise DeviceError(f"{self._place}: cannot be enabled: {error}") from error

    def _await(
        self, happens: Callable[[], bool], timeout_s: float, otherwise: str, meanwhile: Callable[[], None] | None = None
    ) -> None:
        if not wait_until(happens, self._link, timeout_s, meanwhile):
            mode = "no answer" if self._mode is None else f"it is in mode {protocol.describe_mode(self._mode)}"
            raise DeviceTimeoutError(f"{self._place}: {otherwise} ({mode}, {timeout_s:g} s waited)")

    def _runs(self) -> bool:
        """Whether it obeys commands by now. Raises DeviceError where it will not."""
        reply = self._reply
        if reply is not None and Register.ILIMIT_SCALE in reply.refused:
            raise DeviceError(f"{self._place}: its firmware is too old for a torque without integral; update it")
        if self._mode == Mode.FAULT:
            raise DeviceError(f"{self._place}: cannot be enabled: {'; '.join(self._present_faults())}")
        return self._mode == Mode.POSITION

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _place(self) -> str:
        return f"[{self.role}] moteus {self.options.node} on {self._port.name}"

    @property
    def _mode(self) -> int | None:
        return None if self._reply is None else self._reply.mode

    def _new_status(self) -> DriveStatus:
        reply = self._reply
        return DriveStatus(
            state=self._state(),
            heartbeat_ns=None if reply is None else self._reply_ns,
            errors=self._faults or self._present_faults(),
            transistor_temperature_c=nan if reply is None else reply.temperature_c,
            bus_voltage_v=nan if reply is None else reply.voltage_v,
        )

    def _state(self) -> DriveState:
        if self._mode is None:
            return DriveState.UNKNOWN
        if self._faults or self._mode == Mode.FAULT:
            return DriveState.FAULT
        return DriveState.IDLE if self._mode in _WITHOUT_CURRENT else DriveState.ENABLED

    def _present_faults(self) -> tuple[str, ...]:
        """Of an enabled one also that it obeys no more, or not in full."""
        reply = self._reply
        if reply is None:
            return ()
        if reply.mode == Mode.FAULT or (self._enabled and reply.fault in protocol.DERATED):
            return (protocol.describe_fault(reply.fault),)
        if not self._enabled or reply.mode == Mode.POSITION:
            return ()
        if reply.mode == Mode.TIMEOUT:
            return ("its watchdog has expired: no command came in time",)
        return (f"left position mode without a fault (now {protocol.describe_mode(reply.mode)})",)

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        if message.is_remote_frame:
            return
        try:
            state = State.decode(message.data)
            if state is None:
                self._identities += [who for who in (Identity.decode(message.data),) if who is not None]
                return
        except CodecError:
            self.malformed += 1
            return
        self._reply, self._reply_ns = state, arrival_ns
        self._replies += 1
        self._status = None
        if self._enabled:
            self._faults = (*self._faults, *(words for words in self._present_faults() if words not in self._faults))
        scale, motion, current = self._rad_per_turn, self._motion, self._current
        motion.put(
            MotionReading(motion.count, arrival_ns, scale * state.position_turns, scale * state.velocity_turns_s)
        )
        current.put(CurrentReading(current.count, arrival_ns, self._direction * state.q_current_a))
