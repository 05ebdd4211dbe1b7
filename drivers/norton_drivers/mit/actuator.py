"""Actuators in MIT mode (mini-cheetah, CubeMars AK) on CAN: torques or goals out, motion in.

Every frame to the drive is answered with position, velocity and torque as they were before the frame was obeyed; while
it is not enabled it is asked with the frame that disables it. Nothing in a reply says whether it is enabled. After its
timeout the drive obeys a command of zero, and stays enabled. Exactly zero torque cannot be sent: what is sent instead
is the nearest code, half a step off. Sources: bgkatz/motorcontrol, Core/Src/stm32f4xx_it.c (reply before obedience;
special frames do not feed the timeout), fsm.c (timeout; enabled with the command that was stored last), can.c, main.c
(timeout of 1000 control cycles by default), foc.c (``torque_control``: the position loop), position_sensor.c (velocity
over 19 cycles of 25 µs); neurobionics/TMotorCANControl, mit_can.py (CubeMars' drives wrap).
"""

from math import nan
from typing import ClassVar

import can

from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.mit import Reply, Special
from norton_drivers.codecs.ranges import GoalCodes
from norton_drivers.link import Link
from norton_drivers.mit.options import MitOptions
from norton_drivers.ports import CanPort
from norton_drivers.readings import DeviceIdentity
from norton_drivers.spoken_to.drive import PROBE_ENDED_NS, Addressed, Answer, SpokenToDrive
from norton_drivers.wiring import DeviceSettings

PROBE_FLOWS_NS = 20_000_000  # when the probe of the watchdog is looked at first


class MitActuator(SpokenToDrive):
    """One motor."""

    _kind: ClassVar = "MIT motor"

    def __init__(self, settings: DeviceSettings, options: MitOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings, options, port, link)
        self.options = options
        self._probe_flowed = self._probe_ended = False
        self._know(options.ranges)
        port.subscribe(self._on_frame)

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Disable the motor, which it answers: a drive in MIT mode tells nothing else of itself."""
        self._hear(
            timeout_s,
            f"is it powered and in MIT mode, and are node and master (0x{self.options.master:X}) what is set in it?",
        )
        return DeviceIdentity(driver="mit", address=self._address)

    def provoke_watchdog(self) -> None:
        """The probe's torque, where the rig gives one; a frame that is no command shows how it ends."""
        self._send(*self._pack_torque(self.options.ranges.command_code(self.options.watchdog_probe_nm)))
        self._provoked_ns = self._link.clock.now_ns()
        self._probe_flowed = self._probe_ended = False

    def made_itself_safe(self) -> bool | None:
        return self._probe_ended if self._probe_flowed else None

    # ---- What is sent --------------------------------------------------------------------------------------------

    def _pack_torque(self, code: int) -> Addressed:
        return self.options.node, protocol.command_value(code)

    def _pack_goal(self, codes: GoalCodes) -> Addressed:
        return self.options.node, protocol.goal_value(codes)

    def _send_enable(self) -> None:
        self._send(self.options.node, Special.ENABLE.encode())

    def _send_disable(self) -> None:
        self._send(self.options.node, Special.DISABLE.encode())

    def _ask_provoked(self, silent_ns: int) -> None:
        """As seldom as will do, in case that its firmware counts it."""
        ended = silent_ns >= self.options.watchdog_s * 1e9 + PROBE_ENDED_NS
        if ended or (not self._probe_flowed and silent_ns >= PROBE_FLOWS_NS):
            self._send_enable()

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        if message.is_extended_id or message.is_remote_frame:
            return
        data = message.data
        if message.arbitration_id != self.options.master or not data or data[0] != self.options.node:
            if data:
                self._note_stranger(f"node {data[0]} with id 0x{message.arbitration_id:X}")
            return
        try:
            reply = Reply.decode(data)
        except CodecError:
            self.malformed += 1
            return
        self._look_at_probe(reply)
        warmth = nan if reply.temperature is None else reply.temperature + self.options.temperature_offset_c
        error = protocol.describe_error(reply.error) if reply.error else ""
        if reply.error is not None and reply.error > protocol.ERRORS_MAX:
            error += '; a Damiao motor (driver = "damiao") has a temperature in its place'
        codes = reply.position_code, reply.velocity_code, reply.torque_code
        self._on_answer(Answer(*codes, error=error, motor_c=warmth), arrival_ns)

    def _look_at_probe(self, reply: Reply) -> None:
        probe_nm = self.options.watchdog_probe_nm
        if self._provoked_ns is None or not probe_nm:
            return
        flows = abs(self.options.ranges.torque_of(reply.torque_code)) >= 0.5 * probe_nm
        self._probe_ended = self._probe_flowed and not flows
        self._probe_flowed |= flows
