"""Who decides: nudges are added up, clamped and told; who lets go of the keys lets go of the bench."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from norton_bench.control import rendering
from norton_bench.control.calibration import LoadCalibration
from norton_bench.errors import ExperimentError
from norton_bench.jog import certifying
from norton_bench.jog.hands import (
    ABANDONED_S,
    CHANGES_WITHIN_S,
    DEAD_MAN_S,
    Board,
    LoadDoes,
    Preset,
    Setpoints,
    bounds_of,
)
from norton_bench.loop.stop_word import StopWord
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Admittance
from norton_bench.session.operator import Order
from tests.bench.control.plant import PlantSettings
from tests.bench.control.runs import calibrated as calibrated_bench

RIGS = Path(__file__).parents[3] / "rigs"
RIG = load_rig(RIGS / "sim-odrive.toml")


@dataclass
class Keys:
    """An operator whose orders a test gives, with a clock that it moves, and an ear."""

    answers: bool = True
    stop: StopWord = field(default_factory=StopWord)
    now_s: float = 0.0
    elapsed_s: float = 0.0
    said: list[str] = field(default_factory=list)
    _orders: list[Order] = field(default_factory=list)

    def orders(self) -> Sequence[Order]:
        orders, self._orders = self._orders, []
        return orders

    def give(self, board: Board, *texts: str) -> None:
        self._orders += [Order("jog", text) for text in texts]
        self.listen(board)

    def listen(self, board: Board) -> None:
        """To what the board has to say: marks, and nothing else."""
        marks = board.orders()
        assert all(order.kind == "mark" for order in marks)
        self.said += [order.text for order in marks]

    def press(self, board: Board, *texts: str) -> Setpoints:
        """What is wanted then."""
        self.give(board, *texts)
        wanted = board.wanted(self.elapsed_s)
        self.listen(board)
        return wanted


@pytest.fixture
def keys() -> Keys:
    return Keys()


def board_of(keys: Keys, rig: Rig = RIG, *, calibrated: bool = False) -> Board:
    board = Board(keys, rig, bounds_of(rig), clock=lambda: keys.now_s)
    board.begin(calibration() if calibrated else None)
    return board


@lru_cache(maxsize=1)
def calibration() -> LoadCalibration:
    return calibrated_bench(PlantSettings())


class Later:
    """A thread that runs when a test says so."""

    begun: ClassVar[list["Later"]] = []

    def __init__(self, target: Callable[..., None], args: tuple[Any, ...], daemon: bool) -> None:
        self.target, self.args, self.ran = target, args, False

    def start(self) -> None:
        self.begun.append(self)

    def run(self) -> None:
        if not self.ran:
            self.target(*self.args)
        self.ran = True

    def is_alive(self) -> bool:
        return not self.ran


@pytest.fixture(autouse=True)
def later(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certifying, "Thread", Later)
    Later.begun.clear()


def certified(keys: Keys, board: Board) -> Setpoints:
    """What is wanted once the certificate of the last law is there."""
    Later.begun[-1].run()
    keys.elapsed_s += 1.0
    return keys.press(board)


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[Admittance]:
    """The laws that are looked at; the bench can render every one."""
    laws = list[Admittance]()

    def render(_: object, __: object, law: Admittance, **___: object) -> rendering.Rendering:
        laws.append(law)
        return rendering.Rendering(law)

    monkeypatch.setattr(rendering, "require_rendered", render)
    return laws


def test_other_orders_are_left_to_the_session(keys: Keys) -> None:
    board = board_of(keys)
    keys._orders += [Order("mark", "loud"), Order("jog", "here"), Order("pause")]
    assert [order.kind for order in board.orders()] == ["mark", "pause"]


def test_nudges_add_up_to_the_limit_and_it_is_told(keys: Keys) -> None:
    board = board_of(keys)
    assert keys.press(board, "actuator 0.02", "actuator 0.02").command == pytest.approx(0.02)
    assert keys.said == []
    assert keys.press(board, *["actuator 0.1"] * 12).command == 0.5
    assert "the actuator stays at +0.5 N*m" in keys.said[-1]
    assert keys.press(board, "zero") == Setpoints()


def test_the_load_pushes_once_it_is_told_to(keys: Keys) -> None:
    board = board_of(keys)
    assert keys.press(board, "load 0.1") == Setpoints()
    assert "let it push" in keys.said[-1]
    assert keys.press(board, "torque", "load 0.1", "load 0.1") == Setpoints(0.0, LoadDoes.TORQUE, 0.2)
    assert keys.press(board, "torque").load_value == 0.2  # it does already
    assert keys.press(board, "coast") == Setpoints()


@pytest.mark.parametrize(("word", "does"), [("velocity", LoadDoes.VELOCITY), ("zero_torque", LoadDoes.ZERO_TORQUE)])
def test_what_the_controller_does_needs_a_calibration(keys: Keys, word: str, does: LoadDoes) -> None:
    assert keys.press(board_of(keys), word).load is LoadDoes.COAST
    assert "calibrat" in keys.said[-1]
    assert keys.press(board_of(keys, calibrated=True), word).load is does


BODY, SPRING = Admittance(5e-4, 2e-2), Admittance(5e-4, 2e-2, 0.5)


def test_a_body_is_acted_once_it_is_certified(keys: Keys) -> None:
    """Until then the load does what it did; a nudge of the actuator is obeyed meanwhile."""
    board = board_of(keys, calibrated=True)
    assert keys.press(board, "zero_torque", "body 0.0005 0.02 0").load is LoadDoes.ZERO_TORQUE
    keys.press(board, "actuator 0.1")
    assert certified(keys, board) == Setpoints(0.05, LoadDoes.BODY, law=BODY)
    keys.press(board, "body 0.0005 0.02 0.5")
    assert certified(keys, board).law == SPRING
    assert "0.5 N*m/rad of stiffness is stable with an actuator of" in keys.said[-1]
    assert keys.press(board, "zero") == Setpoints()


def test_a_wall_is_a_body_with_an_angle(keys: Keys) -> None:
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0.02 2.0 -0.1")
    wanted = certified(keys, board)
    assert wanted.law == Admittance(5e-4, 2e-2, 2.0, wall_rad=-0.1)
    assert wanted.words("A").endswith("2 N*m/rad, wall -0.1 rad")


def test_a_body_that_the_bench_cannot_render_is_refused_with_one_that_it_can(keys: Keys) -> None:
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0 0")
    assert certified(keys, board).load is LoadDoes.COAST
    assert re.search("cannot render 0.0005 kg.m.2 of mass: .*; it can with a damping of", keys.said[-1])


def test_a_body_is_what_was_asked_for_before_it_becomes_another(keys: Keys) -> None:
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0.02 0")
    certified(keys, board)
    keys.press(board, "body 0.0005 0.02 0.5")
    Later.begun[-1].run()
    assert keys.press(board).law == BODY
    keys.elapsed_s += CHANGES_WITHIN_S
    assert keys.press(board).law == SPRING


def test_one_body_is_looked_at_at_a_time(keys: Keys) -> None:
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0.02 0", "body 0.0005 0.02 0.5")
    assert "ask again in a moment" in keys.said[-1]
    assert certified(keys, board).law == BODY


def test_what_keeps_a_certificate_from_being_computed_is_told(keys: Keys, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise ArithmeticError("singular")

    monkeypatch.setattr(rendering, "require_rendered", fails)
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0.02 0")
    assert certified(keys, board).load is LoadDoes.COAST
    assert "could not be computed (ArithmeticError('singular'))" in keys.said[-1]
    assert keys.press(board, "body 0 0 inf").load is LoadDoes.COAST
    assert "finite numbers" in keys.said[-1]


def test_there_is_no_way_to_a_wall(keys: Keys, tried: list[Admittance]) -> None:
    """The body begins anew with it: no law between them acts."""
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0.02 0")
    certified(keys, board)
    keys.press(board, "body 0.0005 0.02 2 0.1")
    assert certified(keys, board).law == tried[-1]
    assert len(tried) == 2


def test_a_refusal_on_the_way_says_so(keys: Keys, monkeypatch: pytest.MonkeyPatch) -> None:
    def half(_: object, __: object, law: Admittance, *, offers: bool = True) -> rendering.Rendering:
        if not offers:
            raise ExperimentError(f"this bench cannot render {law.words}")
        return rendering.Rendering(law)

    monkeypatch.setattr(rendering, "require_rendered", half)
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0.02 0")
    assert certified(keys, board).law == BODY
    keys.press(board, "body 0.0005 0.02 0.5")
    assert certified(keys, board).law == BODY
    assert keys.said[-1].startswith("on the way from 0.0005 kg*m^2 of mass, 0.02 N*m*s/rad of damping to 0.0005")


def test_without_a_key_a_body_is_let_go_of_and_none_is_taken_over(keys: Keys) -> None:
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0.02 0")
    certified(keys, board)
    keys.press(board, "body 0.0005 0.02 0.5")
    keys.now_s = DEAD_MAN_S + 0.1
    assert board.wanted(2.0) == Setpoints()
    Later.begun[-1].run()
    assert board.wanted(9.0) == Setpoints()
    keys.listen(board)
    assert keys.said[-1] == f"no key for {DEAD_MAN_S:g} s: everything returns to zero"


def test_laws_on_the_way_from_one_body_to_another_are_looked_at(keys: Keys, tried: list[Admittance]) -> None:
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0.02 0")
    certified(keys, board)
    keys.press(board, "body 0.0009 0.04 4")
    certified(keys, board)
    ways = [(0.0006, 0.025, 1.0), (0.0007, 0.03, 2.0), (0.0008, 0.035, 3.0)]
    expected = [BODY, Admittance(9e-4, 0.04, 4.0), *map(Admittance.of, ways)]
    assert np.array([law.values for law in tried]) == pytest.approx(np.array([law.values for law in expected]))


def test_a_body_that_is_not_wanted_any_more_is_not_acted(keys: Keys) -> None:
    board = board_of(keys, calibrated=True)
    keys.press(board, "body 0.0005 0.02 0", "zero_torque")
    assert certified(keys, board).load is LoadDoes.ZERO_TORQUE
    keys.press(board, "body 0.0005 0.02 0", "zero")
    assert certified(keys, board).load is LoadDoes.ZERO_TORQUE


def test_a_body_needs_a_calibration_and_something_to_be(keys: Keys) -> None:
    assert keys.press(board_of(keys), "body 0.0005 0.02 0").load is LoadDoes.COAST
    assert "press k first" in keys.said[-1]
    assert keys.press(board_of(keys, calibrated=True), "body 0 0 0").load is LoadDoes.COAST
    assert "zero torque (z)" in keys.said[-1]


def test_a_load_that_is_not_there_or_has_no_limit(keys: Keys) -> None:
    alone = load_rig(RIGS / "sim-free-shaft.toml")
    assert keys.press(board_of(keys, alone), "torque").load is LoadDoes.COAST
    assert "no load drive" in keys.said[-1]
    boundless = replace(RIG, limits=replace(RIG.limits, load_torque_nm=inf, torque_nm=inf))
    assert keys.press(board_of(keys, boundless), "torque", "load 0.1").load_value == 0.0
    assert "torque_limit" in keys.said[-1]


def test_without_a_key_all_goes_back_to_zero_and_the_load_does_what_it_did(keys: Keys) -> None:
    board = board_of(keys, calibrated=True)
    keys.press(board, "velocity", "load 0.5", "actuator 0.1")
    keys.now_s = DEAD_MAN_S - 0.1
    assert not keys.press(board, "here").at_zero  # a sign of life
    keys.now_s += DEAD_MAN_S - 0.1
    assert not board.wanted(0.0).at_zero
    keys.now_s += 0.2
    assert board.wanted(0.0) == Setpoints(0.0, LoadDoes.VELOCITY, 0.0)
    keys.listen(board)
    assert keys.said == [f"no key for {DEAD_MAN_S:g} s: everything returns to zero"]
    board.wanted(0.0)
    keys.listen(board)
    assert len(keys.said) == 1
    assert not board.leaves


def test_a_bench_that_was_left_alone_is_idled(keys: Keys) -> None:
    board = board_of(keys)
    keys.now_s = ABANDONED_S + 1
    board.wanted(0.0)
    keys.listen(board)
    assert board.leaves
    assert "the drives go idle" in keys.said[-1]


def test_on_its_way_to_the_end_nothing_is_nudged_any_more(keys: Keys) -> None:
    board = board_of(keys)
    assert keys.press(board, "actuator 0.1", "end", "actuator 0.1").at_zero
    assert board.leaves
    assert not board.calibrates


def test_to_calibrate_all_goes_to_zero_first(keys: Keys) -> None:
    board = board_of(keys)
    assert keys.press(board, "actuator 0.1", "calibrate").at_zero
    assert (board.leaves, board.calibrates) == (True, True)
    in_situ = load_rig(RIGS / "sim-in-situ.toml")
    board = board_of(keys, in_situ)
    keys.press(board, "calibrate")
    assert (board.leaves, board.calibrates) == (False, False)
    assert "needs a torque sensor" in keys.said[-1]


def test_given_values_stand_for_their_time() -> None:
    hand = Preset(Setpoints(0.1, LoadDoes.ZERO_TORQUE), 2.0)
    assert hand.calibrates
    hand.begin(calibration())
    assert not hand.calibrates
    assert hand.wanted(1.9) == Setpoints(0.1, LoadDoes.ZERO_TORQUE)
    assert not hand.leaves
    assert hand.wanted(2.0) == Setpoints(0.0, LoadDoes.ZERO_TORQUE)
    assert hand.leaves


def test_what_happens_on_the_way_to_zero_cuts_nothing_short() -> None:
    hand = Preset(Setpoints(0.1), 2.0)
    hand.begin(None)
    hand.wanted(2.0)
    hand.let_go("too fast")
    assert (hand.leaves, hand.cut_short) == (True, "")


def test_given_values_that_cannot_stand_say_why() -> None:
    hand = Preset(Setpoints(0.1), 2.0)
    hand.begin(None)
    hand.let_go("too fast")
    assert hand.wanted(0.1).at_zero
    assert (hand.leaves, hand.cut_short) == (True, "too fast")
