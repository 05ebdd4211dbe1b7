"""The file of an arm: which rigs its joints are on, and what is done with them."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import sin
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from norton_bench.errors import RigError
from norton_bench.procedures.waves import HIGHEST_SHARE
from norton_bench.rig.files import Mistakes, check_kind, parse_toml, read_text
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.rig.schema import SectionModel
from norton_bench.units import parse_quantity, quantity_in
from norton_drivers.wiring import Wiring

JOINTS = ("shoulder", "elbow")
# A sine of the elbow's angle below this: the hand has next to no stiffness along the arm that joints could tell.
BENT = 0.05
# Mass, damping and stiffness are told apart by how torque changes with frequency: three values, and two to see misfit.
FEWEST_LINES = 5
SECTIONS = ("joints", "links", "impedance", "reach", "simulated")


class JointsSection(SectionModel):
    """``[joints]``: the rig file of each joint, from the folder of this file."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", examples=["arm"])
    shoulder: str = Field(examples=["shoulder.toml"])
    elbow: str = Field(examples=["elbow.toml"])


class ImpedanceSection(SectionModel):
    """``[impedance]``: how the ports are moved about where they rest.

    Sines between ``lowest`` and ``highest``, all of them periodic in ``period``; ``swing`` is how far a joint is moved
    to either side.
    """

    swing_rad: Annotated[float, quantity_in("rad")] = Field(0.03, alias="swing", gt=0, le=0.5, examples=["30 mrad"])
    lowest_hz: Annotated[float, quantity_in("Hz")] = Field(0.4, alias="lowest", gt=0, examples=["0.4 Hz"])
    highest_hz: Annotated[float, quantity_in("Hz")] = Field(8.0, alias="highest", gt=0, le=50, examples=["8 Hz"])
    period_s: Annotated[float, quantity_in("s")] = Field(4.0, alias="period", gt=0, le=60, examples=["4 s"])
    periods: int = Field(4, ge=4, le=100, examples=[4])

    @model_validator(mode="after")
    def _has_lines(self) -> "ImpedanceSection":
        if (self.highest_hz - self.lowest_hz) * self.period_s < 2 * FEWEST_LINES:
            raise ValueError(
                f"between lowest and highest are fewer than {FEWEST_LINES} odd multiples of 1/period; "
                "widen the band, or lengthen the period"
            )
        return self


class LinksSection(SectionModel):
    """``[links]``: lengths from joint to joint and on to the hand, and the angles at which the encoders began."""

    upper_m: Annotated[float, quantity_in("m")] = Field(alias="upper", gt=0, examples=["0.31 m"])
    lower_m: Annotated[float, quantity_in("m")] = Field(alias="lower", gt=0, examples=["0.34 m"])
    shoulder_rad: Annotated[float, quantity_in("rad")] = Field(0.0, alias="shoulder", examples=["0.8 rad"])
    elbow_rad: Annotated[float, quantity_in("rad")] = Field(alias="elbow", examples=["1.6 rad"])


class ReachSection(SectionModel):
    """``[reach]``: the commands of a movement from zero and back, to be repeated without torque at the ports."""

    shoulder: str = Field(examples=["0.3 rad"])
    elbow: str = Field(examples=["-0.2 rad"])
    hold_s: Annotated[float, quantity_in("s")] = Field(3.0, alias="hold", gt=0.1, le=60, examples=["3 s"])
    trials: int = Field(5, ge=3, le=100, examples=[5])


@dataclass(frozen=True)
class Reach:
    """``commands`` are those of shoulder and elbow, each in its own unit."""

    commands: tuple[float, float]
    hold_s: float
    trials: int


@dataclass(frozen=True)
class Arm:
    """Two joints, shoulder and elbow, each on a bench of its own. ``simulated`` is the simulator's table."""

    name: str
    rigs: tuple[Rig, Rig]
    impedance: ImpedanceSection
    reach: Reach | None = None
    links: LinksSection | None = None
    simulated: Mapping[str, Any] = field(default_factory=dict)
    place: str = ""

    @property
    def options(self) -> str:
        """What was done with it, as the recordings keep it: they can be evaluated by the same options alone."""
        reach = None if self.reach is None else asdict(self.reach)
        return json.dumps({"tick_s": self.tick_s, "impedance": self.impedance.model_dump(), "reach": reach})

    @property
    def benches(self) -> list[tuple[Wiring, Mapping[str, Any], str]]:
        """Of each joint what the simulator is told: wiring, true values, and the file that they are from."""
        return [(rig.wiring, rig.simulated, rig.place) for rig in self.rigs]

    @property
    def tick_s(self) -> float:
        return self.rigs[0].tick_s

    @property
    def is_simulated(self) -> bool:
        return self.rigs[0].backend == "simulated"


