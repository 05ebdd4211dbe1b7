"""Why a device on a bus does not answer, as far as what is heard there can tell."""

from collections.abc import Sequence

from norton_bench.check.findings import BusCheck, Sender
from norton_bench.check.senders import in_words
from norton_drivers.errors import DeviceTimeoutError
from norton_drivers.wiring import DeviceSettings

_NAMED = 6  # of what nobody knows, no more are named than this


def explain_silence(
    settings: DeviceSettings, error: DeviceTimeoutError, bus: BusCheck, bitrate_bit_s: int
) -> DeviceTimeoutError:
    """``error`` in better words; itself where the device is heard, so that something else is amiss."""
    if any(sender.role == settings.role for sender in bus.senders):
        return error
    place = f"[{settings.role}] {settings.driver} on bus {bus.name}"
    if bus.frames == 0:
        return DeviceTimeoutError(f"{place}: {_nothing_heard(bus, bitrate_bit_s)}")
    strangers = [sender for sender in bus.senders if sender.role is None]
    own_kind = [sender for sender in strangers if sender.driver == settings.driver]
    if own_kind:
        return DeviceTimeoutError(f"{place}: {_elsewhere(settings, own_kind)}")
    if strangers:
        return DeviceTimeoutError(f"{place}: nobody is heard; {_other_kind(strangers)}")
    return DeviceTimeoutError(f"{place}: does not answer; {_who_is_heard(bus, bitrate_bit_s)}")


def _nothing_heard(bus: BusCheck, bitrate_bit_s: int) -> str:
    if bus.troubles:
        return (
            f"not one frame is heard, but errors are ({_troubles(bus)}): bitrate = {bitrate_bit_s} bit/s is probably "
            "not the devices', or wiring or termination is wrong"
        )
    return f"not one frame is heard: check power, cable and termination, and that its bitrate is {bitrate_bit_s} bit/s"


def _troubles(bus: BusCheck) -> str:
    return ", ".join(f"{what} {count} times" for what, count in bus.troubles.items())


def _elsewhere(settings: DeviceSettings, found: Sequence[Sender]) -> str:
    """Its kind is heard, at another address."""
    wanted = {name: settings.options[name] for name in found[0].options if name in settings.options}
    heard = " and ".join(f"{sender.device} at {in_words(sender.options)} ({sender.says[0]})" for sender in found)
    which = f"set {in_words(found[0].options)}" if len(found) == 1 else "set the one that is meant"
    if not wanted:
        return f"nobody is heard, but {heard}: {which}"
    return f"nobody is heard at {in_words(wanted)}, but {heard}: {which}, or give the device {in_words(wanted)}"


def _other_kind(found: Sequence[Sender]) -> str:
    heard = " and ".join(
        f'{sender.device} (driver = "{sender.driver}"{", " if sender.options else ""}{in_words(sender.options)})'
        for sender in found
    )
    return f"heard instead: {heard}; is driver right, is the device powered?"


def _who_is_heard(bus: BusCheck, bitrate_bit_s: int) -> str:
    known = " and ".join(f"[{sender.role}]" for sender in bus.senders if sender.role is not None)
    if bus.strangers:
        names = ", ".join(bus.strangers[:_NAMED]) + (", ..." if len(bus.strangers) > _NAMED else "")
        return f"frames are heard that no driver knows ({names}): is it a device of this kind, with this address?"
    if bus.troubles:
        return (
            f"only {known} can be heard, and errors ({_troubles(bus)}): is it set to {bitrate_bit_s} bit/s, and its "
            "cable sound?"
        )
    return f"only {known} can be heard: is it powered, and on this bus?"
