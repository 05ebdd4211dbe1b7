"""The bench moved by hand: setpoints, bounds, keys, and devices."""

from collections.abc import Iterable
from dataclasses import dataclass
from textwrap import wrap

from norton_bench.jog.hands import DEVICE, NAME, Bounds
from norton_bench.records import SegmentInfo
from norton_bench.report.words import pretty_unit
from norton_bench.screen.panels.health import health_rows
from norton_bench.screen.picture.picture import Picture
from norton_bench.screen.styles import LABEL, LEAST_COLUMNS, STRONG, TEXT, UNIT, WARNING, Row, apart, fitted, heading
from norton_bench.segments import LoadMode

READY = "Nothing moves yet: s enables the drives at zero."
NAME_WIDTH = 10
KEYS = (
    ("space", "stops at once, from anywhere"),
    ("↑ ↓", "the actuator's command"),
    ("→ ←", "the load's torque or velocity"),
    ("c t v z", "the load coasts, pushes, turns, keeps the port at zero torque"),
    ("b", "the load acts a mass, a damper and a spring"),
    ("+ -", "size of a step"),
    ("0", "everything back to zero"),
    ("?", "all keys"),
)
OPENING = " opening the devices; the very first run compiles for a while"
OVER = "The drives are idle. s enables them again."
LOAD_KEYS = "; load: c coast  t torque  v velocity  z zero torque  b body"
BEFORE_ZERO_S = 5.0  # the action of the dead man's switch is marked this long before


@dataclass(frozen=True)
class Asking:
    """``share`` is the size of a step; ``left_s`` the time without a key until everything returns to zero."""

    share: float
    left_s: float | None


def ready_rows(picture: Picture, bounds: Bounds, dead_man_s: float, width: int, height: int) -> list[Row]:
    """The bounds and the keys, shown before anything moves."""
    low, high = bounds.command
    limits, has_load = picture.rig.limits, picture.rig.wiring.load is not None
    load = f"up to {bounds.load_torque_nm:.4g} N·m; up to {bounds.velocity_rad_s:.4g} rad/s once it is calibrated (k)"
    facts = {
        "actuator": f"{low:.4g} to {high:.4g} {pretty_unit(bounds.command_unit)}".replace("-", "−"),
        "load": load if has_load else "",
        "shaft": f"torques off at {bounds.speed_rad_s:.4g} rad/s; the guard stops at {limits.velocity_rad_s:.4g} rad/s",
        "no key": f"for {dead_man_s:.4g} s: everything returns to zero",
    }
    keys = [each for each in KEYS if has_load or "load" not in each[1]]
    rows = [heading("Limits", "", "", width), *_facts(facts.items(), width)]
    rows += [[], heading("Keys", "", "", width), *_facts(keys, width)]
    return [fitted(row, width) for row in rows][:height]


def _facts(facts: Iterable[tuple[str, str]], width: int) -> list[Row]:
    """Each with its name at the left; on as many rows as its words need."""
    return [
        [(f"{'' if number else name:<{NAME_WIDTH}}", STRONG), (line, LABEL)]
        for name, text in facts
        for number, line in enumerate(wrap(text, max(width - NAME_WIDTH, 1)))
    ]


def asked_rows(picture: Picture, bounds: Bounds, asking: Asking, width: int, *, live: bool) -> list[Row]:
    """Two rows: the setpoints and the size of a step; and what happens next without a key. On a phone they are four."""
    if width < LEAST_COLUMNS:
        return _asked_below(picture, bounds, asking, width, live=live)
    segment, step = picture.segment, f"step {asking.share * 100:g} %: {_sizes(picture, bounds, asking.share)}"
    if not live:
        return [apart([(f" {OVER if picture.summary else READY}", TEXT)], [(f"{step} ", LABEL)], width)]
    if segment is None:
        return [apart([(OPENING, TEXT)], [(f"{step} ", LABEL)], width)]
    doing = _doing(segment)
    rows = [apart([(" setpoints  ", UNIT), (doing, STRONG)], [(f"{step} ", LABEL)], width)]
    end = f" torques off at {bounds.speed_rad_s:.4g} rad/s"
    if asking.left_s is None:
        return [*rows, [(end + (LOAD_KEYS if picture.rig.wiring.load is not None else ""), LABEL)]]
    style = WARNING if asking.left_s < BEFORE_ZERO_S else LABEL
    return [*rows, [(f"{end}; without a key all returns to zero in ", LABEL), (f"{asking.left_s:.0f} s", style)]]