def load_arm(path: Path, *, backend: str | None = None) -> Arm:
    """The arm that the file at ``path`` describes; ``backend`` overrides that of its rigs.

    Raises RigError: one line for each mistake, in this file or in those of the joints, with its place and the remedy.
    """
    place, mistakes = str(path), Mistakes(str(path))
    written = parse_toml(read_text(path, "arm file", RigError), place, RigError)
    check_kind(written, "arm file", place, RigError)
    for unknown in written.keys() - set(SECTIONS):
        mistakes.add(f"[{unknown}]", f"unknown section; known are {', '.join(f'[{name}]' for name in SECTIONS)}")
    joints = mistakes.read(JointsSection, written.get("joints", {}), "joints")
    impedance = mistakes.read(ImpedanceSection, written.get("impedance", {}), "impedance")
    reach = mistakes.read(ReachSection, written["reach"], "reach") if "reach" in written else None
    links = mistakes.read(LinksSection, written["links"], "links") if "links" in written else None
    if not isinstance(written.get("simulated", {}), dict):
        mistakes.add("[simulated]", "is a section; write [simulated] on a line of its own")
    if links is not None and abs(sin(links.elbow_rad)) < BENT:
        mistakes.add(
            "[links] elbow", "the arm is stretched out or folded: its hand has no stiffness along the arm; bend it"
        )
    mistakes.raise_as(RigError)
    assert joints is not None
    assert impedance is not None
    shoulder, elbow = (load_rig(path.parent / name, backend=backend) for name in (joints.shoulder, joints.elbow))
    _check(shoulder, elbow, mistakes)
    if impedance.highest_hz > HIGHEST_SHARE / shoulder.tick_s:
        mistakes.add("[impedance] highest", f"is more than a fifth of the rate in {shoulder.place}; lower it")
    wanted = None if reach is None else _reach(reach, (shoulder, elbow), mistakes)
    mistakes.raise_as(RigError)
    return Arm(joints.name, (shoulder, elbow), impedance, wanted, links, written.get("simulated", {}), place)


def _check(shoulder: Rig, elbow: Rig, mistakes: Mistakes) -> None:
    if shoulder.name == elbow.name:
        mistakes.add("[joints]", f'both rigs are called "{elbow.name}"; give them names of their own, for their files')
    if shoulder.tick_ns != elbow.tick_ns:
        mistakes.add("[joints]", "the rigs have different rates; give both the same [rig] rate")
    if shoulder.backend != elbow.backend:
        mistakes.add("[joints]", "one rig is simulated and the other is not; give both the same [rig] backend")
    for device in sorted(_places(shoulder) & _places(elbow)):
        mistakes.add(
            "[joints]", f"both rigs have a device at {device}; give every device of both an address of its own"
        )
    for rig in (shoulder, elbow):
        lacking = [name for name in ("load", "torque_sensor") if getattr(rig.wiring, name) is None]
        if lacking:
            mistakes.add(f"[joints] {rig.name}", f"{rig.place} has no [{lacking[0]}], which the joint needs; add it")


def _places(rig: Rig) -> set[str]:
    """Where each device is: its serial port, or its address on its bus."""
    channels = {bus.name: f"{bus.interface} {bus.channel}" for bus in rig.wiring.buses}
    places = set()
    for device in rig.wiring.devices():
        node = device.options.get("node")
        where = device.port or channels.get(device.bus or "", "")
        if device.port is not None or node is not None:
            places.add(where if node is None else f"node {node} of {where}")
    return places


def _reach(section: ReachSection, rigs: tuple[Rig, Rig], mistakes: Mistakes) -> Reach:
    commands = [0.0, 0.0]
    for joint, (name, rig) in enumerate(zip(JOINTS, rigs, strict=True)):
        try:
            commands[joint] = parse_quantity(getattr(section, name), rig.command.unit)
        except ValueError as error:
            mistakes.add(f"[reach] {name}", str(error))
            continue
        low, high = rig.command.span
        if not low <= commands[joint] <= high:
            mistakes.add(
                f"[reach] {name}",
                f"{commands[joint]:g} {rig.command.unit} is not within {low:g} to {high:g}, the limit in {rig.place}",
            )
    return Reach((commands[0], commands[1]), section.hold_s, section.trials)
