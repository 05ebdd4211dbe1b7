"""PyVESC, a host of VESCs on serial lines that nobody here wrote, as pyvesc-fix publishes it.

Its modules import one another by the name that they had before: ``pyvesc``.
"""

import importlib.util
import sys
import warnings
from importlib import import_module
from types import ModuleType
from typing import Any


def pyvesc(module: str) -> Any:
    """One of its modules, such as "protocol.interface"."""
    if "pyvesc" not in sys.modules:
        found = importlib.util.find_spec("pyvesc_fix")
        assert found is not None
        assert found.submodule_search_locations
        package = ModuleType("pyvesc")
        package.__path__ = list(found.submodule_search_locations)
        sys.modules["pyvesc"] = package
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it compares texts by identity
        return import_module(f"pyvesc.{module}")
