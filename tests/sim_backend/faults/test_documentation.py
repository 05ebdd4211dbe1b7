"""What docs/faults.md shows must work as it stands, and must name everything there is."""

import re
import tomllib
from pathlib import Path

import pytest

from norton_drivers.wiring import Wiring
from norton_sim.faults.injection import read_faults
from norton_sim.faults.schema import KINDS, Carriage, Fault
from norton_sim.tables import keys_of

TEXT = (Path(__file__).parents[3] / "docs" / "faults.md").read_text()
COMMON = {*keys_of(Carriage), "kind"}


def test_the_faults_shown_are_right(wiring: Wiring) -> None:
    (block,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    tables = tomllib.loads(block)["fault"]
    for table in tables:
        table.pop("during", None)
    assert [fault.kind for fault in read_faults(tables, wiring, place="docs", section="fault")] == [
        "delay",
        "sign-flip",
    ]


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.kind)
def test_every_kind_and_its_keys_are_explained(kind: type[Fault]) -> None:
    (row,) = [row for row in TEXT.splitlines() if row.startswith("|") and f"`{kind.kind}`" in row.split("|")[1]]
    assert [key for key in keys_of(kind) if key not in COMMON and f"`{key}`" not in row] == []
    assert [key for key in COMMON - {"kind", "on", "at", "for", "after"} if f"`{key}`" not in TEXT] == []
