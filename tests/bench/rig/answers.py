"""What somebody answers to ``rig new``, for every drive and every torque sensor that is shipped."""

COMMON = {
    "load.driver": "odrive",
    "load.node": "2",
    "load.torque_limit": "1 N*m",
    "bus.can0.channel": "can0",
    "limits.torque": "1 N*m",
    "limits.velocity": "60 rad/s",
}
CIA402 = {"torque_per_unit": "0.5 mN*m", "counts_per_turn": "131072", "velocity_per_unit": "0.001 rpm"}
MIT = {"position_range": "12.5 rad", "velocity_range": "80 rad/s", "torque_range": "2 N*m", "beyond_range": "wraps"}
DAMIAO = {"master": "21", "beyond_range": "wraps", "velocity_range": "80 rad/s", "torque_range": "2 N*m"}
ROBSTRIDE = {"motor": "rs05", "beyond_range": "wraps", "velocity_range": "80 rad/s"}
CUBEMARS = {"pole_pairs": "21", "gear_ratio": "1", "beyond_range": "wraps"}
# What each needs beyond its driver: as actuator with its command, and as load.
ACTUATORS = {
    "odrive": {"node": "5", "command": "0.5 N*m"},
    "cia402": {"node": "5", "command": "0.5 N*m", **CIA402},
    "mit": {"node": "5", "command": "0.5 N*m", **MIT},
    "moteus": {"node": "5", "command": "0.5 N*m"},
    "vesc": {"node": "5", "pole_pairs": "7", "command": "9 A"},
    "dynamixel": {"node": "5", "port": "/dev/ttyUSB1", "type": "XM430-W350", "command": "1 A"},
    "feetech": {"node": "5", "port": "/dev/ttyUSB1", "type": "STS3215", "command": "0.5"},
    "vesc torque": {"node": "5", "pole_pairs": "7", "mode": "torque", "torque_constant": "0.06 N*m/A",
                    "command": "0.5 N*m"},
    "damiao": {"node": "5", "command": "0.5 N*m", **DAMIAO},
    "robstride": {"node": "5", "command": "0.5 N*m", **ROBSTRIDE},
    "cubemars": {"node": "5", "command": "9 A", **CUBEMARS},
}  # fmt: skip
LOADS = {
    "odrive": {"node": "2"},
    "dynamixel": {"node": "2", "port": "/dev/ttyUSB1", "type": "XM430-W350", "torque_constant": "1.8 N*m/A"},
    "feetech": {"node": "2", "port": "/dev/ttyUSB1", "type": "STS3215", "stall_torque": "1.9 N*m"},
    "cia402": {"node": "2", **CIA402},
    "mit": {"node": "2", **MIT},
    "moteus": {"node": "2"},
    "vesc": {"node": "2", "pole_pairs": "7", "torque_constant": "0.06 N*m/A"},
    "damiao": {"node": "2", **DAMIAO},
    "robstride": {"node": "2", **ROBSTRIDE},
    "cubemars": {"node": "2", "torque_constant": "0.06 N*m/A", **CUBEMARS},
}
SENSORS = {
    "bota": {"port": "/dev/ttyUSB0"},
    "dbc": {},
    "canopen": {"node": "7", "scale": "0.1 mN*m", "heartbeat": "10 ms"},
    "dyn200": {"port": "/dev/ttyUSB0", "mode": "push", "torque_per_digit": "1 mN*m"},
    "dyn200 polled": {"port": "/dev/ttyUSB0", "mode": "polled", "torque_per_digit": "1 mN*m"},
    "ascii": {"port": "/dev/ttyUSB0", "scale": "1"},
    "mantracourt": {"port": "/dev/ttyUSB0", "scale": "1", "averaging": "2 ms"},
    "none": {},
}

COMBINATIONS = [
    *((actuator, "odrive", "bota") for actuator in ACTUATORS),
    *(("odrive", load, "bota") for load in LOADS if load != "odrive"),
    *(("odrive", "odrive", sensor) for sensor in SENSORS if sensor != "bota"),
    ("vesc", "vesc", "dbc"),
    ("feetech", "feetech", "bota"),
    ("cia402", "cia402", "canopen"),
    ("mit", "mit", "mantracourt"),
]


def answers(actuator: str = "odrive", load: str = "odrive", sensor: str = "bota") -> dict[str, str]:
    """Of a dynamometer with these devices."""
    given = dict(COMMON)
    for role, kind, needs in (
        ("actuator", actuator, ACTUATORS[actuator]),
        ("load", load, LOADS[load]),
        ("torque_sensor", sensor, SENSORS[sensor]),
    ):
        given[f"{role}.driver"] = kind.partition(" ")[0]
        given |= {f"{role}.{key}": value for key, value in needs.items()}
    if {actuator, load} & {"dynamixel", "feetech"}:
        given["rig.rate"] = "400 Hz"  # what their line carries
    if sensor == "none":
        del given["limits.torque"]
    return given
