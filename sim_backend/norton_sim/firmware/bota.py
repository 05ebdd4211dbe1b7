"""A Bota force-torque sensor streaming binary frames at 1 kHz, stamped with its own clock."""

from norton_drivers.bota import BotaOptions
from norton_drivers.codecs.bota import BotaFrame
from norton_drivers.wiring import parse_options
from norton_sim.firmware.site import Site, TorqueSignal

SAMPLE_PERIOD_NS = 1_000_000
TEMPERATURE_C = 31.5


class BotaSensor:
    """Reports the port's torque about one of its axes; the others read zero. ``status`` is sent as it stands."""

    def __init__(self, site: Site) -> None:
        self.signal = TorqueSignal(site.world.plant)
        self.status = 0
        self._axis = "xyz".index(parse_options(BotaOptions, site.settings).axis)
        self._us_per_ns = 1e-3 / (1 + site.clock_ppm * 1e-6)
        self._epoch_us = site.random.randrange(1 << 32)
        self._plug = site.serial_connector()
        site.cyclic(SAMPLE_PERIOD_NS, self._send)

    def freeze(self) -> None:
        """From now on report the torque of this instant; the clock runs on."""
        self.signal.freeze()

    def _send(self, stamp_ns: int) -> None:
        torques_nm = [0.0, 0.0, 0.0]
        torques_nm[self._axis] = self.signal.measure_nm()
        x_nm, y_nm, z_nm = torques_nm
        clock_us = (self._epoch_us + round(stamp_ns * self._us_per_ns)) & 0xFFFFFFFF
        self._plug.send(BotaFrame(self.status, 0.0, 0.0, 0.0, x_nm, y_nm, z_nm, clock_us, TEMPERATURE_C).encode())
