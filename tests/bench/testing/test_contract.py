"""The contract for drivers can be broken: drivers that do wrong, one thing each, are caught by the test that is meant.

They are variants of the example's, whose own driver keeps the contract (tests/test_third_party_driver.py).
"""

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from norton_bench.testing import AmplifierContract, SetUp, TorqueSensorContract
from norton_drivers.errors import DeviceError
from norton_drivers.readings import DriveState, DriveStatus

EXAMPLE = Path(__file__).parents[3] / "examples" / "third-party-driver"
CAUGHT = (AssertionError, pytest.fail.Exception)


@pytest.fixture(scope="module")
def example():
    """The example's driver, and its drive in a script."""
    sys.path.insert(0, str(EXAMPLE / "src"))
    try:
        yield load(EXAMPLE / "tests" / "test_contract.py"), importlib.import_module("norton_bench_turnwell.driver")
    finally:
        sys.path.remove(str(EXAMPLE / "src"))


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("turnwell_contract", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def contract_of(example: tuple[ModuleType, ModuleType], **wrong: Any) -> AmplifierContract:
    """The example's contract, for its driver with other methods."""
    contract, driver = example
    made = type("Wrong", (driver.Turnwell,), wrong)
    options = driver.TurnwellOptions(node=5)

    class WrongContract(contract.TestTurnwell):
        @staticmethod
        def open_driver(set_up: SetUp, link: Any) -> Any:
            return made(set_up.settings, options, link.can_port(set_up.settings), link)

    return WrongContract()


def nothing(self: Any, *arguments: Any, **options: Any) -> None:
    """Do as if all were well."""


def patient(self: Any, value: float) -> None:
    self._link.wait()
    self._port.send(0x105, b"\1\0\0\0")


def deaf_to_nan(self: Any, value: float) -> None:
    self._port.send(0x105, b"\1\0\0\0")


def unsigned(self: Any, value: float) -> None:
    driver = sys.modules["norton_bench_turnwell.protocol"]
    try:
        self._port.send(0x105, driver.command(self._wanted, value))
    except ValueError as error:
        raise DeviceError(f"{self._place}: {error}") from error


def again(self: Any) -> list[Any]:
    self._kept = self._motion.take() or getattr(self, "_kept", [])
    return self._kept


def failing(self: Any, *arguments: Any) -> None:
    raise RuntimeError("not there")


def anonymous(self: Any, timeout_s: float = 1.0) -> None:
    for _ in range(round(timeout_s * 1e3)):
        self._link.wait()
    raise DeviceError("does not answer")


def cheerful(self: Any) -> DriveStatus:
    return DriveStatus(DriveState.ENABLED, self._link.clock.now_ns())


def raising(self: Any, frame: Any, arrival_ns: int) -> None:
    handler = self._handlers.get(frame.arbitration_id)
    if handler is not None:
        handler(bytes(frame.data), arrival_ns)


@pytest.mark.parametrize(
    ("test", "wrong", "direction"),
    [
        ("test_that_nobody_is_there_is_told_in_time", {"identify": nothing}, 1),
        ("test_that_nobody_is_there_is_told_in_time", {"identify": anonymous}, 1),
        ("test_it_says_who_is_there", {"identify": failing}, 1),
        ("test_no_junk_makes_it_raise", {"_on_frame": raising}, 1),
        ("test_what_it_says_of_itself_makes_sense", {"command_unit": "rad"}, 1),
        ("test_it_enables_at_zero", {"enable": nothing}, 1),
        ("test_it_is_not_enabled_where_nobody_answers", {"enable": nothing}, 1),
        ("test_it_is_not_enabled_where_nobody_answers", {"enable": anonymous}, 1),
        ("test_a_command_goes_out_at_once_and_acts", {"command": patient}, 1),
        ("test_a_command_goes_out_at_once_and_acts", {"command": deaf_to_nan}, 1),
        ("test_what_is_no_number_is_refused", {"command": deaf_to_nan}, 1),
        ("test_direction_turns_commands", {"command": unsigned}, -1),
        ("test_readings_come_once_in_order_with_their_arrival", {"take_motion": again}, 1),
        ("test_a_drive_that_is_lost_shows", {"status": cheerful}, 1),
        ("test_a_drive_that_is_lost_shows", {"take_motion": again}, 1),
        ("test_a_port_that_is_lost_is_told_and_does_not_keep_it_from_stopping", {"stop": failing}, 1),
        ("test_it_stops", {"stop": nothing}, 1),
        ("test_it_can_be_enabled_again", {"stop": failing}, 1),
    ],
)
def test_a_driver_that_does_wrong_is_caught(example: Any, test: str, wrong: dict[str, Any], direction: int) -> None:
    right, broken = contract_of(example), contract_of(example, **wrong)
    with right.plugging() as plug:
        ask(right, test, plug, direction)
    with broken.plugging() as plug, pytest.raises((*CAUGHT, Exception)) as caught:
        ask(broken, test, plug, direction)
    assert not isinstance(caught.value, TypeError | AttributeError | NameError), "the double itself is at fault"


def ask(contract: AmplifierContract, test: str, plug: Callable[..., Any], direction: int) -> None:
    method = getattr(contract, test)
    if test.startswith("test_direction"):
        method(plug, direction)
    elif test == "test_what_is_no_number_is_refused":
        method(plug(), float("nan"))
    else:
        method(plug(direction))


def test_a_watchdog_that_does_not_act_is_caught(example: Any) -> None:
    contract = contract_of(example)
    with contract.plugging() as plug:
        plugged = plug()
        tick, clock = plugged.emulated.tick, plugged.set_up.backend.clock

        def fed(now_ns: int) -> None:
            plugged.emulated.fed_ns = now_ns
            tick(now_ns)

        clock.alarms[:] = [fed]
        with pytest.raises(AssertionError):
            contract.test_its_watchdog_acts_as_it_says(plugged)


def test_a_contract_without_a_device_says_what_is_missing() -> None:
    for contract in (AmplifierContract(), TorqueSensorContract()):
        with pytest.raises(NotImplementedError, match=r"say in set_up\(self, direction\)"):
            contract.set_up(1)
