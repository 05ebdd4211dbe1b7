"""What a session file can say beside its steps: parameters, sweeps, repetitions, groups, conditions, expectations."""

from pathlib import Path
from typing import Any

import pytest

from norton_bench.errors import RigError, UsageError
from norton_bench.procedures.options import FreeOptions, ImposedOptions, TareOptions
from norton_bench.rig.load import load_rig
from norton_bench.session.items import AskOptions, Block, Session, Step
from norton_bench.session.program import make_experiment
from norton_bench.session.schema import parse_session

ROOT = Path(__file__).parents[3]
RIG = load_rig(ROOT / "rigs" / "sim-odrive.toml")
START = '[[step]]\ndo = "tare"\n[[step]]\ndo = "calibrate"\n'
IMPOSED = START + '[[step]]\ndo = "imposed"\n'


def read(text: str, **given: Any) -> Session:
    return parse_session(text, place="s.toml", given=given)


def options(session: Session) -> list[Any]:
    return [step.options for step in session.every_step()]


def test_parameters_go_where_they_are_named() -> None:
    text = (
        '[parameters]\nlevels = 7\nspeed = "20 rad/s"\n'
        '[[step]]\ndo = "free"\nlevels = "$levels"\n'
        '[[step]]\ndo = "imposed"\nvelocities = ["-$speed", "$speed"]\n'
        '[[step]]\ndo = "ask"\nname = "x"\ntext = "At $speed, for $$5?"\n'
    )
    free, imposed, ask = options(read(text))
    assert (free, imposed) == (FreeOptions(levels=7), ImposedOptions(velocities_rad_s=(-20.0, 20.0)))
    assert ask == AskOptions(name="x", text="At 20 rad/s, for $5?")
    assert options(read(text, levels=5))[0] == FreeOptions(levels=5)
    assert read(text, levels=5).parameters == {"levels": 5, "speed": "20 rad/s"}


def test_a_sweep_takes_every_combination_in_order() -> None:
    text = '[[step]]\ndo = "imposed"\nfor = { a = "20:20:60 %", c = [1, 2] }\namplitude = "$a"\ncommands = "$c"\n'
    steps = list(read(text).every_step())
    assert [(step.options.amplitude, step.options.commands) for step in steps] == [  # type: ignore[union-attr]
        (pytest.approx(amplitude), commands) for amplitude in (0.2, 0.4, 0.6) for commands in (1, 2)
    ]
    assert steps[1].label == "a = 20 %, c = 2"


def test_repetitions_are_numbered() -> None:
    (step, *others) = read('[[step]]\ndo = "tare"\nrepeat = 3\n').every_step()
    assert (step.label, len(others)) == ("1 of 3", 2)


def test_groups_nest_and_pass_their_values_on() -> None:
    text = (
        '[[step]]\ndo = "group"\nfor = { d = ["1 s", "2 s"] }\n'
        '[[step.step]]\ndo = "tare"\nduration = "$d"\n'
        '[[step.step]]\ndo = "group"\nrepeat = 2\n[[step.step.step]]\ndo = "rest"\nduration = "$d"\n'
    )
    steps = list(read(text).every_step())
    assert [(step.do, step.options.duration_s) for step in steps] == [  # type: ignore[union-attr]
        (name, seconds) for seconds in (1.0, 2.0) for name in ("tare", "rest", "rest")
    ]
    assert [step.label for step in steps[:3]] == ["d = 1 s", "d = 1 s, 1 of 2", "d = 1 s, 2 of 2"]


def test_repeat_until_makes_a_block() -> None:
    text = '[[step]]\ndo = "tare"\nrepeat_until = { parameter = "inertia", interval = "1 %", at_most = 5 }\n'
    (block,) = read(text).steps
    assert isinstance(block, Block)
    assert (block.at_most, str(block.until)) == (5, "inertia: interval <= 1 %")
    (step,) = block.steps
    assert isinstance(step, Step)
    assert step.options == TareOptions()


