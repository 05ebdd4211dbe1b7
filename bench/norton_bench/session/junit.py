"""A session as a JUnit report, for a continuous integration server.

There is no standard; https://github.com/testmoapp/junitxml describes what most tools write and read: ``testsuites``,
``testsuite``, ``testcase`` with ``failure`` or ``skipped``, ``properties``. Steps are cases, and so are the final fit
and every expectation; parameters are properties.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from time import perf_counter
from xml.etree import ElementTree as ET

from norton_bench.errors import ExitCode, UsageError
from norton_bench.events import (
    Ended,
    Note,
    Planned,
    PlannedStep,
    SessionEvent,
    SessionState,
    StateChanged,
    StepBegun,
)
from norton_bench.models.parameters import HALF_INTERVAL

# XML 1.0 allows no other characters, not even escaped.
NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass
class JUnitReport:
    """Watches the session ``name``, and writes ``path`` when it is over."""

    path: Path
    name: str
    properties: Mapping[str, str] = field(default_factory=dict)
    _plan: Sequence[PlannedStep] = ()
    _begun: dict[int, float] = field(default_factory=dict)
    _ended: dict[int, float] = field(default_factory=dict)
    _current: int | None = None
    _concluding_s: float | None = None
    _notes: list[str] = field(default_factory=list)
    _started: datetime = field(default_factory=lambda: datetime.now(UTC))
    _started_s: float = field(default_factory=perf_counter)

    def __call__(self, event: SessionEvent) -> None:
        """Take an event. Raises OSError where the report cannot be written at the end, because the disk is full."""
        match event:
            case Planned(steps):
                self._plan = steps
            case StepBegun(index):
                self._end_step()
                self._current = index
                self._begun[index] = perf_counter()
            case Note(text):
                self._notes.append(text)
            case StateChanged(SessionState.CONCLUDING):
                self._end_step()
                self._current = None
                self._concluding_s = perf_counter()
            case Ended():
                self._write(event)

    def prepare(self) -> None:
        """Make its folder, and check that the file can be written. Raises UsageError where it cannot."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.write_text("", encoding="utf-8")
        except OSError as error:
            raise UsageError(f"--junit {self.path}: cannot be written ({error.strerror}); name another file") from error

    def _write(self, summary: Ended) -> None:
        if not summary.failure:
            self._end_step()
        tree = ET.ElementTree(self._suites(summary))
        ET.indent(tree)
        tree.write(self.path, encoding="utf-8", xml_declaration=True)

    def _end_step(self) -> None:
        if self._current is not None:
            self._ended.setdefault(self._current, perf_counter())

    def _suites(self, summary: Ended) -> ET.Element:
        cases = [*self._steps(summary), *self._conclusion(summary), *self._expectations(summary)]
        counts = {
            "tests": str(len(cases)),
            "failures": str(sum(case.find("failure") is not None for case in cases)),
            "skipped": str(sum(case.find("skipped") is not None for case in cases)),
            "errors": "0",
            "time": f"{perf_counter() - self._started_s:.3f}",
        }
        suites = ET.Element("testsuites", {"name": _clean(self.name), **counts})
        started = self._started.strftime("%Y-%m-%dT%H:%M:%S")  # Jenkins does not read an offset
        suite = ET.SubElement(suites, "testsuite", {"name": _clean(self.name), "timestamp": started, **counts})
        properties = ET.SubElement(suite, "properties")
        for name, value in {**self.properties, **_figures(summary)}.items():
            ET.SubElement(properties, "property", {"name": name, "value": _clean(value)})
        suite.extend(cases)
        ET.SubElement(suite, "system-out").text = _clean("\n".join(self._notes))
        return suites

    def _steps(self, summary: Ended) -> list[ET.Element]:
        cases = []
        for index, step in enumerate(self._plan):
            case = self._case(f"{index + 1} {step.name}" + (f" ({step.label})" if step.label else ""), "steps")
            if index in self._ended:
                case.set("time", f"{self._ended[index] - self._begun[index]:.3f}")
            elif index in self._begun:
                case.set("time", f"{perf_counter() - self._begun[index]:.3f}")
                _fail(case, summary.failure, summary.exit_code.name)
            else:
                message = "left out by its condition, or by the operator" if not summary.failure else "not reached"
                ET.SubElement(case, "skipped", {"message": message})
            cases.append(case)
        return cases

    def _conclusion(self, summary: Ended) -> list[ET.Element]:
        """The final fit as a case; also what ended the session before its first step."""
        stepped = self._current is not None and self._current not in self._ended
        case = self._case("final fit" if not summary.failure or stepped else "session", "session")
        if self._concluding_s is not None:
            case.set("time", f"{perf_counter() - self._concluding_s:.3f}")
        if summary.failure and stepped:
            ET.SubElement(case, "skipped", {"message": "not reached"})
        elif summary.failure:
            _fail(case, summary.failure, summary.exit_code.name)
        elif summary.exit_code is not ExitCode.OK and all(expectation.met for expectation in summary.expectations):
            _fail(case, "; ".join(summary.verdict) or "the fit gives no result", summary.exit_code.name)
        return [case]

    def _expectations(self, summary: Ended) -> list[ET.Element]:
        cases = []
        for number, expectation in enumerate(summary.expectations, 1):
            case = self._case(f"{number} {expectation.name}", "expectations")
            if not expectation.met:
                _fail(case, expectation.sentence, "NOT_AS_EXPECTED")
            else:
                ET.SubElement(case, "system-out").text = _clean(expectation.sentence)
            cases.append(case)
        return cases

    def _case(self, name: str, kind: str) -> ET.Element:
        return ET.Element(
            "testcase", {"name": _clean(name), "classname": _clean(f"{self.name}.{kind}"), "time": "0.000"}
        )


def _figures(summary: Ended) -> dict[str, str]:
    """Of every parameter value, half of its 95 % interval, unit and status; errors of prediction; paths of files."""
    figures = {}
    for estimate in summary.estimates:
        figures[estimate.name] = f"{estimate.value:.9g}" if isfinite(estimate.value) else ""
        figures[f"{estimate.name}.plus_minus"] = _number(HALF_INTERVAL * estimate.std)
        figures[f"{estimate.name}.unit"] = estimate.unit
        figures[f"{estimate.name}.status"] = estimate.status.value
    for name in ("torque_relative", "velocity_relative"):
        if getattr(summary, name) is not None:
            figures[f"validation.{name}"] = _number(getattr(summary, name))
    for name in ("recording", "network", "report"):
        if getattr(summary, name) is not None:
            figures[name] = str(getattr(summary, name))
    return figures


def _number(number: float) -> str:
    return f"{number:.3g}" if isfinite(number) else ""


def _fail(case: ET.Element, message: str, kind: str) -> None:
    ET.SubElement(case, "failure", {"message": _clean(message), "type": kind}).text = _clean(message)


def _clean(text: str) -> str:
    return NOT_XML.sub("�", text)
