import sys

import pytest

from norton_bench import extras
from norton_bench.errors import UsageError


def test_what_is_not_installed_is_named_with_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(extras.EXTRAS, "no_such_package", "tables")
    with pytest.raises(UsageError, match=r"reading CSV needs no_such_package, .* pip install 'norton-bench\[tables\]'"):
        extras.extra("no_such_package.csv", "reading CSV")


def test_an_error_inside_the_package_is_not_taken_for_its_absence(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("packages")
    (folder / "broken_package.py").write_text("import not_there_either")
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setitem(extras.EXTRAS, "broken_package", "tables")
    with pytest.raises(ModuleNotFoundError, match="not_there_either"):
        extras.extra("broken_package", "reading CSV")
    assert "broken_package" not in sys.modules
