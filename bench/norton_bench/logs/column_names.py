"""What the names of columns tell: what a column holds, in which unit, and of which joint of several."""

import re
from collections.abc import Iterator, Mapping

from norton_bench.logs.files import Content, plain_unit, split_unit
from norton_bench.logs.joints import JOINT
from norton_bench.units import conversion

# What a column holds, by its name without case, in the order in which they are asked: a "position goal" is a goal, a
# "torque command" a command.
NAMES: Mapping[str, str] = {
    "time": r"^(t|ts|sec|secs|seconds)$|time|stamp|zeit|clock",
    "goal": r"goal|set.?point|target|desired|reference|(^|_)(ref|des|soll)(_|$)",
    "command": r"command|(^|_)(cmd|i|iq|u|pwm|cur|amps?|volts?)(_|$|\d)|current|voltage|duty|strom",
    "exertion": r"torque|(^|_)(tau|trq|moment|f)(_|$|\d)|force|effort|load.?cell|drehmoment|kraft",
    "velocity": r"veloc|speed|(^|_)(vel|omega|qd|dq|rpm|w|v)(_|$|\d)|geschwindigkeit",
    "position": r"position|angle|encoder|displacement|(^|_)(pos|theta|phi|q|qm|x)(_|$|\d)|winkel|weg",
    "temperature": r"temp",
}
# Units at the end of a name, longest first.
ENDINGS: Mapping[str, str] = {
    "rad_s": "rad/s", "deg_s": "deg/s", "mm_s": "mm/s", "turns": "rev", "m_s": "m/s", "rpm": "rpm", "rad": "rad",
    "deg": "deg", "rev": "rev", "mnm": "mN*m", "mm": "mm", "um": "um", "nm": "N*m", "ms": "ms", "us": "us", "ns": "ns",
    "ma": "mA", "s": "s", "m": "m", "n": "N", "a": "A", "v": "V", "c": "degC",
}  # fmt: skip
# What feeds the drive is none of its commands.
SUPPLY = re.compile(r"battery|supply|(^|[_/.])(v?bus|vin)([_/.]|$)")
# Names that say nothing beside those that they are in: "/current/data", "/wrench/torque/z".
EMPTY = ("data", "value", "x", "y", "z", "w")


def kind_of_column(name: str) -> str | None:
    """What a column holds, as a map calls it; None where its name does not tell. No unit may stand behind it."""
    *_, parent, last = ["", *(part.strip("[]_.") for part in name.split("/"))]
    told = re.sub(r"[\s-]+", "_", (parent if last.lower() in EMPTY and parent else last).lower())
    ending = next((f"_{each}" for each in ENDINGS if told.endswith(f"_{each}")), "")
    names = (told, told.removesuffix(ending))
    if SUPPLY.search(name.lower()):
        return None
    return next((what for what, pattern in NAMES.items() if any(re.search(pattern, name) for name in names)), None)


# What a column may be measured in; a command in anything.
SUIT: Mapping[str, tuple[str, ...]] = {
    "time": ("s",), "position": ("rad", "m"), "goal": ("rad", "m"), "velocity": ("rad/s", "m/s"),
    "exertion": ("N*m", "N", "A"), "temperature": ("degC",),
}  # fmt: skip


def unit_in_name(what: str, bare: str, behind: str) -> str:
    """The unit behind the name of a column that holds ``what``, or at its end, if it suits that ("tau_m" is the torque
    of a motor); empty where neither is one."""
    try:
        return "" if behind.isdigit() else plain_unit(behind)  # of "position[1]" it is the joint
    except ValueError:
        ending = next((each for each in ENDINGS if bare.lower().endswith(f"_{each}")), None)
        return ENDINGS[ending] if ending and suits(ENDINGS[ending], *SUIT.get(what, (ENDINGS[ending],))) else ""


def suits(unit: str, *others: str) -> bool:
    """Whether a value in ``unit`` can be given in one of the others."""

    def can(other: str) -> bool:
        try:
            conversion(unit, other)
        except ValueError:
            return False
        return True

    return any(map(can, others))


# position[elbow], interface_values[elbow]/values[position], q[0]; names of joints may have brackets themselves.
BRACKETS = (
    re.compile(r"(?P<first>[^\[]*\[)(?P<joint>[^\]]+)(?P<last>\](?:/.*)?)"),
    re.compile(r"(?P<first>[^\[]*\[)(?P<joint>.+)(?P<last>\])"),
)
# /joint_states/elbow/position
PATHS = (re.compile(r"(?P<first>(?:.*/)?)(?P<joint>[^/]+)(?P<last>/[^/]+)"),)
# q1, q_1, joint1_position
NUMBERS = (re.compile(r"(?P<first>\D*)(?P<joint>\d+)(?P<last>\D*)"),)
# left_elbow_position_rad, elbow.position, position_elbow: tried at every one of these.
WORDS = re.compile(r"[_.]")
WAYS = (BRACKETS, PATHS, WORDS, NUMBERS)
MOTION, DRIVE = ("position", "velocity"), ("command", "exertion")

Way = re.Pattern[str] | tuple[re.Pattern[str], ...]
# The columns of each joint, and each column's name with {joint} in it.
Joints = Mapping[str, Mapping[str, str]]


def joints_of(content: Content) -> Joints:
    """By the first way of naming them that gives several joints, each with a motion and what drives it; else none.

    In a bag, what stands in brackets behind a motion is a joint, also the only one.
    """
    for way in WAYS:
        found = _by(way, content)
        certain = bool(content.times_s) and way is BRACKETS
        joints = _with_motion(found, alone=certain, both=way is PATHS)
        if len(joints) >= (1 if certain else 2):
            return {joint: found[joint] for joint in joints}
    return {}


def _by(way: Way, content: Content) -> dict[str, dict[str, str]]:
    result: dict[str, dict[str, str]] = {}
    for name in content.arrays:
        bare = name if content.times_s else _without_unit(name)
        found = next(_parts(way, bare), None)
        if found is not None:
            first, joint, last = found
            result.setdefault(joint, {})[name] = f"{first}{JOINT}{last}"
    return result


def _parts(way: Way, name: str) -> Iterator[tuple[str, str, str]]:
    """What stands before the joint, the joint, and what stands behind it."""
    if isinstance(way, re.Pattern):
        places = [found.start() for found in way.finditer(name)][::-1]
        pairs = [("", name[:at], name[at:]) for at in places] + [(name[: at + 1], name[at + 1 :], "") for at in places]
        # A joint is no quantity: "torque_command" is none of a joint "torque".
        yield from (each for each in pairs if kind_of_column(each[0] + each[2]) and not kind_of_column(each[1]))
    else:
        matches = (pattern.fullmatch(name) for pattern in way)
        yield from ((found["first"], found["joint"], found["last"]) for found in matches if found)


def _without_unit(name: str) -> str:
    """A number in brackets is the row of a matrix."""
    bare, behind = split_unit(name)
    try:
        plain_unit(behind)
    except ValueError:
        return name
    return name if behind.isdigit() else bare


def _with_motion(found: Joints, *, alone: bool, both: bool) -> list[str]:
    """The joints that have a motion and a drive; or a motion ``alone``, or ``both`` position and velocity."""

    def has(joint: str) -> Iterator[str | None]:
        return (kind_of_column(name.replace(JOINT, "")) for name in found[joint].values())

    result = []
    for joint in found:
        kinds = set(has(joint))
        moves = bool(kinds & set(MOTION))
        if moves and (alone or kinds & set(DRIVE) or (both and kinds.issuperset(MOTION))):
            result.append(joint)
    return result
