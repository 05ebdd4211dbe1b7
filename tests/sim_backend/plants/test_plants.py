"""What each plant does at rest, held and free; how an arm changes its mind; and what breaks on any of them."""

import math

import numpy as np
import pytest

from norton_drivers.errors import WiringError
from norton_sim.plant import Plant
from norton_sim.plants.muscles import BEGAN, REACH_COLUMNS, begin_reach, place
from norton_sim.truth import read_truth, true_parameters
from tests.sim_backend.plants.actuators import ACTUATORS, LOAD, MODULATOR, MOTOR, table_of, truth_of

MS = 1_000_000


def settled(plant: Plant, command: float) -> Plant:
    plant.command("actuator", command)
    plant.advance(plant.now_ns + 3000 * MS)
    return plant


@pytest.mark.parametrize("model", ACTUATORS)
@pytest.mark.parametrize("command", [0.1, 0.25])
def test_the_free_port_rests_at_the_source(model, command):
    smooth = {"output": {"inertia": "5e-5 kg*m^2", "viscous_damping": "5e-3 N*m*s/rad"}}
    truth = truth_of(model, load=None, **smooth)
    plant = settled(Plant(truth, 0), command)
    slack = getattr(getattr(truth.actuator, "backlash", None), "width_rad", 0.0) / 2
    friction = getattr(truth.actuator, "motor", None)
    # What friction at the motor leaves: it may come to rest where its servo pulls with less.
    left = 0.0 if friction is None else friction.coulomb_torque_nm / truth.actuator.servo.stiffness_nm_rad
    assert plant.true_position_rad("actuator") == pytest.approx(
        truth.actuator.source_rad(command), abs=slack + left + 1e-6
    )


@pytest.mark.parametrize("model", ["pneumatic_muscle", "arm"])
def test_the_held_port_exerts_what_the_closed_form_says(model):
    truth = truth_of(model, load=None)
    plant = settled(Plant(truth, 0, "clamped"), 0.2)
    twist_rad = plant.true_position_rad("actuator")
    friction_nm = truth.actuator.output.coulomb_torque_nm
    assert plant.true_port_torque_nm() == pytest.approx(
        truth.actuator.exertion_nm(0.2, twist_rad), abs=friction_nm + 1e-6
    )


def test_a_source_of_the_muscle_is_no_exertion():
    muscle = truth_of("pneumatic_muscle").actuator
    for command in (0.0, 0.01, 0.3, 5.0):
        assert 0 <= muscle.source_rad(command) < math.pi
        assert muscle.exertion_nm(command, muscle.source_rad(command)) == pytest.approx(0.0, abs=1e-9)


def test_a_muscle_cannot_push():
    plant = settled(Plant(truth_of("pneumatic_muscle", load=None), 0), -0.3)
    assert plant.true_position_rad("actuator") == pytest.approx(0.0, abs=1e-9)


def test_backlash_is_a_range_without_exertion():
    """The port is carried slowly through the gap by hand: no torque shows but outside of it."""
    truth = truth_of("gear_train", load=None)
    plant = settled(Plant(truth, 0, "clamped"), 0.0)
    torques, angles = [], np.linspace(-0.03, 0.03, 121)
    for angle in angles:
        plant._state[1, 0] = angle  # the clamp's
        plant.advance(plant.now_ns + 100 * MS)
        torques.append(abs(plant.true_port_torque_nm()))
    free = angles[np.array(torques) < 5e-4]
    assert np.ptp(free) == pytest.approx(truth.actuator.backlash.width_rad, abs=1.5e-3)
    assert max(torques) > 0.05


def test_friction_of_gears_grows_with_what_they_carry():
    """Blocked, and pushed from either side: the hysteresis is that of the motor's friction and of the load's share."""
    held, motor = {}, {**MOTOR, "presliding_stiffness": "400 N*m/rad"}
    for share in ("0", "0.3"):
        found = []
        for before in (-0.05, 0.4):
            truth = truth_of("gear_train", load=None, motor=motor, load_friction=share)
            plant = settled(Plant(truth, 0, "clamped"), before)
            for command in np.linspace(before, 0.15, 500):
                plant.command("actuator", command)
                plant.advance(plant.now_ns + 2 * MS)
            found.append(plant.true_port_torque_nm())
        held[share] = found[1] - found[0]
    assert held["0.3"] > held["0"] + 0.2


