"""Who sends a CAN frame, as far as one frame can tell: what ``rig check`` says of a bus where somebody is missing.

A driver's module may offer ``recognise(message, options)``, a :data:`Recogniser`: a pure function, without a port and
without a clock, that is shown every kind of frame on the bus, those of other makers' devices too.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import can


@dataclass(frozen=True, slots=True)
class Recognised:
    """What a frame looks like.

    ``device`` is the sender in words ("an ODrive"), ``says`` what the frame is ("heartbeat"), ``options`` what a rig
    file would say to reach the sender ({"node": 3}). A frame that many others could be as well is not ``sure``: it
    counts only beside a sure one with the same options. One that a host sends, not the device, is ``from_host``.
    """

    device: str
    says: str
    options: Mapping[str, Any] = field(default_factory=dict)
    sure: bool = True
    from_host: bool = False


# Given a frame and the options of the rig's device with this driver ({} where the rig has none).
Recogniser = Callable[[can.Message, Mapping[str, Any]], Recognised | None]
