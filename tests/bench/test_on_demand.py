import re
import subprocess
import sys
from pathlib import Path
from pkgutil import resolve_name

import pytest

import norton_bench
from norton_bench import on_demand
from norton_bench.errors import UsageError

# Modules of steps that the standard session of a motor does not have, and the loop's own process.
NOT_STANDARD = (
    "identification.exertion_table",
    "identification.in_situ",
    "identification.modulation",
    "identification.source_table",
    "identification.trials",
    "loop.process",
    "procedures.in_situ",
    "procedures.refine",
    "procedures.tabulate_impedance",
    "report.sections_tables",
    "cli.tables",
)
AFTER_IMPORTS = """
import sys
from norton_bench.cli import results
from norton_bench.report import render
from norton_bench.session import engine
from norton_bench.session.schema import standard_session
print(*(f"norton_bench.{name}" in sys.modules for name in sys.argv[1:]))
"""


def test_a_deferred_function_is_imported_by_its_first_call(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("packages")
    (folder / "late_module.py").write_text("def double(number, *, more=0):\n    return 2 * number + more")
    monkeypatch.syspath_prepend(folder)
    double = on_demand.deferred("late_module:double")
    assert "late_module" not in sys.modules
    assert double(4, more=1) == 9
    monkeypatch.delitem(sys.modules, "late_module")


def test_whatever_is_deferred_exists() -> None:
    sources = Path(norton_bench.__file__).parent.rglob("*.py")
    targets = [each for path in sources for each in re.findall(r'deferred\("([\w.:]+)"\)', path.read_text())]
    assert len(targets) > 10
    for target in targets:
        assert callable(resolve_name(target)), target


def test_a_standard_session_does_not_import_what_only_other_steps_need() -> None:
    command = [sys.executable, "-c", AFTER_IMPORTS, *NOT_STANDARD]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"] * len(NOT_STANDARD)


def test_what_is_not_installed_is_named_with_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(on_demand.EXTRAS, "no_such_package", "tables")
    with pytest.raises(UsageError, match=r"reading CSV needs no_such_package, .* pip install 'norton-bench\[tables\]'"):
        on_demand.extra("no_such_package.csv", "reading CSV")


def test_an_error_inside_the_package_is_not_taken_for_its_absence(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("packages")
    (folder / "broken_package.py").write_text("import not_there_either")
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setitem(on_demand.EXTRAS, "broken_package", "tables")
    with pytest.raises(ModuleNotFoundError, match="not_there_either"):
        on_demand.extra("broken_package", "reading CSV")
    assert "broken_package" not in sys.modules
