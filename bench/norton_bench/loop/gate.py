"""The guard of one bench, told what the rig file says and what the devices say of themselves."""

from math import inf

from norton_bench.guard.guard import Equipment, Guard, checks_for
from norton_bench.loop.devices import Devices
from norton_bench.rig.rig import Rig


def guard_for(rig: Rig, devices: Devices) -> Guard:
    """The guard with every plausibility check that the bench has signals for, but those that the rig leaves out."""
    load, sensor, modulator = devices.load, devices.torque_sensor, devices.modulator
    fitted = Equipment(
        load=load is not None,
        torque_sensor=sensor is not None,
        # What is no motor may be a spring: it stands still under its greatest command.
        runs=rig.wiring.shaft == "free" and rig.modelled,
        range_nm=inf if sensor is None else sensor.range_nm,
        resolution_rad=devices.actuator.position_resolution_rad,
        load_resolution_rad=0.0 if load is None else load.position_resolution_rad,
        modulation=rig.modulation,
        modulator_resolution_rad=0.0 if modulator is None else modulator.position_resolution_rad,
    )
    checks = checks_for(rig.limits, rig.command, rig.tick_s, fitted, rig.supervision.leave_out)
    modulation_limit = None if rig.modulation is None else rig.modulation.limit
    return Guard(
        rig.limits,
        rig.command.limit,
        rig.tick_s,
        fitted.load,
        fitted.torque_sensor,
        checks,
        modulation_limit,
        0.0 if rig.wiring.load is None else rig.wiring.load.dead_band,
    )
