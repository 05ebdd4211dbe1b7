"""A column map proposed for a log: columns by their names, units by names and mechanics, signs by the power balance.

It is a beginning that its reader must check: the sentences say what was taken for granted.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import BenchError, UsageError, nearest
from norton_bench.logs.basic_equation import Basic
from norton_bench.logs.column_map import LogSection, parse_map
from norton_bench.logs.column_names import DRIVE, joints_of, kind_of_column, suits, unit_in_name
from norton_bench.logs.equation import make_problem
from norton_bench.logs.files import Content, kind_of, read_file, split_unit
from norton_bench.logs.grid import common_interval, stretches
from norton_bench.logs.joints import JOINT, asking
from norton_bench.logs.log import read_log, usable_rows
from norton_bench.logs.readings import Readings
from norton_bench.rig.files import toml
from norton_bench.units import conversion

# Without a word of it, the unit of time is that in which rows follow each other by this much at most.
CLOCKS = (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9))
SLOWEST_S = 0.5
# Velocity over the derivative of position as it stands, where units were not told; and how near is near.
ANGLES, SPEEDS = ("rad", "deg", "rev"), ("rad/s", "deg/s", "rpm")
NEAR = 0.1
# The effort of sensor_msgs/JointState, which is in N·m or N.
EFFORT = re.compile(r"(^|[/.])effort(\[|$)")
ELECTRIC = {"V": ("volt",), "A": ("current", "amp")}
LENGTHS = ("m", "mm", "um", "cm", "km")
ALIKE = 0.7


@dataclass(frozen=True)
class Guess:
    """One column of the proposal."""

    name: str
    unit: str
    sign: int = 1
    is_torque: bool = False  # of a command: measured, so that its gain is 1


def write_proposal(log: Path, folder: Path | None, joint: str | None = None) -> tuple[Path, tuple[str, ...]]:
    """The map's file, beside the log or in ``folder``, and what its reader must know.

    Raises UsageError where no column can be told from its name, ``joint`` is none of the log's, or must be chosen, or a
    map of that name is there already.
    """
    path = (folder or log.parent) / f"{log.stem}.map.toml"
    if path.exists():
        raise UsageError(f"{path}: is there already; name it with --columns {path}, or remove it for a new proposal")
    text, sentences = propose(log, joint)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror}); name a folder with --out") from error
    return path, sentences


def propose(log: Path, joint: str | None = None) -> tuple[str, tuple[str, ...]]:
    """The map's text, and what its reader must know. Raises UsageError as :func:`write_proposal`."""
    if kind_of(log) is None and log.exists():
        raise UsageError(f"{log}: its kind is not known by its name; write a map with [log] format, as in docs/logs.md")
    content = read_file(log, LogSection(motion="rotation"))
    one = _chosen(content, joint)
    guesses, sentences = _columns(content, one.names)
    _check(log, content, guesses)
    guesses, by_motion = _by_motion(content, guesses)
    guesses, by_power = _by_power(log, guesses)
    return _text(log, guesses, one), (*one.said, *sentences, *by_motion, *by_power)


@dataclass(frozen=True)
class Chosen:
    """The joint that a log is read for: ``names`` are its columns, as they stand in the map; empty without joints."""

    joint: str | None
    names: Mapping[str, str]
    said: tuple[str, ...] = ()


def _chosen(content: Content, joint: str | None) -> Chosen:
    joints = joints_of(content)
    if joint is None and len(joints) > 1:
        raise UsageError(asking(content.place, joints, "--joint NAME"))
    if joint is None and joints:
        (joint,) = joints
        return Chosen(joint, joints[joint], (f'the joint is "{joint}", the only one.',))
    if joint is None:
        return Chosen(None, {})
    if joint not in joints:
        raise UsageError(f'{content.place}: holds no joint "{joint}" (--joint); {nearest(joint, joints)}')
    return Chosen(joint, joints[joint])


def _columns(content: Content, own: Mapping[str, str]) -> tuple[dict[str, Guess], list[str]]:
    """Columns by name, those of the joint first; of several that could be the same the first."""
    usual = Counter(array.size for array in content.arrays.values()).most_common(1)[0][0]
    others = joints_of(content).values() if own else ()
    foreign = {name for joint in others for name in joint} - set(own)
    guesses: dict[str, Guess] = {}
    sentences: list[str] = []
    for name in (*own, *_by_variation(content, [name for name in content.arrays if name not in (*own, *foreign)])):
        array = content.arrays[name]
        if not content.times_s and array.size != usual:
            continue
        bare, behind = (name, "") if content.times_s else split_unit(name)
        what = kind_of_column(own[name].replace(JOINT, "") if name in own else bare)
        if what is None or (content.times_s and (what == "time" or np.ptp(array) == 0)):
            continue
        if what not in guesses:
            guesses[what] = Guess(name, unit_in_name(what, bare, behind))
        elif name in own or not content.times_s or what in DRIVE:
            sentences.append(f'"{name}" may be the {what} too; "{guesses[what].name}" is taken.')
    return _effort(guesses, sentences), sentences


