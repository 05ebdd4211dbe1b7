"""A Bota force-torque sensor."""

from norton_drivers.bota import BotaOptions
from norton_drivers.codecs.bota import BotaFrame
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, TorqueSignal

BOTA_PERIOD_NS = 1_000_000
TEMPERATURE_C = 31.5


class BotaSensor:
    """A Bota force-torque sensor streaming binary frames at 1 kHz, stamped with its own clock.

    Reports the port's torque about one of its axes; the others read zero. ``status`` is sent as it stands.
    """

    def __init__(self, context: DeviceContext) -> None:
        self.signal = TorqueSignal(context.world.plant)
        self.status = 0
        self._axis = "xyz".index(parse_options(BotaOptions, context.settings).axis)
        self._us_per_ns = 1e-3 / (1 + context.clock_ppm * 1e-6)
        self._epoch_us = context.random.randrange(1 << 32)
        self._connector = context.serial_connector()
        context.cyclic(BOTA_PERIOD_NS, self._send)

    def freeze(self) -> None:
        """From now on report the torque of this instant; the clock runs on."""
        self.signal.freeze()

    def _send(self, stamp_ns: int) -> None:
        torques_nm = [0.0, 0.0, 0.0]
        torques_nm[self._axis] = self.signal.measure_nm()
        x_nm, y_nm, z_nm = torques_nm
        clock_us = (self._epoch_us + round(stamp_ns * self._us_per_ns)) & 0xFFFFFFFF
        self._connector.send(BotaFrame(self.status, 0.0, 0.0, 0.0, x_nm, y_nm, z_nm, clock_us, TEMPERATURE_C).encode())