def test_the_plan_tells_what_is_certain() -> None:
    text = IMPOSED + (
        'repeat_until = { parameter = "inertia", interval = "1 %", at_most = 3 }\n'
        '[[step]]\ndo = "free"\nwhen = { parameter = "inertia", status = "not valid" }\n'
        '[[step]]\ndo = "rest"\nalways = true\n'
    )
    plan = make_experiment(read(text), RIG).plan
    assert [(step.name, step.label, step.certain) for step in plan] == [
        ("tare", "", True),
        ("calibrate", "", True),
        ("imposed", "turn 1", True),
        ("imposed", "turn 2", False),
        ("imposed", "turn 3", False),
        ("free", "", False),
        ("rest", "", True),
    ]


def test_what_a_condition_may_leave_out_cannot_be_built_on() -> None:
    text = IMPOSED.replace('do = "calibrate"\n', 'do = "calibrate"\nwhen = { answer = "x", is = "y" }\n')
    asked = '[[step]]\ndo = "ask"\nname = "x"\ntext = "?"\n' + text
    with pytest.raises(UsageError, match=r"s.toml: \[step 4, imposed\] 'imposed' needs 'calibrate'"):
        make_experiment(read(asked), RIG)
    with pytest.raises(UsageError, match=r's.toml: \[step 2, calibrate\]: no prompt "x" comes before it; put a step'):
        make_experiment(read(text), RIG)


