"""Session files: steps become options in SI, and every mistake is told with its place and the mend."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from norton_bench.errors import ExitCode, RigError, UsageError
from norton_bench.procedures.catalogue import CATALOGUE
from norton_bench.procedures.modulated import ModulatedProcedure
from norton_bench.procedures.options import STEPS, FreeOptions, ImposedOptions, RestOptions, TareOptions
from norton_bench.procedures.tare import RestProcedure
from norton_bench.rig.files import keys_of, toml
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.program import make_experiment
from norton_bench.session.schema import load_session, parse_session, standard_session

ROOT = Path(__file__).parents[3]
SESSIONS = sorted((ROOT / "sessions").glob("*.toml"))


def test_steps_become_options_in_si() -> None:
    session = parse_session(
        'rig = "../rigs/a.toml"\nseed = 4\n'
        '[[step]]\ndo = "tare"\n'
        '[[step]]\ndo = "free"\namplitude = "40 %"\nlevels = 7\ndwell = "300 ms"\n'
        '[[step]]\ndo = "imposed"\nvelocities = "-20:10:20 rad/s"\nduration = "0.5 min"\n',
        place="sessions/s.toml",
    )
    assert session.rig == Path("sessions/../rigs/a.toml")
    assert session.seed == 4
    assert [step.do for step in session.steps] == ["tare", "free", "imposed"]
    tare, free, imposed = (step.options for step in session.steps)
    assert tare == TareOptions()
    assert free == FreeOptions(amplitude=0.4, levels=7, dwell_s=0.3)
    assert imposed == ImposedOptions(velocities_rad_s=(-20, -10, 0, 10, 20), duration_s=30)


def test_velocities_may_be_listed() -> None:
    session = parse_session('[[step]]\ndo = "imposed"\nvelocities = ["60 rpm", "-1 rad/s"]\n', place="s")
    (step,) = session.steps
    assert isinstance(step.options, ImposedOptions)
    assert step.options.velocities_rad_s == (pytest.approx(6.283185307), -1)


@pytest.mark.parametrize("name", STEPS)
def test_what_a_file_leaves_out_is_as_the_procedure_has_it(name: str) -> None:
    (step,) = parse_session(f'[[step]]\ndo = "{name}"\n', place="s").steps
    assert step.options == STEPS[name]()


@pytest.mark.parametrize("name", STEPS)
def test_every_option_may_be_written_as_its_example_says(name: str) -> None:
    keys = keys_of(STEPS[name])
    lines = "".join(f"{key} = {toml(info.examples[0])}\n" for key, info in keys.items() if info.examples)
    (step,) = parse_session(f'[[step]]\ndo = "{name}"\n{lines}', place="s").steps
    assert set(step.options.model_fields_set) == set(STEPS[name].model_fields)


def test_a_program_gives_numbers_and_a_file_quantities() -> None:
    assert RestOptions(duration_s=2.5).duration_s == 2.5
    with pytest.raises(UsageError, match=r'duration: "2.5" has no unit; write it like'):
        parse_session('[[step]]\ndo = "rest"\nduration = 2.5\n', place="s")
    with pytest.raises(UsageError, match=r'duration_s: unknown key; did you mean "duration"'):
        parse_session('[[step]]\ndo = "rest"\nduration_s = "2.5 s"\n', place="s")
    with pytest.raises(ValidationError, match="greater than or equal to"):
        RestOptions(duration_s=0.0)


def test_every_procedure_has_its_step() -> None:
    assert set(STEPS) == set(CATALOGUE)


VARIABLE = load_rig(ROOT / "rigs" / "sim-variable-stiffness.toml")
REST = '[[step]]\ndo = "rest"\nduration = "2 s"\n'


@pytest.mark.parametrize(
    ("written", "modulations"),
    [
        ('"2 N*m/rad"', (2.0,)),
        ('["0 N*m/rad", "3 mN*m/mrad"]', (0.0, 3.0)),
        ("[]", ()),
    ],
)
def test_a_step_may_run_under_modulations(written: str, modulations: tuple[float, ...]) -> None:
    session = parse_session(f"{REST}modulation = {written}\n", place="s.toml")
    (step,) = make_experiment(session, VARIABLE).plan
    held = ModulatedProcedure(RestProcedure(RestOptions(duration_s=2.0)), modulations)
    assert step.duration_s == (held.duration_s(VARIABLE) if modulations else 2.0)
    assert ("modulation" in step.label) == bool(modulations)


def test_a_modulation_may_be_swept() -> None:
    text = REST + 'for = { k = ["0 N*m/rad", "2 N*m/rad"] }\nmodulation = "$k"\n'
    assert [step.modulations for step in parse_session(text, place="s.toml").every_step()] == [
        ("0 N*m/rad",),
        ("2 N*m/rad",),
    ]


@pytest.mark.parametrize(
    ("rig", "text", "said"),
    [
        (VARIABLE, "modulation = 2\n", "s.toml: [step 1, rest] modulation: 2 is not a quantity; write it like"),
        (VARIABLE, 'modulation = ["1 N*m/rad", 2]\n', 's.toml: [step 1, rest] modulation: ["1 N*m/rad", 2] is not a'),
        (VARIABLE, 'modulation = "2 rad"\n', 's.toml: [step 1, rest]: modulation: "2 rad" is not in N*m/rad'),
        (
            VARIABLE,
            'modulation = "5 N*m/rad"\n',
            "step 'rest' asks for a modulation of 5 N*m/rad, outside of [modulator",
        ),
        (None, 'modulation = "2 N*m/rad"\n', "step 'rest' names a modulation, but no drive sets the actuator's imped"),
    ],
)
def test_a_modulation_that_cannot_be_is_told(rig: Rig | None, text: str, said: str) -> None:
    with pytest.raises((UsageError, RigError)) as refused:
        make_experiment(parse_session(REST + text, place="s.toml"), rig or load_rig(ROOT / "rigs" / "sim-odrive.toml"))
    assert said in str(refused.value)


def test_the_standard_session_tabulates_at_three_modulations() -> None:
    steps = {step.do: step.modulations for step in standard_session(VARIABLE).every_step()}
    three = ("0 N*m/rad", "2 N*m/rad", "4 N*m/rad")
    assert steps == {"tare": (), "calibrate": (), "tabulate_source": three, "tabulate_impedance": three}


@pytest.mark.parametrize("path", SESSIONS, ids=lambda path: path.stem)
def test_the_sessions_that_are_shipped_can_run(path: Path) -> None:
    session = load_session(path)
    assert session.rig is not None
    rig = load_rig(session.rig)
    assert len(make_experiment(session, rig).plan) >= len(session.steps)


@pytest.mark.parametrize("path", sorted((ROOT / "rigs").glob("*.toml")), ids=lambda path: path.stem)
def test_the_standard_session_suits_every_rig(path: Path) -> None:
    rig = load_rig(path)
    session = standard_session(rig)
    assert [step.name for step in make_experiment(session, rig).plan] == [step.do for step in session.every_step()]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", 's.toml: [[step]]: there is no step; add a section [[step]], in double brackets, with do = "tare"'),
        ('[step]\ndo = "tare"\n', "s.toml: [[step]]: there is no step; add a section [[step]], in double brackets"),
        ('sed = 1\n[[step]]\ndo = "tare"\n', 's.toml: sed: unknown key; did you mean "seed"?'),
        ('seed = -1\n[[step]]\ndo = "tare"\n', "s.toml: seed: -1 must be at least 0"),
        ("[[step]]\n", "s.toml: [step 1] do: is missing; add do ="),
        ('[[step]]\ndo = "fre"\n', 's.toml: [step 1] do: "fre" is not a procedure; did you mean "free"?'),
        ("[[step]]\ndo = [1]\n", "s.toml: [step 1] do: [1] is not a procedure; known: "),
        ("step = [3]\n", "s.toml: [step 1]: is a section, not 3; write [[step]] on a line of its own"),
        (
            '[[step]]\ndo = "tare"\n[[step]]\ndo = "free"\namplitud = "6 %"\n',
            's.toml: [step 2, free] amplitud: unknown key; did you mean "amplitude"?',
        ),
        ('[[step]]\ndo = "free"\namplitude = 60\n', "s.toml: [step 1, free] amplitude: 60 must be at most 1; write it"),
        ('[[step]]\ndo = "free"\namplitude = "60 rad/s"\n', 's.toml: [step 1, free] amplitude: "60 rad/s" is not in'),
        ('[[step]]\ndo = "tare"\nduration = 2\n', 's.toml: [step 1, tare] duration: "2" has no unit; write it like'),
        (
            '[[step]]\ndo = "blocked"\nlevels = 2.5\n',
            "s.toml: [step 1, blocked] levels: expected a whole number, not 2.5",
        ),
        ('[[step]]\ndo = "imposed"\nvelocities = []\n', "s.toml: [step 1, imposed] velocities: is empty"),
        (
            '[[step]]\ndo = "imposed"\nvelocities = "1:2"\n',
            "s.toml: [step 1, imposed] velocities: expected a range such",
        ),
        ("[[step]\n", "s.toml: is not TOML: "),
    ],
)
def test_one_mistake_gives_one_sentence(text: str, said: str) -> None:
    with pytest.raises(UsageError) as refusal:
        parse_session(text, place="s.toml")
    (sentence,) = str(refusal.value).splitlines()
    assert sentence.startswith(said)
    assert refusal.value.exit_code == ExitCode.USAGE


def test_all_mistakes_are_told_at_once() -> None:
    with pytest.raises(UsageError) as refusal:
        parse_session('sed = 1\n[[step]]\ndo = "x"\n[[step]]\ndo = "tare"\nz = 1\nduration = 2\n', place="s")
    assert len(str(refusal.value).splitlines()) == 4