def _asked_below(picture: Picture, bounds: Bounds, asking: Asking, width: int, *, live: bool) -> list[Row]:
    """The same, one below the other."""
    step: Row = [(f"step {asking.share * 100:g} %: {_sizes(picture, bounds, asking.share)}", LABEL)]
    if not live or picture.segment is None:
        words = (OPENING if live else OVER if picture.summary else READY).strip()
        return [*([(line, TEXT)] for line in wrap(words, width)), step]
    rows: list[Row] = [[(line, STRONG)] for line in wrap(_doing(picture.segment), width)]
    end = f"torques off at {bounds.speed_rad_s:.4g} rad/s"
    if asking.left_s is None:
        return [*rows, step, [(end, LABEL)]]
    style = WARNING if asking.left_s < BEFORE_ZERO_S else LABEL
    left: Row = [("no key: all to zero in ", LABEL), (f"{asking.left_s:.0f} s", style)]
    # The countdown stands before the limit, which never changes: the last row is the one that may have no room.
    return [*rows, step, left, [(end, LABEL)]]


def _doing(segment: SegmentInfo) -> str:
    return pretty_unit(segment.name) if segment.procedure == NAME else f"{segment.procedure}: {segment.name}"


def _sizes(picture: Picture, bounds: Bounds, share: float) -> str:
    """The size of a step of the actuator's command, and of the load's value, if it has one."""
    sizes = [f"{share * bounds.greatest_command:.3g} {pretty_unit(bounds.command_unit)}"]
    if picture.segment is not None and picture.segment.procedure == NAME:
        if picture.segment.mode == LoadMode.TORQUE.value:
            sizes.append(f"{share * bounds.load_torque_nm:.3g} N·m")
        elif imposes(picture):
            sizes.append(f"{share * bounds.velocity_rad_s:.3g} rad/s")
    return ", ".join(sizes)


def imposes(picture: Picture) -> bool:
    """Whether the load imposes a velocity."""
    segment = picture.segment
    return segment is not None and segment.mode == LoadMode.ADMITTANCE.value and segment.name.endswith("rad/s")


def pushes(picture: Picture) -> bool:
    """Whether any setpoint is not zero, or a body acts."""
    rows, segment = picture.recent.rows(), picture.segment
    if segment is None or segment.procedure != NAME or not len(rows):
        return False
    pushed = segment.mode == LoadMode.TORQUE.value and rows["load_torque_nm"][-1] != 0.0
    acts = segment.mode == LoadMode.ADMITTANCE.value and ", body " in segment.name
    return bool(pushed or acts or rows["command"][-1] != 0.0 or rows["reference_velocity_rad_s"][-1] != 0.0)


def device_rows(picture: Picture, width: int, height: int) -> list[Row]:
    """Each device: its state, the identity that it reports, and its options in the rig file."""
    rows = health_rows(picture, width, height)
    sentences = [line.text.removeprefix(DEVICE) for line in picture.log.lines if line.text.startswith(DEVICE)]
    if sentences:
        rows += [[], heading("Devices", "", "", width)]
    for text in sentences:
        role, _, rest = text.partition(": ")
        rows.append([(role.replace("_", " "), TEXT)])
        rows += [[(f"  {line}", LABEL)] for line in wrap(rest, max(width - 2, 20))]
    return [fitted(row, width) for row in rows][:height]
