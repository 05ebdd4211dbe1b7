"""Modules that are imported when they are first needed: parts of this program, and packages of its extras."""

from collections.abc import Callable
from importlib import import_module
from pkgutil import resolve_name
from typing import Any

from norton_bench.errors import UsageError

# Which extra of pyproject.toml brings the module.
EXTRAS = {"distributed": "cluster", "h5py": "tables", "pyarrow": "tables", "rosbags": "bags"}


def deferred(target: str) -> Callable[..., Any]:
    """The function or class ``target``, written "package.module:name"; its module is imported by the first call.

    For what most sessions do not need: a step that few have, and the tables and figures of its results.
    """

    def call(*arguments: Any, **options: Any) -> Any:
        return resolve_name(target)(*arguments, **options)

    return call


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
