"""A device that does not answer: why, as far as what is heard can tell, and where it is instead."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from norton_bench.check.buses import in_words
from norton_bench.check.findings import BusCheck, Sender
from norton_bench.check.survey import Survey
from norton_bench.check.watch import POLL_NS, Watched
from norton_bench.rig.driver_options import declared_by
from norton_bench.rig.files import keys_of
from norton_drivers import registry
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.ports import Backend
from norton_drivers.recognition import Recognition
from norton_drivers.registry import open_amplifier, open_torque_sensor
from norton_drivers.wiring import DeviceSettings

_NAMED = 6  # of what nobody knows, no more are named than this


def explain_silence(
    settings: DeviceSettings, error: DeviceTimeoutError, bus: BusCheck, bitrate_bit_s: int
) -> DeviceTimeoutError:
    """Why a device on a bus does not answer, as far as what is heard there can tell.

    ``error`` in better words; itself where the device is heard, so that something else is amiss.
    """
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


# The last one asked may take its time.
_ANSWER_NS = 50_000_000


def ask_everybody(
    watched: Sequence[Watched], link: Link, survey: Survey, recognition: Mapping[str, Recognition]
) -> None:
    """Devices that speak only when spoken to, at an address that the rig file does not know: found by asking
    everybody.

    Where a device did not answer, put its kind's questions to every address on its bus. Nothing moves.
    """
    absent = {(each.settings.bus, each.settings.driver): each for each in watched if _is_absent(each)}
    for (bus, driver), each in absent.items():
        probes = recognition.get(driver, Recognition()).probes
        if bus is None or probes is None or bus not in link.can_ports:
            continue
        heard = survey.buses[bus].standard_ids()
        with suppress(DeviceError):  # a lost bus has been told
            for question in probes(each.settings.options, heard):
                link.can_ports[bus].send(question.arbitration_id, question.data, extended=question.extended)
                link.wait(POLL_NS)
            link.wait(_ANSWER_NS)


def _is_absent(each: Watched) -> bool:
    return each.identity is None and any(isinstance(problem, DeviceTimeoutError) for problem in each.problems)


OPTION = "baud"
# The usual ones, the likeliest first.
BAUDS = (115_200, 460_800, 9_600, 921_600, 57_600, 38_400, 19_200, 230_400, 1_000_000, 2_000_000)
_TRY_S = 0.3


def explain_noise(
    settings: DeviceSettings, error: DeviceTimeoutError, bytes_heard: int, backend: Backend
) -> DeviceTimeoutError:
    """A serial device that speaks at another baud rate than the rig file says: found by trying the others.

    ``error`` in better words, where bytes came of which the driver could make nothing; itself where none came.
    """
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
