"""Who is on a CAN bus, as far as frames can tell: what ``rig check`` says where somebody is missing, or doubled.

A driver's module may offer three functions, all of them pure, without a port and without a clock:

- ``recognise(message, options)``, a :data:`Recogniser`, which is shown every frame on the bus, other makers' too;
- ``answers(question, frame)``, whether ``frame`` answers ``question``: two answers come from two devices;
- ``probes(options, heard)``, questions that make every device of this kind say something, whatever its address.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import can

from norton_drivers.readings import RawFrame


@dataclass(frozen=True, slots=True)
class Recognised:
    """What a frame looks like.

    ``device`` is the sender in words ("an ODrive"), ``says`` what the frame is ("heartbeat"), ``options`` what a rig
    file would say to reach the sender ({"node": 3}). A frame that many others could be as well is not ``sure``: it
    counts only beside a sure one with the same options, or without options beside any sure one of this driver. One that
    a host sends, not the device, is ``from_host``.
    """

    device: str
    says: str
    options: Mapping[str, Any] = field(default_factory=dict)
    sure: bool = True
    from_host: bool = False


class Question(NamedTuple):
    """A frame that moves nothing, and that a device of one kind answers."""

    arbitration_id: int
    data: bytes
    extended: bool = False


# Given a frame and the options of the rig's device with this driver ({} where the rig has none).
Recogniser = Callable[[can.Message, Mapping[str, Any]], Recognised | None]
# Given a question as it was sent, and a frame that came after it.
Answers = Callable[[RawFrame, RawFrame], bool]
# Given the options, and the standard identifiers heard on the bus: those of others must not be disturbed.
Probes = Callable[[Mapping[str, Any], Collection[int]], Iterator[Question]]


def answers_remotely(question: RawFrame, frame: RawFrame) -> bool:
    """A remote frame is answered under its own identifier, whoever made the device."""
    same = (frame.arbitration_id, frame.extended) == (question.arbitration_id, question.extended)
    return question.remote and same and not frame.remote


def nobodys(identifier: int, heard: Collection[int], block: int = 32) -> bool:
    """Whether nothing is heard near a standard identifier: nodes often own a block of them."""
    return all(other // block != identifier // block for other in heard)


@dataclass(frozen=True)
class Recognition:
    """What one driver offers."""

    recognise: Recogniser | None = None
    answers: Answers | None = None
    probes: Probes | None = None
