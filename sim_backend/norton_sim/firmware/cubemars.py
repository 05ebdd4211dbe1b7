"""A CubeMars AK actuator in servo mode, as it behaves on CAN.

Source: CubeMars, AK Series Actuator Driver Manual V1.0.8, section 5.2.1 (what it sends, at up to 500 Hz); its commands,
its timeout and its faults are emulated as VESC's, from which it descends. Of its commands, currents and the temporary
origin are emulated.
"""

from math import degrees
from typing import cast

import can

from norton_drivers.codecs import cubemars as protocol
from norton_drivers.codecs import vesc
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.cubemars import Upload
from norton_drivers.codecs.vesc import Packet
from norton_drivers.cubemars import CubeMarsOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault
from norton_sim.firmware.releasing import ReleasingAmplifier
from norton_sim.plant import Machine

UPLOAD_PERIOD_NS = 2_000_000
SET_ORIGIN = 5
FAULTS = {DriveFault.FAULT: 2, DriveFault.UNDERVOLTAGE: 4, DriveFault.OVER_TEMPERATURE: 1}


class CubeMarsActuator:
    """One actuator."""

    def __init__(self, context: DeviceContext) -> None:
        self._options = options = parse_options(CubeMarsOptions, context.settings)
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        self.amplifier = ReleasingAmplifier(
            context,
            self._machine,
            FAULTS,
            minimum_current_a=options.minimum_current_a,
            timeout_s=options.watchdog_s,
            per_ampere=options.per_ampere,
        )
        self.heating = self.amplifier.heating
        self._zero_rad = 0.0
        self._frozen: tuple[float, float] | None = None
        self._connector = context.can_connector()
        self._connector.on_frame(self._receive)
        context.cyclic(UPLOAD_PERIOD_NS, self._upload)

    @property
    def armed(self) -> bool:
        return self.amplifier.running

    def break_down(self, fault: DriveFault) -> None:
        self.amplifier.break_down(fault)

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self._motion()

    def _upload(self, _stamp_ns: int) -> None:
        position_rad, velocity_rad_s = self._motion()
        tenths = int(degrees(position_rad) / protocol.POSITION_STEP_DEG)
        if self._options.beyond_range == "saturates":
            furthest = round(protocol.POSITION_END_DEG / protocol.POSITION_STEP_DEG)
            tenths = min(max(tenths, -furthest), furthest)
        erpm = velocity_rad_s / self._options.rad_s_per_erpm
        current_a = self._plant.current_a(self._machine) if self.armed else 0.0
        warmth_c = min(int(self.heating.temperature_c), 127)
        told = Upload(tenths, erpm, current_a, warmth_c, self.amplifier.fault)
        self._connector.send(vesc.arbitration_id(protocol.UPLOAD, self._options.node), told.encode(), extended=True)

    def _motion(self) -> tuple[float, float]:
        """Position [rad] from where the origin was set, and velocity [rad/s]."""
        if self._frozen is not None:
            return self._frozen
        plant, machine = self._plant, self._machine
        return plant.encoder_position_rad(machine) - self._zero_rad, plant.encoder_velocity_rad_s(machine)

    def _receive(self, message: can.Message) -> None:
        packet, node = vesc.split_id(message.arbitration_id)
        if not message.is_extended_id or message.is_remote_frame or node != self._options.node:
            return
        try:
            if packet == Packet.SET_CURRENT:
                self.amplifier.set_current(vesc.current_of(message.data))
            elif packet == SET_ORIGIN:
                self._zero_rad = self._plant.encoder_position_rad(self._machine)
        except CodecError:
            return  # cut short
