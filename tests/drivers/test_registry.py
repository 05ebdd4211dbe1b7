"""Drivers by name: unknown ones, and entry points of which nothing comes, are one sentence."""

from importlib.metadata import EntryPoint

import pytest

from norton_drivers import registry
from norton_drivers.errors import WiringError


@pytest.fixture
def entry(monkeypatch):
    """Makes the only driver that is installed."""

    def make(value: str) -> None:
        found = EntryPoint("mine", value, registry.AMPLIFIERS)
        monkeypatch.setattr(registry, "_entries", lambda group: [found] if group == found.group else [])

    return make


def test_an_unknown_name_is_told_with_those_that_are_known(entry):
    entry("norton_drivers.odrive:open_amplifier")
    with pytest.raises(WiringError, match=r"\[load\] driver = 'yours' is not installed; known: mine"):
        registry.load(registry.AMPLIFIERS, "yours", asked_by="[load] driver")
    with pytest.raises(WiringError, match="known: none"):
        registry.load(registry.TORQUE_SENSORS, "yours", asked_by="[torque_sensor] driver")


def test_a_name_is_loaded(entry):
    entry("norton_drivers.wiring:DeviceSettings")
    from norton_drivers.wiring import DeviceSettings

    assert registry.load(registry.AMPLIFIERS, "mine", asked_by="driver") is DeviceSettings


@pytest.mark.parametrize(
    ("value", "why"),
    [
        ("drivers.no_such_module:open", r"ModuleNotFoundError: No module named 'drivers\.no_such_module'"),
        ("norton_drivers.wiring:no_such_function", "AttributeError: module 'norton_drivers.wiring' has no attribute"),
    ],
)
def test_an_entry_point_of_which_nothing_comes(entry, value, why):
    entry(value)
    words = rf"\[load\] driver = 'mine': a package says that it is {value}, but importing that fails \({why}"
    with pytest.raises(WiringError, match=words) as caught:
        registry.load(registry.AMPLIFIERS, "mine", asked_by="[load] driver")
    assert "\n" not in str(caught.value)