def _by_variation(content: Content, names: Sequence[str]) -> Sequence[str]:
    """Of the many numbers of a bag those that vary most first, and torques before forces; else as they stand."""
    if not content.times_s:
        return names
    return sorted(names, key=lambda name: ("torque" not in name.lower(), -float(np.nanstd(content.arrays[name]))))


def _effort(guesses: dict[str, Guess], sentences: list[str]) -> dict[str, Guess]:
    """The effort of joint states is what the motor exerts at the joint, and not what a sensor at the port measures."""
    exertion = guesses.get("exertion")
    if exertion is None or "command" in guesses or not EFFORT.search(exertion.name):
        return guesses
    sentences.append(
        f'the effort "{exertion.name}" is taken to be the torque of the drive at the joint; if a sensor behind the '
        "gears measures it, call it exertion, and leave torque_gain out."
    )
    return _as_command(guesses)


def _as_command(guesses: Mapping[str, Guess]) -> dict[str, Guess]:
    """With the torque as what drives."""
    driver = replace(guesses["exertion"], is_torque=True)
    return {
        "command" if what == "exertion" else what: driver if what == "exertion" else guess
        for what, guess in guesses.items()
    }


def _check(log: Path, content: Content, guesses: Mapping[str, Guess]) -> None:
    missing = []
    if "time" not in guesses and not content.times_s:
        missing.append("a time")
    if not {"position", "velocity"} & set(guesses):
        missing.append("a position or velocity")
    if not {"command", "exertion"} & set(guesses):
        missing.append("a command or exertion")
    if missing:
        known = ", ".join(list(content.arrays)[:12])
        unread = [name for name in content.unreadable if kind_of_column(split_unit(name)[0])]
        if unread:
            why = "; ".join(f'"{name}" {content.unreadable[name]}' for name in unread)
            raise UsageError(f"{log}: no column of numbers is {' or '.join(missing)}; {why}")
        untimed = ', with [log] rate = "1 kHz" where no column is a time' if "a time" in missing else ""
        raise UsageError(
            f"{log}: no column can be told by its name to be {' and '.join(missing)}; there are {known}: write a map "
            f"as in docs/logs.md{untimed}, and name it with --columns"
        )


def _by_motion(content: Content, guesses: dict[str, Guess]) -> tuple[dict[str, Guess], list[str]]:
    """Units that no name gives: the clock's by its rows, the motion's by velocity against position."""
    result, sentences = dict(guesses), []
    moving = guesses["position" if "position" in guesses else "velocity"].name
    time = content.times_s[moving] if content.times_s else content.arrays[guesses["time"].name]
    if not content.times_s and not guesses["time"].unit:
        step = float(np.nanmedian(np.diff(time)))
        unit = next((unit for unit, per_s in CLOCKS if step / per_s <= SLOWEST_S), "s")
        result["time"] = replace(guesses["time"], unit=unit)
        sentences.append(
            f'the time "{guesses["time"].name}" is taken to be in {unit}: rows are {step:.4g} {unit} apart.'
        )
    time_s = time if content.times_s else time * conversion(result["time"].unit, "s")[0]
    if {"position", "velocity"} <= set(guesses) and _together(content, guesses):
        sentences += _velocity(content, time_s, result)
    for what, unit in _assumed(result).items():
        if what in result and not result[what].unit:
            result[what] = replace(result[what], unit=unit)
            sentences.append(f'the {what} "{result[what].name}" is taken to be in {unit}, for nothing tells.')
    return result, sentences


def _together(content: Content, guesses: Mapping[str, Guess]) -> bool:
    """Whether position and velocity were sampled at the same times."""
    position, velocity = (content.arrays[guesses[what].name] for what in ("position", "velocity"))
    return position.size == velocity.size


def _assumed(guesses: Mapping[str, Guess]) -> Mapping[str, str]:
    """The units of what neither a name nor another column tells."""
    length = _translation(guesses)
    drive = guesses["command"].name.lower() if "command" in guesses else ""
    electric = next((unit for unit, words in ELECTRIC.items() if any(word in drive for word in words)), "")
    position = guesses["position"].unit if "position" in guesses else ""
    return {
        "position": "m" if length else "rad",
        "velocity": "m/s" if length else "rad/s",
        "goal": position or ("m" if length else "rad"),
        "exertion": "N" if length else "N*m",
        **({"command": electric} if electric else {}),
        **({"command": "N" if length else "N*m"} if "command" in guesses and guesses["command"].is_torque else {}),
        "temperature": "degC",
    }


