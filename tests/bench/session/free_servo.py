"""A servo whose shaft is free: the simulated plant itself, and what MuJoCo makes of an exported network."""

from dataclasses import replace

import can
import numpy as np
import pytest

from norton_bench.models.network import NortonNetwork
from norton_bench.networks.export.mjcf import export_mjcf
from norton_bench.rig.rig import Rig
from norton_drivers.codecs.mit import Special, goal_value
from norton_drivers.mit import MitOptions
from norton_drivers.registry import load_backend
from norton_drivers.spoken_to.goals import Goals


def true_places(rig: Rig, asked: np.ndarray) -> np.ndarray:
    """Where the shaft of the simulated plant is at each tick, its drive told by frames that take no time."""
    wiring = replace(rig.wiring, load=None, torque_sensor=None)
    simulated = {**rig.simulated, "transport": dict.fromkeys(("can_delay", "can_jitter"), "0 us")}
    backend = load_backend("simulated")(wiring, simulated, seed=7, place=rig.place)
    options = MitOptions.model_validate(rig.wiring.actuator.options)
    assert rig.servo is not None
    bus, world = backend.open_can(wiring.buses[0]).bus, backend.world
    told = Goals(options.ranges, rig.servo, goal_value)
    bus.send(can.Message(arbitration_id=options.node, data=Special.ENABLE.encode(), is_extended_id=False))
    places = []
    for command in asked:
        frame, _ = told.frame(float(command), world.now_ns)
        bus.send(can.Message(arbitration_id=options.node, data=frame, is_extended_id=False))
        places.append(world.plant.true_position_rad("actuator"))
        world.advance(world.now_ns + rig.tick_ns)
    backend.close()
    return np.array(places)


def motion_in_mujoco(network: NortonNetwork, asked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle and velocity at each millisecond under these commands, (n,) each; skips the test without MuJoCo."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(export_mjcf(network, "servo").text)
    data, places, velocities = mujoco.MjData(model), [], []
    for command in asked:
        places.append(data.qpos[0])
        velocities.append(data.qvel[0])
        data.ctrl[0] = command
        for _ in range(round(1e-3 / model.opt.timestep)):
            mujoco.mj_step(model, data)
    return np.array(places), np.array(velocities)
