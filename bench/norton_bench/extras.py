"""Packages that only some commands need, and that come with an extra of the installation."""

from importlib import import_module
from typing import Any

from norton_bench.errors import UsageError

# Which extra of pyproject.toml brings the module.
EXTRAS = {"distributed": "cluster", "h5py": "tables", "pyarrow": "tables"}


def extra(module: str, purpose: str) -> Any:
    """The module, imported. ``purpose`` is what needs it: "reading CSV".

    Raises UsageError, with the command that installs it, where it is not there.
    """
    package = module.partition(".")[0]
    try:
        return import_module(module)
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] != package:
            raise
        mend = f"python -m pip install 'norton-bench[{EXTRAS[package]}]'"
        raise UsageError(f"{purpose} needs {package}, which is not installed; {mend}") from None
