"""A serial device that speaks at another baud rate than the rig file says: found by trying the others."""

from dataclasses import replace

from norton_bench.rig.driver_options import declared_by
from norton_bench.rig.mistakes import keys_of
from norton_drivers import registry
from norton_drivers.backend import Backend
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.registry import open_amplifier, open_torque_sensor
from norton_drivers.wiring import DeviceSettings

OPTION = "baud"
# The usual ones, the likeliest first.
BAUDS = (115_200, 460_800, 9_600, 921_600, 57_600, 38_400, 19_200, 230_400, 1_000_000, 2_000_000)
_TRY_S = 0.3


def explain_noise(
    settings: DeviceSettings, error: DeviceTimeoutError, bytes_heard: int, backend: Backend
) -> DeviceTimeoutError:
    """``error`` in better words, where bytes came of which the driver could make nothing; itself where none came."""
    if not bytes_heard:
        return error
    place, used = f"[{settings.role}] {settings.driver} on {settings.port}", _baud_of(settings)
    if used is None:
        return DeviceTimeoutError(f"{place}: {bytes_heard} bytes came, but nothing that is its; is driver right?")
    found = next((baud for baud in BAUDS if baud != used and _speaks(settings, baud, backend)), None)
    if found is None:
        return DeviceTimeoutError(
            f"{place}: {bytes_heard} bytes came, but nothing that is its, neither at {used} baud nor at the other "
            "usual ones; is driver right, is the device set to stream?"
        )
    return DeviceTimeoutError(f"{place}: it speaks at {found} baud, not at {used}: set {OPTION} = {found}")


def _baud_of(settings: DeviceSettings) -> int | None:
    """What the rig file says, else the driver's default; None for a driver that has no such option."""
    group = registry.TORQUE_SENSORS if settings.role == "torque_sensor" else registry.AMPLIFIERS
    model = declared_by(group, settings.driver).model
    info = keys_of(model).get(OPTION) if model is not None else None
    return None if info is None else int(settings.options.get(OPTION, info.default))


def _speaks(settings: DeviceSettings, baud: int, backend: Backend) -> bool:
    """Whether the driver understands the device at this rate. A port that refuses the rate does not."""
    link = Link(backend, ())
    tried = replace(settings, options={**settings.options, OPTION: baud})
    open_it = open_torque_sensor if settings.role == "torque_sensor" else open_amplifier
    try:
        open_it(tried, link).identify(_TRY_S)
    except DeviceError:
        return False
    finally:
        link.close()
    return True
