"""A shipped rig at half its rate: for what moves slowly it tells as much, in two thirds of the time."""

from pathlib import Path

from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig

RIGS = Path(__file__).parents[2] / "rigs"
# The one line of a rig file that changes.
HALF_RATE = {'rate = "1 kHz"': 'rate = "500 Hz"'}


def half_rate(name: str) -> Rig:
    """The rig file of that name, with 500 ticks a second; its devices send as often as they do."""
    return parse_rig(half_rate_text(name), place=str(RIGS / f"{name}.toml"))


def low_rate(name: str) -> Rig:
    """With 400 ticks a second: below, the load drive can hardly be calibrated."""
    text = half_rate_text(name).replace('rate = "500 Hz"', 'rate = "400 Hz"')
    return parse_rig(text, place=str(RIGS / f"{name}.toml"))


def half_rate_text(name: str) -> str:
    text = (RIGS / f"{name}.toml").read_text(encoding="utf-8")
    for whole, half in HALF_RATE.items():
        assert text.count(whole) == 1
        text = text.replace(whole, half)
    return text
