"""Serial lines judged: how much of what each carries is taken, how often it lets a drive be read, and who is on it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from statistics import median
from typing import Any

from norton_bench.check.buses import in_words
from norton_bench.check.survey import LineCheck, LineSurvey
from norton_bench.check.watch import BAUDS, OPTION, POLL_NS, baud_of, explain_noise
from norton_bench.rig.driver_options import amplifier_options, declared_by
from norton_bench.rig.rig import Rig
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.ports import Backend
from norton_drivers.registry import Recognition, group_of
from norton_drivers.serial_timing import Exchange, opened_at
from norton_drivers.wiring import DeviceSettings

_ANSWER_NS = 60_000_000


def check_lines(
    rig: Rig, surveys: Mapping[str, LineSurvey], held_back: Mapping[str, str], *, exact: bool
) -> tuple[LineCheck, ...]:
    """The lines of the rig's drives; ``held_back`` says of a port what makes its adapter slow.

    ``exact``: arrivals are those of the bytes; else bytes were found when the loop looked for them, once a tick.
    """
    latest_s = (1.0 if exact else 1.5) * rig.tick_s
    result = []
    for settings in rig.wiring.devices():
        declared = amplifier_options(settings.driver, settings.options) if settings.port is not None else None
        if settings.port is None or declared is None or declared.exchange is None:
            continue
        exchange, delays_s = declared.exchange, surveys[settings.port].delays_s
        result.append(
            LineCheck(
                settings.role,
                settings.port,
                exchange.baud,
                exchange.share_there(rig.tick_s),
                exchange.share_back(rig.tick_s),
                exchange.greatest_rate_hz,
                median(delays_s) if delays_s else None,
                tuple(_remarks(settings, exchange, rig, delays_s, latest_s, held_back.get(settings.port, ""))),
            )
        )
    return tuple(result)


def _remarks(
    settings: DeviceSettings,
    exchange: Exchange,
    rig: Rig,
    delays_s: Sequence[float],
    latest_s: float,
    held_back: str,
) -> Iterator[str]:
    """Why a reading does not come in every tick, and what to do."""
    place, rate_hz = f"[{settings.role}] port {settings.port}", 1 / rig.tick_s
    ticks = exchange.ticks(rig.tick_s)
    if ticks > 1:
        mend = "" if exchange.baud == 0 else f", or raise {OPTION} in the drive and here"
        yield (
            f"{place}: carries a reading in one tick of {ticks}, {rate_hz / ticks:.0f} a second; "
            f'write rate = "{_lower(exchange.greatest_rate_hz)} Hz" for one in every tick{mend}'
        )
    elif delays_s and (answer_s := median(delays_s)) > latest_s:
        slow = f" ({held_back})" if held_back else ""
        yield (
            f"{place}: answers come {answer_s * 1e3:.2f} ms after their questions, {exchange.round_s * 1e3:.2f} ms of "
            f'it on the line: later than the next tick{slow}; write rate = "{_lower(1 / answer_s)} Hz", or take '
            "another adapter"
        )


def _lower(rate_hz: float) -> int:
    """A round number below, at least 10."""
    step = 50 if rate_hz >= 200 else 10
    return max(10, int(rate_hz / step) * step)


def explain_silent_line(
    settings: DeviceSettings,
    error: DeviceTimeoutError,
    bytes_heard: int,
    backend: Backend,
    recognition: Mapping[str, Recognition],
) -> DeviceTimeoutError:
    """Why a device on a serial line does not answer, as far as asking at other baud rates and for others can tell.

    ``error`` in better words; itself where nobody is found.
    """
    if recognition.get(settings.driver, Recognition()).serial is None:
        return explain_noise(settings, error, bytes_heard, backend)
    used = baud_of(settings)
    place = f"[{settings.role}] {settings.driver} on {settings.port}"
    for baud in dict.fromkeys((opened_at(used or 0), *BAUDS)):
        found = dict(_who_answers(settings, baud, backend, recognition))
        if settings.driver in found and baud != opened_at(used or 0):
            return DeviceTimeoutError(f"{place}: it speaks at {baud} baud, not at {used}: set {OPTION} = {baud}")
        if found and settings.driver not in found:
            driver, words = next(iter(found.items()))
            return DeviceTimeoutError(
                f'{place}: {words} answers there (driver = "{driver}", {OPTION} = {baud}); is driver right?'
            )
        if found:
            return error  # it is there: something else is amiss
    return DeviceTimeoutError(f"{error}; nobody known answers at the other usual baud rates either")


def explain_by_search(
    settings: DeviceSettings, error: DeviceTimeoutError, others: Sequence[DeviceSettings], backend: Backend
) -> DeviceTimeoutError | None:
    """Of a device on a line that several share: who answers instead, at its own rate or at another; None for a driver
    that cannot ask."""
    declared, used = declared_by(group_of(settings.role), settings.driver), baud_of(settings)
    if declared.find is None or used is None:
        return None
    taken = [each.options.get("node") for each in others]
    for baud in (used, *(each for each in BAUDS if each != used)):
        link = Link(backend, ())
        tried = replace(settings, options={**settings.options, OPTION: baud})
        try:
            heard = list(declared.find(tried, link))
        except DeviceError:
            continue  # a port that refuses the rate
        finally:
            link.close()
        found = next((each for each in heard if baud != used or each.options.get("node") not in taken), None)
        if found is not None:
            return DeviceTimeoutError(_instead(settings, found, baud, used))
    return error


def _instead(settings: DeviceSettings, found: Any, baud: int, used: int) -> str:
    place = f"[{settings.role}] {settings.driver} on {settings.port}"
    wanted = {**found.options, **({OPTION: baud} if baud != used else {})}
    changed = {key: value for key, value in wanted.items() if settings.options.get(key) != value}
    mend = f"set {in_words(changed)}" if found.options else "name the driver that speaks that"
    return f"{place}: nothing answers as the rig file says, but at {baud} baud there is {found.device}; {mend}"


def _who_answers(
    settings: DeviceSettings, baud: int, backend: Backend, recognition: Mapping[str, Recognition]
) -> Iterator[tuple[str, str]]:
    """The drivers whose question is answered at this rate, each with who answers."""
    link, heard = Link(backend, ()), bytearray()

    def hear(data: bytes, _arrival_ns: int) -> Any:
        heard.extend(data)

    try:
        port = link.serial_port(settings, baud)
        port.subscribe(hear)
        for driver, offered in recognition.items():
            if offered.serial is None:
                continue
            heard.clear()
            port.send(offered.serial.ask)
            end_ns = link.clock.now_ns() + _ANSWER_NS
            while link.clock.now_ns() < end_ns:
                link.wait(POLL_NS)
            if (words := offered.serial.recognise(bytes(heard))) is not None:
                yield driver, words
    except DeviceError:
        return  # a port that refuses the rate, or is lost, tells nothing
    finally:
        link.close()