def test_a_reach_that_is_redirected_goes_on_smoothly_to_the_new_place():
    reach = np.zeros(REACH_COLUMNS)
    reach[BEGAN] = -math.inf
    begin_reach(reach, 1.0, 0.0, 0.5)
    before = place(reach, 0.2, 0.5)
    begin_reach(reach, -0.4, 0.2, 0.5)
    assert place(reach, 0.2, 0.5) == pytest.approx(before)
    assert place(reach, 0.7 - 1e-9, 0.5) == pytest.approx((-0.4, 0.0, 0.0), abs=1e-5)
    assert place(reach, 5.0, 0.5) == (-0.4, 0.0, 0.0)
    speeds = np.diff([place(reach, t, 0.5)[0] for t in np.arange(0.2, 0.7, 1e-4)]) / 1e-4
    assert speeds == pytest.approx([place(reach, t + 5e-5, 0.5)[1] for t in np.arange(0.2, 0.6999, 1e-4)], abs=1e-3)


@pytest.mark.parametrize("modulation", [0.0, 2.0, 9.0])
def test_a_variable_spring_exerts_what_the_closed_form_says_and_rests_at_one_source(modulation):
    """9 is beyond its stop. The motor hardly rubs, or friction would hold it beside the closed form."""
    motor = {**MOTOR, "coulomb_torque": "0.01 mN*m", "presliding_stiffness": "0.1 N*m/rad"}
    truth = truth_of("variable_stiffness", load=None, modulator=MODULATOR, motor=motor)
    for shaft in ("clamped", "free"):
        plant = Plant(truth, 0, shaft)
        plant.command("modulator", modulation)
        place_rad = settled(plant, 0.2).true_position_rad("actuator")
        stiffness_motor_rad = truth.modulator.angle_rad(modulation)
        expected_nm = truth.actuator.exertion_nm(0.2, place_rad, stiffness_motor_rad)
        assert plant.true_port_torque_nm() == pytest.approx(expected_nm, abs=3e-5)
    assert place_rad == pytest.approx(truth.actuator.source_rad(0.2), abs=1e-5)
    assert plant.encoder_position_rad("modulator") == pytest.approx(
        min(stiffness_motor_rad, truth.actuator.spring.stop_rad), abs=1e-3
    )


def test_a_modulator_without_power_lets_go_at_its_own_pace():
    plant = Plant(truth_of("variable_stiffness", modulator=MODULATOR), 0)
    plant.command("modulator", 4.0)
    plant.advance(1000 * MS)
    plant.release("modulator")
    plant.advance(1025 * MS)
    assert 0.2 < plant.true_position_rad("modulator") / 0.8 < 0.5
    plant.advance(2000 * MS)
    assert plant.true_position_rad("modulator") == pytest.approx(0.0, abs=1e-6)


def test_an_arm_without_power_stays_where_it_was_going():
    plant = settled(Plant(truth_of("arm", load=None), 0), 0.3)
    plant.release("actuator")
    plant.advance(plant.now_ns + 1000 * MS)
    assert plant.true_position_rad("actuator") == pytest.approx(0.3, abs=1e-3)


def test_a_servo_without_power_lets_go():
    plant = settled(Plant(truth_of("series_elastic"), 0), 0.3)
    plant.release("actuator")
    plant.command("load", -0.08)
    plant.advance(plant.now_ns + 500 * MS)
    assert plant.true_position_rad("actuator") < 0.2


@pytest.mark.parametrize("model", ACTUATORS)
def test_what_breaks_on_a_motor_breaks_here(model):
    plant = Plant(truth_of(model), 0)
    plant.jam("actuator")
    settled(plant, 0.2)
    assert plant.true_position_rad("actuator") == 0.0
    plant.free("actuator")
    plant.advance(plant.now_ns + 1000 * MS)
    assert plant.true_position_rad("actuator") > 0.01
    plant.uncouple()
    assert plant.true_port_torque_nm() == 0.0
    here = plant.true_position_rad("actuator")
    plant.run_away("actuator", 0.1)
    plant.advance(plant.now_ns + 500 * MS)
    assert plant.true_position_rad("actuator") != pytest.approx(here, abs=1e-3)


