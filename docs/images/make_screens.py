"""The pictures of the screen in these docs, made anew: headless Chromium draws SVGs.

python docs/images/make_screens.py RECORDING      # of norton-bench identify rigs/sim-odrive.toml --seed 1: replays it
python docs/images/make_screens.py                # every screen at every size, as the tests keep it: images/screens
"""

import asyncio
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from norton_bench.screen.app import BenchApp
from norton_bench.screen.experiment import Experiment, Opening, replayed
from norton_bench.screen.screens.experiment import ExperimentScreen

HERE = Path(__file__).parent
SNAPSHOTS = HERE.parents[1] / "tests" / "bench" / "screen" / "snapshots"
# Enough for text in a few colours and its soft edges.
COLOURS = 48
# Name: columns, rows, moment [s], keys.
PICTURES = {
    "screen-overview": (160, 46, 73.0, "1"),
    "screen-loops": (120, 36, 74.1, "2"),
    "screen-source": (120, 36, 34.0, "3"),
    "screen-small": (80, 24, 66.0, "1"),
    "screen-results": (110, 34, 111.0, "r"),
}


async def svg_of(experiment: Experiment, columns: int, rows: int, moment_s: float, key: str) -> str:
    """What the terminal shows at that moment."""
    assert experiment.replay is not None
    app = BenchApp(Opening(lambda _: HERE), experiment)
    async with app.run_test(size=(columns, rows)) as pilot:
        experiment.replay.replay.pause()
        experiment.seek(moment_s)
        await pilot.press(key)
        while key == "r" and experiment.summary is None:
            await pilot.pause(0.5)
        for screen in app.screen_stack:
            if isinstance(screen, ExperimentScreen):
                screen.experiment.update()
                screen.draw_frame(all_of_it=True)
        await pilot.pause(0.5)
        return app.export_screenshot()


def png(svg: str, path: Path) -> None:
    """As large as it says."""
    found = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
    assert found is not None
    size = f"{round(float(found[1]))},{round(float(found[2]))}"
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "screen.svg"
        source.write_text(svg, encoding="utf-8")
        command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        command += [f"--window-size={size}", f"--screenshot={path}", source.as_uri()]
        subprocess.run(command, check=True, capture_output=True)
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    small.save(path, optimize=True)


def every_screen(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    for snapshot in sorted(SNAPSHOTS.glob("*.svg")):
        png(snapshot.read_text(encoding="utf-8"), folder / f"{snapshot.stem}.png")


def main(recording: Path) -> None:
    experiment = replayed(recording)
    for name, (columns, rows, moment_s, key) in PICTURES.items():
        png(asyncio.run(svg_of(experiment, columns, rows, moment_s, key)), HERE / f"{name}.png")
    experiment.close()


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        every_screen(HERE / "screens")
