"""Serial lines judged: how much of what each carries is taken, how often it lets a drive be read, and who is on it."""

from collections.abc import Iterator, Mapping, Sequence
from statistics import median

from norton_bench.check.buses import in_words
from norton_bench.check.survey import LineCheck, LineSurvey
from norton_bench.check.watch import BAUDS, OPTION, baud_of, explain_noise
from norton_bench.rig.driver_options import amplifier_options
from norton_bench.rig.rig import Rig
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.finding import Found
from norton_drivers.link import Link
from norton_drivers.ports import Backend
from norton_drivers.registry import Recognition
from norton_drivers.serial_timing import Exchange, opened_at
from norton_drivers.wiring import DeviceSettings


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
    others: Sequence[DeviceSettings],
    bytes_heard: int,
    backend: Backend,
    recognition: Mapping[str, Recognition],
) -> DeviceTimeoutError:
    """Why a device on a serial line does not answer, as far as asking at other baud rates and for others can tell.

    ``others`` share the line; who has their addresses is one of them. ``error`` in better words; itself where the
    device is there as the rig file says.
    """
    if recognition.get(settings.driver, Recognition()).find is None:
        return explain_noise(settings, error, bytes_heard, backend)
    taken = [each.options.get("node") for each in others]
    written = {**settings.options, "driver": settings.driver, OPTION: opened_at(baud_of(settings) or 0)}
    for baud in dict.fromkeys((written[OPTION], *BAUDS)):
        for driver, found in _who_answers(settings, baud, backend, recognition):
            wanted = {"driver": driver, OPTION: baud, **found.options}
            changed = {key: value for key, value in wanted.items() if written.get(key) != value}
            if not changed:
                return error  # it is there: something else is amiss
            if baud != written[OPTION] or found.options.get("node") not in taken:
                return DeviceTimeoutError(
                    f"[{settings.role}] {settings.driver} on {settings.port}: nothing answers as the rig file says, "
                    f"but at {baud} baud there is {found.device}; set {in_words(changed)}"
                )
    return DeviceTimeoutError(f"{error}; nobody known answers at the other usual baud rates either")


def _who_answers(
    settings: DeviceSettings, baud: int, backend: Backend, recognition: Mapping[str, Recognition]
) -> Iterator[tuple[str, Found]]:
    """Who answers at this rate, each with its driver: first those of the device's own."""
    link = Link(backend, ())
    try:
        port = link.serial_port(settings, baud)
        for driver in sorted(recognition, key=lambda each: each != settings.driver):
            if (find := recognition[driver].find) is not None:
                for found in find(port, link):
                    yield driver, found
    except DeviceError:
        return  # a port that refuses the rate, or is lost, tells nothing
    finally:
        link.close()