@pytest.mark.parametrize(
    ("tail", "said"),
    [
        (
            '[[step]]\ndo = "imposed"\nalways = true\n',
            r"\[step 4, imposed\]: needs other steps, which may have failed",
        ),
        (
            '[[expect]]\nparameter = "inertia"\nvalue = "5 N*m"\nwithin = "1 %"\n',
            r'\[expect 1\]: "5 N\*m" is not in kg\*m\^2; write it like "1 kg\*m\^2"',
        ),
        (
            '[[step]]\ndo = "rest"\nwhen = { parameter = "inertia", value = "> 5 N*m" }\n',
            r'\[step 4, rest\]: "5 N\*m" is not in kg\*m\^2',
        ),
    ],
)
def test_what_only_the_rig_can_tell_is_told_before_anything_moves(tail: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        make_experiment(read(IMPOSED + tail), RIG)


def test_what_the_rig_cannot_do_is_told_with_its_place() -> None:
    with pytest.raises(RigError, match="'imposed' asks for 900 rad/s"):
        make_experiment(read(IMPOSED + 'velocities = ["900 rad/s"]\n'), RIG)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            '[[step]]\ndo = "free"\nlevels = "$n"\n',
            "[step 1, free] levels: $n is no parameter (known: none); declare it",
        ),
        (
            '[parameters]\nlevel = 5\n[[step]]\ndo = "free"\nlevels = "$levels"\n',
            '[step 1, free] levels: $levels is no parameter (did you mean "level"?); declare it in [parameters]',
        ),
        (
            '[parameters]\nx = 5\n[[step]]\ndo = "tare"\n',
            '[parameters] x: is used nowhere; write "$x" where it belongs',
        ),
        ('[[step]]\ndo = "tare"\nrepeat = 0\n', "[step 1, tare] repeat: 0 must be at least 1"),
        ('[[step]]\ndo = "tare"\nrepeat = 1000000\n', "[step 1, tare] repeat: 1000000 must be at most 1000"),
        ('[[step]]\ndo = "tare"\nfor = { a = [] }\n', '[step 1, tare] for: a needs its values: write a = ["20 %"'),
        ('[[step]]\ndo = "tare"\nfor = { a = "1:-1:5" }\n', '[step 1, tare] for: the step of the range "1:-1:5"'),
        ('[[step]]\ndo = "tare"\nfor = { "a b" = [1] }\n', '[step 1, tare] for: "a b" cannot be named as $...'),
        (
            '[[step]]\ndo = "tare"\nwhen = { parameter = "inertia" }\n',
            "[step 1, tare] when: is empty; write {",
        ),
        (
            '[[step]]\ndo = "tare"\nwhen = { parameter = "inertai", interval = "1 %" }\n',
            '[step 1, tare.when] parameter: "inertai" is no parameter; did you mean "inertia"?',
        ),
        (
            '[[step]]\ndo = "tare"\nwhen = { parameter = "inertia", interval = "~ 1 %" }\n',
            '[step 1, tare.when] interval: "~ 1 %" is not a quantity',
        ),
        (
            '[[step]]\ndo = "tare"\nwhen = { parameter = "inertia", value = "1 kg*m^2" }\n',
            "[step 1, tare.when] value: '1 kg*m^2' is no comparison; write it like",
        ),
        (
            '[[step]]\ndo = "tare"\nwhen = { parameter = "inertia", status = "vald" }\n',
            '[step 1, tare.when] status: "vald" is no status; did you mean "valid"?',
        ),
        (
            '[[step]]\ndo = "tare"\nrepeat_until = { parameter = "inertia", interval = "1 %" }\n',
            "[step 1, tare.repeat_until] at_most: is missing; add at_most = 5",
        ),
        ('[[step]]\ndo = "group"\n', '[step 1, group]: holds no step; add [[step.step]] with do = "imposed" below it'),
        (
            '[[step]]\ndo = "group"\nlevel = 1\n[[step.step]]\ndo = "tare"\n',
            "[step 1, group] level: unknown key; known",
        ),
        (
            '[[step]]\ndo = "group"\n[[step.step]]\ndo = "tar"\n',
            '[step 1.1] do: "tar" is not a procedure; did you mean',
        ),
        (
            '[[step]]\ndo = "group"\n[[step.step]]\ndo = "tare"\nalways = true\n',
            "[step 1.1] always: is for steps of the file itself, not of a group",
        ),
        (
            '[[step]]\ndo = "rest"\nalways = true\n[[step]]\ndo = "tare"\n',
            "[step 2]: comes after a step with always = true; these must be the last",
        ),
        ('[[step]]\ndo = "ask"\ntext = "?"\n', '[step 1, ask] name: is missing; add name = "fixture"'),
        ('[[step]]\ndo = "tare"\n[[expect]]\n', "[expect 1] : is empty; write parameter ="),
        (
            '[[step]]\ndo = "tare"\n[[expect]]\nparameter = "inertia"\nvalue = "5e-5 kg*m^2"\n',
            "[expect 1]: '5e-5 kg*m^2' is no comparison; write it like",
        ),
        (
            '[[step]]\ndo = "tare"\n[[expect]]\nvalidation = "torque"\n',
            '[expect 1] : validation = "..." goes with at_most = "5 %"',
        ),
    ],
)
def test_one_mistake_gives_one_sentence(text: str, said: str) -> None:
    with pytest.raises(UsageError) as refusal:
        read(text)
    (sentence,) = str(refusal.value).splitlines()
    assert sentence.replace("] :", "]:").startswith(f"s.toml: {said}".replace("] :", "]:"))


def test_a_mistake_in_a_sweep_is_told_once() -> None:
    text = '[[step]]\ndo = "free"\nfor = { n = [5, 7, 9] }\nlevels = "$n"\namplitud = 1\n'
    with pytest.raises(UsageError) as refusal:
        read(text)
    assert len(str(refusal.value).splitlines()) == 1


def test_an_unknown_value_that_is_set_is_refused() -> None:
    with pytest.raises(UsageError, match=r'--set sped=3: s.toml has no parameter "sped"; did you mean "speed"\?'):
        read('[parameters]\nspeed = 1\n[[step]]\ndo = "free"\nlevels = "$speed"\n', sped=3)
