"""Which bitrate a bus needs: the one its devices are delivered with, where that is enough for what they say."""

from collections.abc import Sequence

from norton_bench.rig.driver_options import declared_by
from norton_bench.units import parse_quantity
from norton_drivers import registry

USUAL = "1 Mbit/s"
# What a drive takes of a bus in each tick, at most: its command and two messages, of 8 bytes and with 29-bit
# identifiers. ISO 11898-1: 67 + 64 bits each, of which about one in twenty is doubled by stuffing.
BITS_PER_TICK = 3 * round(1.05 * (67 + 64))
# A bus as busy as that holds frames back now and then (`rig check` says so, too).
MOST_LOAD = 0.9


def bitrate_for(devices: Sequence[tuple[str, str]], rate_hz: float) -> tuple[str, str]:
    """The bitrate to propose for a bus with these devices, ``(role, driver)``, and what is to be said of it."""
    delivered = [(driver, bitrate) for role, driver in devices if (bitrate := _delivered(role, driver))]
    if not delivered:
        return USUAL, ""
    driver, bitrate = min(delivered, key=lambda each: parse_quantity(each[1], "bit/s"))
    drives = sum(role != "torque_sensor" for role, _ in devices)
    needed_bit_s = drives * BITS_PER_TICK * rate_hz
    if needed_bit_s <= MOST_LOAD * parse_quantity(bitrate, "bit/s"):
        return bitrate, f"{bitrate} as {driver} drives are delivered; as set in every device on it"
    return USUAL, (
        f"{driver} drives are delivered with {bitrate}, too little for {drives} of them at {rate_hz:g} Hz "
        f"(some {needed_bit_s / 1e3:.0f} kbit/s): set {USUAL} in every device on it, or give each a bus of its own"
        if drives > 1
        else f"{driver} drives are delivered with {bitrate}, too little at {rate_hz:g} Hz: set {USUAL} in the device"
    )


def _delivered(role: str, driver: str) -> str | None:
    """The bitrate that its maker sets, where its driver knows one."""
    return declared_by(registry.TORQUE_SENSORS if role == "torque_sensor" else registry.AMPLIFIERS, driver).bitrate
