"""Devices that speak only when spoken to, at an address that the rig file does not know: found by asking everybody."""

from collections.abc import Mapping, Sequence
from contextlib import suppress

from norton_bench.check.survey import Survey
from norton_bench.check.watch import POLL_NS, Watched
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.recognition import Recognition

# The last one asked may take its time.
_ANSWER_NS = 50_000_000


def ask_everybody(
    watched: Sequence[Watched], link: Link, survey: Survey, recognition: Mapping[str, Recognition]
) -> None:
    """Where a device did not answer, put its kind's questions to every address on its bus. Nothing moves."""
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
