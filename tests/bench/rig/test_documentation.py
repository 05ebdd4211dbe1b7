"""What the documentation shows must work as it stands, and must name everything there is."""

import re
import tomllib
from pathlib import Path

import pytest

from norton_bench.procedures.options import STEPS
from norton_bench.rig.draft import DEVICES
from norton_bench.rig.driver_options import declared_by
from norton_bench.rig.files import keys_of
from norton_bench.rig.load import parse_rig
from norton_bench.rig.schema import PLAUSIBILITY, BusSection, GuardSection, LimitsSection, RecordingSection, RigSection
from norton_bench.session.schema import parse_session
from norton_drivers import registry
from norton_drivers.adapters.table import ADAPTERS, mistakes

DOCS = Path(__file__).parents[3] / "docs"


def all_shown_in(document: str) -> list[str]:
    return re.findall(r"```toml\n(.*?)```", (DOCS / document).read_text(), re.DOTALL)


def shown_in(document: str) -> str:
    """The whole file that a document begins with."""
    return all_shown_in(document)[0]


def test_the_rig_shown_is_right() -> None:
    assert parse_rig(shown_in("rig-file.md"), place="docs").name == "dyno-2"


def test_the_set_ups_shown_are_right() -> None:
    """Beside the rig that the document shows, in the true values of a rig that has some."""
    written = [tomllib.loads(block) for block in all_shown_in("rig-file.md")[1:]]
    (tables,) = [table["simulated"] for table in written if "simulated" in table]
    simulated = tomllib.loads((DOCS.parent / "rigs" / "sim-odrive.toml").read_text())["simulated"]
    merged = {**simulated, **{role: {**simulated[role], **table} for role, table in tables.items()}}
    rig = parse_rig((DOCS.parent / "rigs" / "sim-odrive.toml").read_text(), place="docs")
    registry.load_backend("simulated")(rig.wiring, merged, seed=1, place="docs").close()


def test_the_second_drive_shown_fits_the_rig_shown() -> None:
    (modulator,) = [block for block in all_shown_in("rig-file.md")[1:] if block.startswith("[modulator]")]
    assert parse_rig(shown_in("rig-file.md") + modulator, place="docs").wiring.modulator is not None


def test_the_buses_shown_are_right() -> None:
    for block in all_shown_in("adapters.md"):
        written = tomllib.loads(block)
        bus = BusSection.model_validate(written.get("bus", {"can0": written})["can0"])
        settings = bus.settings("can0")
        assert list(mistakes(settings)) == []


def test_every_adapter_is_explained() -> None:
    text = (DOCS / "adapters.md").read_text()
    assert [name for name in ADAPTERS if name != "virtual" and f"| `{name}` |" not in text] == []


def test_the_session_shown_is_right() -> None:
    assert len(parse_session(shown_in("session-file.md"), place="docs").steps) == 5


@pytest.mark.parametrize("model", [RigSection, BusSection, LimitsSection, GuardSection, RecordingSection])
def test_every_key_of_a_rig_file_is_explained(model: type) -> None:
    text = (DOCS / "rig-file.md").read_text()
    assert [key for key in keys_of(model) if f"`{key}`" not in text] == []


@pytest.mark.parametrize("name", PLAUSIBILITY)
def test_every_plausibility_check_is_explained_and_quoted(name: str) -> None:
    rows = (DOCS / "safety.md").read_text().splitlines()
    explained, quoted = (row for row in rows if row.startswith(f"| `{name}` |"))
    assert explained.count("|") == 6
    assert quoted.endswith("* |")
    assert f'`"{name}"`' in (DOCS / "rig-file.md").read_text()


@pytest.mark.parametrize("group", [*dict.fromkeys(registry.group_of(role) for role in DEVICES)])
def test_every_option_of_a_driver_is_explained(group: str) -> None:
    rows = (DOCS / "rig-file.md").read_text().splitlines()
    for driver in registry.names(group):
        (row,) = [row for row in rows if row.startswith(f"| `{driver}` |")]
        model = declared_by(group, driver).model
        assert model is not None
        assert [key for key in keys_of(model) if f"`{key}`" not in row] == []


@pytest.mark.parametrize("name", STEPS)
def test_every_option_of_a_step_is_explained(name: str) -> None:
    (row,) = [row for row in (DOCS / "session-file.md").read_text().splitlines() if row.startswith(f"| `{name}` |")]
    assert [key for key in keys_of(STEPS[name]) if f"`{key}" not in row] == []