def _velocity(content: Content, time_s: FloatArray, result: dict[str, Guess]) -> list[str]:
    """Whether the velocity is the derivative of the position, and by which factor."""
    position, velocity = result["position"], result["velocity"]
    steps = np.diff(time_s)
    good = steps > 0
    derived = np.diff(content.arrays[position.name])[good] / steps[good]
    logged = (0.5 * (content.arrays[velocity.name][1:] + content.arrays[velocity.name][:-1]))[good]
    finite = np.isfinite(derived) & np.isfinite(logged)
    derived, logged = derived[finite], logged[finite]
    alike = float(np.corrcoef(derived, logged)[0, 1]) if derived.size and np.ptp(derived) and np.ptp(logged) else 0.0
    if abs(alike) < ALIKE:
        del result["velocity"]
        return [f'"{velocity.name}" is not the derivative of "{position.name}", and is left out.']
    factor = abs(float(derived @ logged / (derived @ derived))) / alike**2
    sentences = []
    if alike < 0:
        result["velocity"] = velocity = replace(velocity, sign=-1)
        sentences.append(f'"{velocity.name}" runs against "{position.name}": its sign is turned.')
    if position.unit and velocity.unit:
        return sentences
    for of_position, of_velocity in _pairs(position.unit, velocity.unit):
        if abs(factor / (conversion(of_position, "rad")[0] / conversion(of_velocity, "rad/s")[0]) - 1) < NEAR:
            result["position"] = replace(position, unit=of_position)
            result["velocity"] = replace(velocity, unit=of_velocity)
            sentences.append(
                f'"{velocity.name}" is {factor:.3g} times the derivative of "{position.name}": they are taken to be in '
                f"{of_velocity} and {of_position}."
            )
            break
    return sentences


def _pairs(of_position: str, of_velocity: str) -> Iterator[tuple[str, str]]:
    """Units of an angle and of its speed that the factor between them tells apart; the likelier first. Where neither is
    known, the same factor is none that tells."""
    if (of_position and not suits(of_position, "rad")) or (of_velocity and not suits(of_velocity, "rad/s")):
        return
    for angle, speed in product([of_position] if of_position else ANGLES, [of_velocity] if of_velocity else SPEEDS):
        if of_position or of_velocity or speed != f"{angle}/s":
            yield angle, speed


def _translation(guesses: Mapping[str, Guess]) -> bool:
    units = [guesses[name].unit for name in ("position", "velocity", "exertion") if name in guesses]
    return any(unit.split("/")[0] in LENGTHS or unit in ("N", "kN", "mN") for unit in units)


def _by_power(log: Path, guesses: dict[str, Guess]) -> tuple[dict[str, Guess], list[str]]:
    """The sign of what drives: turned if inertia or friction come out negative as it is, and do not then.

    A torque beside which no command is known, and which drives the motion, is that of the drive.
    """
    what = "exertion" if "exertion" in guesses else "command"
    name = guesses[what].name
    if "command" in guesses:
        mended = guesses | {what: replace(guesses[what], sign=-guesses[what].sign)}
        message = f'the sign of the {what} "{name}" is turned: else friction would drive the motion.'
    else:
        mended, quantity = _as_command(guesses), "force" if _translation(guesses) else "torque"
        message = (
            f'the {quantity} "{name}" drives the motion: it is taken to be that of the drive; if a sensor at the port '
            "measures what a machine there drives with, call it exertion, with sign = -1."
        )
    try:
        if not _sound(log, guesses) and _sound(log, mended):
            return mended, [message]
    except BenchError:
        pass  # the fit itself says what is wrong
    return guesses, []


def _sound(log: Path, guesses: Mapping[str, Guess]) -> bool:
    column_map = parse_map(_text(log, guesses, Chosen(None, {})), place=str(log))
    one = usable_rows(read_log(log, column_map))
    parts, _ = stretches(one, common_interval([one], None), None)
    everything = [(np.ones(len(part.time_s), dtype=bool), np.zeros(len(part.time_s), dtype=bool)) for part in parts]
    return Basic.of(make_problem(column_map, Readings.of(column_map, parts, everything))).sound


def _text(log: Path, guesses: Mapping[str, Guess], one: Chosen) -> str:
    """The map as a file."""
    motion = "translation" if _translation(guesses) else "rotation"
    lines = [
        f"# Proposed from the names, units and motion of {log.name}: check every line.",
        f"title = {toml(log.stem)}",
        "",
        "[log]",
        f'motion = "{motion}"',
        *([f"joint = {toml(one.joint)}     # --joint chooses another"] if one.joint is not None else []),
        "",
        "[columns]",
    ]
    for what, guess in guesses.items():
        unit = f", unit = {toml(guess.unit)}" if guess.unit else ""
        sign = ", sign = -1" if guess.sign < 0 else ""
        lines.append(f"{what} = {{ name = {toml(one.names.get(guess.name, guess.name))}{unit}{sign} }}")
    lines += _advice(guesses, "N" if motion == "translation" else "N*m")
    return "\n".join(lines) + "\n"


def _advice(guesses: Mapping[str, Guess], exertion: str) -> Sequence[str]:
    if "exertion" in guesses or "command" not in guesses:
        return ()
    if guesses["command"].is_torque:
        return ("", "[actuator]", "torque_gain = 1     # the command is a torque already")
    unit = guesses["command"].unit or "1"
    return (
        "",
        "[actuator]",
        f'# Without it, only ratios are known: torque_gain = "... {exertion}/({unit})"',
    )
