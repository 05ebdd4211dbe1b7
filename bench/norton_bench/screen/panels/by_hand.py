"""The bench moved by hand: setpoints, bounds, keys, and devices."""

from dataclasses import dataclass
from textwrap import wrap

from norton_bench.jog.hands import DEVICE, Bounds
from norton_bench.jog.script import NAME
from norton_bench.report.words import pretty_unit
from norton_bench.screen.panels.health import health_rows
from norton_bench.screen.picture.picture import Picture
from norton_bench.screen.styles import LABEL, STRONG, TEXT, UNIT, WARNING, Row, apart, fitted, heading
from norton_bench.segments import LoadMode

READY = "Nothing moves yet: s enables the drives at zero."
NAME_WIDTH = 10
KEYS = (
    ("space", "stops at once, from anywhere"),
    ("↑ ↓", "the actuator's command"),
    ("→ ←", "the load's torque or velocity"),
    ("c t v z", "the load coasts, pushes, turns, keeps the port at zero torque"),
    ("+ -", "size of a step"),
    ("0", "everything back to zero"),
    ("?", "all keys"),
)
OPENING = " opening the devices; the very first run compiles for a while"
OVER = "The drives are idle. s enables them again."
LOAD_KEYS = "; load: c coast  t torque  v velocity  z zero torque"
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
    rows = [heading("Limits", "", "", width), *(_fact(name, text) for name, text in facts.items() if text)]
    rows += [[], heading("Keys", "", "", width), *(_fact(*each) for each in KEYS if has_load or "load" not in each[1])]
    return [fitted(row, width) for row in rows][:height]


def _fact(name: str, text: str) -> Row:
    return [(f"{name:<{NAME_WIDTH}}", STRONG), (text, LABEL)]


def asked_rows(picture: Picture, bounds: Bounds, asking: Asking, width: int, *, live: bool) -> list[Row]:
    """Two rows: the setpoints and the size of a step; and what happens next without a key."""
    segment, step = picture.segment, f"step {asking.share * 100:g} %: {_sizes(picture, bounds, asking.share)}"
    if not live:
        return [apart([(f" {OVER if picture.summary else READY}", TEXT)], [(f"{step} ", LABEL)], width)]
    if segment is None:
        return [apart([(OPENING, TEXT)], [(f"{step} ", LABEL)], width)]
    doing = segment.name.replace("*", "·") if segment.procedure == NAME else f"{segment.procedure}: {segment.name}"
    rows = [apart([(" setpoints  ", UNIT), (doing, STRONG)], [(f"{step} ", LABEL)], width)]
    end = f" torques off at {bounds.speed_rad_s:.4g} rad/s"
    if asking.left_s is None:
        return [*rows, [(end + (LOAD_KEYS if picture.rig.wiring.load is not None else ""), LABEL)]]
    style = WARNING if asking.left_s < BEFORE_ZERO_S else LABEL
    return [*rows, [(f"{end}; without a key all returns to zero in ", LABEL), (f"{asking.left_s:.0f} s", style)]]


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
    """Whether any setpoint is not zero."""
    rows, segment = picture.recent.rows(), picture.segment
    if segment is None or segment.procedure != NAME or not len(rows):
        return False
    pushed = segment.mode == LoadMode.TORQUE.value and rows["load_torque_nm"][-1] != 0.0
    return bool(pushed or rows["command"][-1] != 0.0 or rows["reference_velocity_rad_s"][-1] != 0.0)


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