@pytest.mark.parametrize("model", ACTUATORS)
def test_the_same_calls_give_the_same_bits(model):
    rows = []
    for _ in range(2):
        plant = Plant(truth_of(model), 5)
        for tick in range(1, 200):
            plant.command("actuator", 0.2 * math.sin(tick / 30))
            plant.advance(tick * MS)
        rows.append(plant._state.tobytes())
    assert rows[0] == rows[1]


@pytest.mark.parametrize("mounted", [1, -1])
@pytest.mark.parametrize("model", ["series_elastic", "arm"])
def test_mounted_the_other_way_round_everything_is_a_mirror(model, mounted):
    plant = settled(Plant(truth_of(model, load=None, mounted=mounted), 0), 0.2)
    assert plant.true_position_rad("actuator") * mounted > 0.15
    assert plant.encoder_position_rad("actuator") > 0.15


def test_true_values_are_told_with_their_units():
    told = true_parameters(truth_of("gear_train"), "rad")
    assert told["backlash_width"] == (pytest.approx(0.02), "rad")
    assert told["motor_inertia"] == (pytest.approx(2e-4), "kg*m^2")
    assert told["amplifier_gain"] == (10.0, "A/(rad)")


def test_a_torque_motor_behind_a_joint_has_the_identifiers_names_too():
    told = true_parameters(truth_of("gear_train", servo=None, load_friction=0.05), "rad")
    named = ("inertia", "joint_stiffness", "joint_damping", "output_inertia", "backlash_width", "load_friction")
    assert [told[name][0] for name in named[:1]] == [told["motor_inertia"][0]]
    assert told["joint_stiffness"] == told["backlash_stiffness"]
    assert told["torque_gain"] == (pytest.approx(10.0 * told["torque_constant"][0]), "N*m/(rad)")
    assert all(name in told for name in named)
    spring = true_parameters(truth_of("series_elastic", servo=None), "rad")
    assert spring["joint_stiffness"] == spring["spring_stiffness"]
    assert "backlash_width" not in spring
    assert "joint_stiffness" not in true_parameters(truth_of("series_elastic"), "rad")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"spring": None}, "[simulated.actuator] spring is missing; add spring = "),
        ({"output": None}, "[simulated.actuator] output is missing; add a table [simulated.actuator.output]"),
        ({"torque_constant": "1 N*m/A"}, "[simulated.actuator] torque_constant is not known; known here: "),
        (
            {"output": {"inertia": "1e-4 kg*m^2", "coulomb_torque": "1 mN*m"}},
            "[simulated.actuator] output: coulomb_torque and presliding_stiffness belong together; add",
        ),
        ({"output": {"inertia": "1 N*m"}}, '[simulated.actuator.output] inertia: "1 N*m" is not in kg*m^2'),
        ({"output": 3}, "[simulated.actuator] output should be a table of its own: write [simulated.actuator.output]"),
    ],
)
def test_a_mistake_is_told_with_place_and_mend(changes, sentence):
    written = {"actuator": table_of("pneumatic_muscle", **changes), "load": LOAD}
    with pytest.raises(WiringError) as refused:
        read_truth(written, seed=None, place="rig.toml", command_unit="N*m/rad")
    assert str(refused.value).startswith(f"rig.toml: {sentence}")


def test_a_spring_that_cannot_stiffen_is_refused():
    spring = {"stiffness": "3 N*m/rad", "stiffening": "5 N*m/rad^2", "stiffest": "2 N*m/rad"}
    written = {"actuator": table_of("variable_stiffness", spring=spring)}
    with pytest.raises(WiringError, match="stiffest must be above stiffness = 3 N\\*m/rad; raise it"):
        read_truth(written, seed=None, place="rig.toml", command_unit="rad")


def test_what_a_modulator_is_told_is_in_the_rigs_unit():
    written = {"actuator": table_of("variable_stiffness"), "modulator": {**MODULATOR, "travel": "1 rad/N"}}
    with pytest.raises(WiringError, match=r'\[simulated.modulator\] travel: "1 rad/N" is not in rad/\(N\*m/rad\)'):
        read_truth(written, seed=None, place="rig.toml", command_unit="rad", modulation_unit="N*m/rad")
    told = true_parameters(truth_of("variable_stiffness", modulator=MODULATOR), "rad")
    assert told["modulator_travel"] == (0.2, "rad/(N*m/rad)")
    assert told["spring_stiffening"] == (5.0, "N*m/rad^2")
