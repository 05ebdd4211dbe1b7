"""Mounts the devices of a rig's wiring on the simulated plant."""

from collections.abc import Mapping
from random import Random
from typing import Any

from norton_drivers.errors import WiringError
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.firmware import DRIVERS, start_firmware
from norton_sim.firmware.context import CRYSTAL_PPM, DeviceContext, Wires
from norton_sim.hookup import Hookup, really
from norton_sim.plant import Plant
from norton_sim.plants.assembled import Assembled
from norton_sim.truth import Truth
from norton_sim.world import Timeline, World


def build_world(wiring: Wiring, truth: Truth, place: str, timeline: Timeline | None = None) -> World:
    """The plant that ``wiring`` has devices for: a load that is described but not wired is not coupled.

    It lives in a ``timeline`` that moves it, or in one of its own. Raises WiringError for a wired load or modulator
    whose true values are missing, or which has nothing to modulate.
    """
    if wiring.load is not None and truth.load is None:
        raise WiringError(f"{place}: [load] is wired but [simulated.load] is missing; describe the load machine there")
    if wiring.load is None:
        truth = truth.model_copy(update={"load": None})
    _check_modulator(wiring, truth, place)
    if wiring.modulator is None:
        truth = truth.model_copy(update={"modulator": None})
    return World(Plant(truth, truth.seed, wiring.shaft), timeline)


def _check_modulator(wiring: Wiring, truth: Truth, place: str) -> None:
    if wiring.modulator is None:
        return
    if truth.modulator is None:
        raise WiringError(
            f"{place}: [modulator] is wired but [simulated.modulator] is missing; describe the second drive there"
        )
    if not (isinstance(truth.actuator, Assembled) and truth.actuator.modulated):
        raise WiringError(
            f"{place}: [modulator] is wired but [simulated.actuator] has nothing that it could set; write "
            'model = "variable_stiffness" there'
        )


def mount(world: World, wiring: Wiring, truth: Truth, wires: Wires, place: str) -> None:
    """Start each device's firmware, as it is really set up, plugged in with ``wires``.

    Raises WiringError for a driver nobody emulates, and for a device that cannot be set up as its true values say.
    """
    for rig_settings in wiring.devices():
        settings, hookup = really(rig_settings, _device_truth(truth, rig_settings.role), place)
        if settings.driver not in DRIVERS:
            known = ", ".join(DRIVERS)
            raise WiringError(
                f"[{settings.role}] driver = {settings.driver!r} has no emulated device; the simulator knows {known}"
            )
        try:
            world.devices[settings.role] = start_firmware(_context(world, settings, wiring, truth, wires, hookup))
        except WiringError as error:
            if settings == rig_settings:
                raise
            raise WiringError(f"{place}: [simulated.{settings.role}] device: {error}") from error


def _device_truth(truth: Truth, role: str) -> Mapping[str, Any]:
    described = {
        "actuator": truth.actuator,
        "load": truth.load,
        "torque_sensor": truth.torque_sensor,
        "modulator": truth.modulator,
    }.get(role)
    return {} if described is None else described.device


def _context(
    world: World, settings: DeviceSettings, wiring: Wiring, truth: Truth, wires: Wires, hookup: Hookup
) -> DeviceContext:
    # Seeded by role: adding a device leaves the others as they were.
    random = Random(f"{truth.seed} {settings.role}")
    clock_ppm = random.uniform(-CRYSTAL_PPM, CRYSTAL_PPM)
    return DeviceContext(settings, wiring, world, wires, truth, random, clock_ppm, hookup)
