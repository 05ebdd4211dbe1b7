"""Logs of several joints: one is chosen by its name, in the map, on the command line, and without a map."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.logs.column_map import parse_map
from norton_bench.logs.column_names import joints_of, kind_of_column
from norton_bench.logs.files import Content
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.joints import with_joint
from norton_bench.logs.log import read_log
from norton_bench.logs.propose import propose
from tests.bench.logs.bags import EPOCH_NS, JOINTS, TRUE, Message, joint_state, moved, robot, write_bag
from tests.bench.logs.machines import Columns, column_map, estimate, write_csv

MAP = """
[log]
motion = "rotation"
[columns]
time = { name = "t", unit = "s" }
position = { name = "{joint}_pos", unit = "rad" }
exertion = { name = "{joint}_tau", unit = "N*m" }
[load]
inertia = { key = "{joint}_inertia", unit = "kg*m^2", optional = true }
[model]
candidates = ["coulomb-viscous"]
"""


def table() -> Columns:
    """Both joints, as a table with units behind some names."""
    columns: Columns = {"t": moved("elbow")[0]}
    for joint in JOINTS:
        time_s, position, velocity = moved(joint)
        columns |= {
            f"{joint}_pos [rad]": position,
            f"{joint}_vel": velocity,
            f"{joint}_tau": -TRUE[joint].force(time_s),
        }
    return columns


def content(*names: str, streams: bool = False) -> Content:
    columns = {name: np.arange(3.0) for name in names}
    return Content("log", columns, {}, {}, (), columns if streams else {})


@pytest.mark.parametrize("joint", JOINTS)
def test_a_joint_is_chosen_for_a_map_of_all(tmp_path: Path, joint: str) -> None:
    path = write_csv(tmp_path / "log.csv", table())
    fit = fit_logs(Request((path,), with_joint(column_map(MAP), joint)))
    assert estimate(fit, "inertia").value == pytest.approx(TRUE[joint].inertia, rel=0.02)
    assert estimate(fit, "viscous_damping").value == pytest.approx(TRUE[joint].damping, rel=0.02)
    in_map = column_map(MAP.replace("[columns]", f'joint = "{joint}"\n[columns]'))
    np.testing.assert_array_equal(
        read_log(path, in_map).columns["position"],
        read_log(path, with_joint(column_map(MAP), joint)).columns["position"],
    )


def test_the_command_line_overrides_the_map(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", table())
    in_map = column_map(MAP.replace("[columns]", 'joint = "shoulder"\n[columns]'))
    position = read_log(path, with_joint(in_map, "elbow")).columns["position"]
    np.testing.assert_allclose(position, moved("elbow")[1], atol=1e-9)


def test_without_a_choice_the_joints_are_listed(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", table())
    with pytest.raises(UsageError, match=r"holds several joints \(shoulder, elbow\); choose one: --joint NAME"):
        read_log(path, column_map(MAP))
    with pytest.raises(UsageError, match='holds no joint "elbo"; did you mean "elbow"'):
        read_log(path, with_joint(column_map(MAP), "elbo"))
    with pytest.raises(UsageError, match="no column is of a joint as the map names them"):
        read_log(path, column_map(MAP.replace("{joint}_", "{joint}-")))
    with pytest.raises(UsageError, match=r"--joint: no name in map.toml has \{joint\} in it"):
        with_joint(column_map(MAP.replace("{joint}", "elbow")), "elbow")


def test_the_only_joint_needs_no_choice(tmp_path: Path) -> None:
    columns = {name: values for name, values in table().items() if not name.startswith("shoulder")}
    log = read_log(write_csv(tmp_path / "log.csv", columns), column_map(MAP))
    assert any('the joint is "elbow", the only one' in said for said in log.remarks)


WAYS: dict[str, tuple[tuple[str, ...], bool, tuple[str, ...]]] = {
    "joint states": (
        ("/js/position[left/elbow [2]]", "/js/position[hip]", "/w/torque/z"),
        True,
        ("left/elbow [2]", "hip"),
    ),
    "one joint": (("/js/position[hip]", "/js/effort[hip]", "/js/log_time"), True, ("hip",)),
    "interfaces": (("/a/values[hip]/values[position]", "/a/values[hip]/values[effort]"), True, ("hip",)),
    "PlotJuggler": (
        ("__time", "/a/position", "/a/velocity", "/b/position", "/b/velocity"),
        False,
        ("a", "b"),
    ),
    "before": (("t", "left_elbow_pos", "left_elbow_tau_nm", "hip_pos", "hip_tau_nm"), False, ("left_elbow", "hip")),
    "behind": (("t", "pos_a [rad]", "tau_a [Nm]", "pos_b [rad]", "tau_b [Nm]"), False, ("a", "b")),
    "numbers": (("t", "q1", "q2", "u1", "u2"), False, ("1", "2")),
    "matrices": (("t", "q[0]", "q[1]", "tau[0]", "tau[1]"), False, ("0", "1")),
    "a motor and its load": (("t", "motor_position", "load_position", "motor_torque"), False, ()),
    "two words": (("t", "hip_torque", "hip_torque_command", "hip_q", "knee_torque", "knee_q"), False, ("hip", "knee")),
    "a goal and a command": (("time", "position_goal", "position", "torque_command", "torque"), False, ()),
    "units": (("t [s]", "position [rad]", "torque [Nm]"), False, ()),
}


@pytest.mark.parametrize("way", WAYS)
def test_joints_are_found_by_the_ways_of_naming_columns(way: str) -> None:
    names, streams, joints = WAYS[way]
    found = joints_of(content(*names, streams=streams))
    assert tuple(found) == joints
    for joint, columns in found.items():
        for name, template in columns.items():
            assert name.startswith(template.replace("{joint}", joint))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("/wrench/wrench/torque/z", "exertion"),
        ("/current/data", "command"),
        ("/imu/orientation/w", None),
        ("/js/position[]", "position"),
        ("x", "position"),
    ],
)
def test_what_a_name_tells(name: str, kind: str | None) -> None:
    assert kind_of_column(name) == kind


@pytest.mark.long
def test_a_proposal_asks_for_a_joint_and_serves_for_all(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", table())
    with pytest.raises(UsageError, match=r"several joints \(shoulder, elbow\); choose one: --joint NAME"):
        propose(path)
    with pytest.raises(UsageError, match=r'no joint "wrist" \(--joint\); known: elbow, shoulder'):
        propose(path, "wrist")
    text, _ = propose(path, "elbow")
    proposed = parse_map(text, place="proposed")
    assert proposed.log.joint == "elbow"
    assert proposed.columns.position is not None
    assert proposed.columns.position.name == "{joint}_pos"
    assert proposed.columns.velocity is not None
    assert proposed.columns.velocity.unit == "rad/s"
    fit = fit_logs(Request((path,), with_joint(proposed, "shoulder"), model="coulomb-viscous"))
    assert estimate(fit, "inertia").value == pytest.approx(TRUE["shoulder"].inertia, rel=0.02)


@pytest.mark.long
def test_a_bag_with_a_sensor_is_proposed_with_it(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "bag", robot(wrench_hz=400.0))
    text, said = propose(folder, "elbow")
    assert 'exertion = { name = "/wrench/wrench/torque/z", unit = "N*m" }' in text
    assert 'position = { name = "/joint_states/position[{joint}]", unit = "rad" }' in text
    assert "time" not in text.partition("[columns]")[2]
    assert not any("force" in sentence for sentence in said)
    fit = fit_logs(Request((folder,), parse_map(text, place="proposed"), model="coulomb-viscous"))
    assert estimate(fit, "inertia").value == pytest.approx(TRUE["elbow"].inertia, rel=0.02)


@pytest.mark.long
def test_the_effort_of_joint_states_is_what_the_drive_exerts(tmp_path: Path) -> None:
    rows: list[Message] = []
    for row, time_s in enumerate(moved("elbow")[0]):
        stamp_ns = EPOCH_NS + round(time_s * 1e9)
        state = joint_state(stamp_ns, JOINTS, row)
        effort = np.array([TRUE[joint].force(np.array(time_s)) for joint in JOINTS])
        rows.append(("/joint_states", "sensor_msgs/msg/JointState", stamp_ns, replace(state, effort=effort)))
    folder = write_bag(tmp_path / "bag", rows)
    text, said = propose(folder, "elbow")
    assert 'command = { name = "/joint_states/effort[{joint}]", unit = "N*m" }' in text
    assert "torque_gain = 1 " in text
    assert any("is taken to be the torque of the drive at the joint" in sentence for sentence in said)
    for joint in JOINTS:
        one = with_joint(parse_map(text, place="proposed"), joint)
        fit = fit_logs(Request((folder,), one, model="coulomb-viscous"))
        assert estimate(fit, "inertia").value == pytest.approx(TRUE[joint].inertia, rel=0.02)
        assert estimate(fit, "coulomb_torque").value == pytest.approx(TRUE[joint].coulomb, rel=0.05)
