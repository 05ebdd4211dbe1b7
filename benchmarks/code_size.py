"""How much there is to know: files, lines, circles of imports, what ``identify`` executes, what one tick calls.

Counted are the three packages. ``identify`` is run on the simulated backend with every process noting which files of
ours it has imported; the simulator's are left out. One tick of imposed motion is traced, from the end of the one
before it to its own: its calls, functions, files and greatest depth, the simulator's (and what it calls of ours) and
the libraries' left out. A comprehension is no call.

    python benchmarks/code_size.py [--static]
"""

import argparse
import ast
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
PACKAGES = {"norton_bench": "bench", "norton_drivers": "drivers", "norton_sim": "sim_backend"}
RIG = ROOT / "rigs" / "sim-odrive.toml"
SMALL_LINES, LONG_LINES, LONG_FUNCTION_LINES = 50, 400, 40
# Imported by every process of a session before anything else: at its end it writes down which files of ours it knows.
NOTE = """
import atexit, os, sys

def note():
    ours = {getattr(m, "__file__", None) for n, m in list(sys.modules.items()) if n.startswith(("norton_bench", "norton_drivers"))}
    with open(os.path.join(os.environ["NOTED"], str(os.getpid())), "w") as file:
        file.write("\\n".join(sorted(filter(None, ours))))

atexit.register(note)
"""  # noqa: E501
# The tick is traced in a process of its own: the tracer must be there before the loop is.
TICK = 456  # of the segment of imposed motion: the controller has settled, no part is handed on, no heartbeat comes
TRACED = f"""
import sys
from collections import Counter
from norton_bench.loop.loop import Loop

calls, depth, state, simulated = Counter(), [0, 0], {{"ticks": 0}}, [0]
inner = Loop.tick

def ours(frame):
    name = frame.f_code.co_filename
    return ("norton_bench" in name or "norton_drivers" in name) and not frame.f_code.co_name.endswith("comp>")

def profile(frame, event, argument):
    if "norton_sim" in frame.f_code.co_filename:
        simulated[0] += (event == "call") - (event == "return")
    if simulated[0] or not ours(frame):
        return
    if event == "call":
        depth[0] += 1
        depth[1] = max(depth)
        calls[frame.f_code.co_filename, frame.f_code.co_qualname] += 1
    elif event == "return":
        depth[0] -= 1

def tick(self, *arguments):
    done = inner(self, *arguments)
    if self._last.segment.procedure == "imposed":
        state["ticks"] += 1
        if state["ticks"] == {TICK}:
            sys.setprofile(profile)
        elif state["ticks"] == {TICK} + 1:
            sys.setprofile(None)
            files = {{file for file, _ in calls}}
            print("TICK", sum(calls.values()), len(calls), len(files), depth[1], flush=True)
            raise KeyboardInterrupt
    return done

Loop.tick = tick
from norton_bench.rig.load import load_rig
from norton_bench.session.engine import record_session
from norton_bench.session.schema import standard_session
from pathlib import Path
rig = load_rig({str(RIG)!r})
record_session(rig, standard_session(rig), out=Path(sys.argv[1]), seed=1)
"""


@dataclass(frozen=True)
class Module:
    """One file: its path, its lines, its longest function, and which of our modules it imports."""

    path: Path
    lines: int
    longest_function: int
    imports: frozenset[str]


def modules() -> dict[str, Module]:
    """Every file of the three packages, by its dotted name."""
    paths = {
        ".".join(path.relative_to(ROOT / folder).with_suffix("").parts).removesuffix(".__init__"): path
        for package, folder in PACKAGES.items()
        for path in sorted((ROOT / folder / package).rglob("*.py"))
    }
    return {name: _module(path, paths) for name, path in paths.items()}


def _module(path: Path, known: Mapping[str, Path]) -> Module:
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    longest = max((_code_lines(node) for node in functions), default=0)
    return Module(path, len(text.splitlines()), longest, frozenset(_imported(tree, known)))


def _code_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """From its name to its end, without its docstring."""
    first = node.body[0]
    documented = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    docstring = (first.end_lineno or 0) - first.lineno + 1 if documented else 0
    return (node.end_lineno or 0) - node.lineno + 1 - docstring


def _imported(tree: ast.Module, known: Mapping[str, Path]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module in known:
            inner = [name for alias in node.names if (name := f"{node.module}.{alias.name}") in known]
            yield from inner or [node.module]


def circles(found: Mapping[str, Module]) -> list[list[str]]:
    """Files that import each other in a loop, by Tarjan's algorithm."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    circle: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in found[name].imports - {name}:
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            at = stack.index(name)
            if len(stack) - at > 1:
                circle.append(stack[at:])
            del stack[at:]

    sys.setrecursionlimit(10_000)
    for name in found:
        if name not in index:
            visit(name)
    return circle


def executed_by_identify() -> int:
    """Files of the bench and the drivers that any process of ``norton-bench identify`` imports."""
    with TemporaryDirectory() as folder:
        (Path(folder) / "sitecustomize.py").write_text(NOTE)
        noted = Path(folder) / "noted"
        noted.mkdir()
        environment = {**os.environ, "PYTHONPATH": _path(folder), "NOTED": str(noted)}
        command = [
            sys.executable,
            "-m",
            "norton_bench",
            "identify",
            str(RIG),
            "--quiet",
            "--out",
            folder,
            "--seed",
            "1",
        ]
        subprocess.run(command, env=environment, check=True, capture_output=True)
        return len({line for each in noted.iterdir() for line in each.read_text().splitlines()})


def tick_calls() -> list[int]:
    """Calls, functions, files and depth of one tick of imposed motion."""
    with TemporaryDirectory() as folder:
        environment = {**os.environ, "PYTHONPATH": _path()}
        command = [sys.executable, "-c", TRACED, folder]
        done = subprocess.run(command, env=environment, check=False, capture_output=True, text=True)
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("TICK")]
    return [int(word) for word in line.split()[1:]]


def _path(*folders: str) -> str:
    return os.pathsep.join([*folders, *(str(ROOT / folder) for folder in PACKAGES.values())])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--static", action="store_true", help="run nothing: files, lines and circles alone")
    static = parser.parse_args().static
    found = modules()
    importers = Counter(imported for module in found.values() for imported in module.imports)
    plain = {name: module for name, module in found.items() if module.path.name != "__init__.py"}
    lines = sum(module.lines for module in found.values())
    print(f"files {len(found)}, lines {lines}")
    print(f"files of at most {SMALL_LINES} lines: {sum(module.lines <= SMALL_LINES for module in plain.values())}")
    print(f"files with one importer: {sum(importers[name] == 1 for name in plain)}")
    print(f"files of more than {LONG_LINES} lines: {', '.join(_long(found)) or 'none'}")
    long = [name for name, module in found.items() if module.longest_function > LONG_FUNCTION_LINES]
    print(f"files with a function of more than {LONG_FUNCTION_LINES} lines: {', '.join(long) or 'none'}")
    print(f"circles: {', '.join(' <-> '.join(circle) for circle in circles(found)) or 'none'}")
    if not static:
        print(f"identify executes {executed_by_identify()} files outside the simulator")
        print("one imposed tick: {} calls of {} functions in {} files, depth {}".format(*tick_calls()))


def _long(found: Mapping[str, Module]) -> list[str]:
    return [f"{name} ({module.lines})" for name, module in found.items() if module.lines > LONG_LINES]


if __name__ == "__main__":
    main()
