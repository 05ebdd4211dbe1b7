"""One tick as it was played: what it saw, what it decided and when, and its row in the recording."""

from math import nan
from typing import NamedTuple

from bench.guard.commands import Commands, DriveHealth
from bench.loop.load_strategy import LoadStrategy
from bench.sample import Sample


class Stages(NamedTuple):
    """When a tick began, and when each of its stages was done."""

    begun_ns: int
    received_ns: int
    controlled_ns: int
    guarded_ns: int
    sent_ns: int


class Played(NamedTuple):
    """``seen`` is what the controller saw, ``sample`` what the guard did; ``commands`` is what the wires carried.

    ``number`` counts the segment's ticks; ``begins``: the first that was run; ``missed`` ticks before it were not.
    """

    deadline_ns: int
    stages: Stages
    sample: Sample
    seen: Sample
    wish: Commands
    commands: Commands
    drives: tuple[DriveHealth, ...]
    strategy: LoadStrategy
    number: int
    begins: bool
    missed: int


def tick_row(played: Played, segment: int, put_ns: int, fitted: tuple[bool, bool]) -> tuple[float, ...]:
    """In the order of TICK. ``put_ns`` is what the tick before took to be put away; ``fitted``: a load, a modulator."""
    deadline_ns, stages, sample, _, wish, commands, drives, strategy, number, _, _ = played
    begun_ns, received_ns, controlled_ns, guarded_ns, sent_ns = stages
    target = strategy.target(number)
    has_load, has_modulator = fitted
    return (
        deadline_ns,
        begun_ns - deadline_ns,
        sent_ns - begun_ns,
        segment,
        commands.command,
        wish.load_torque_nm,
        commands.load_torque_nm,
        sample.torque_nm,
        sample.torque_age_ns,
        sample.position_rad,
        sample.velocity_rad_s,
        sample.motion_age_ns,
        sample.load_position_rad,
        sample.load_velocity_rad_s,
        sample.load_motion_age_ns,
        target.position_rad,
        target.velocity_rad_s,
        drives[0].status.transistor_temperature_c,
        drives[1].status.transistor_temperature_c if has_load else nan,
        commands.limited,
        max(received_ns - begun_ns, 0),
        controlled_ns - received_ns,
        guarded_ns - controlled_ns,
        sent_ns - guarded_ns,
        put_ns,
        commands.modulation,
        sample.modulator_position_rad,
        sample.modulator_motion_age_ns,
        drives[-1].status.transistor_temperature_c if has_modulator else nan,
    )
