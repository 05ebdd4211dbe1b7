"""A million random and damaged frames or bytes for every codec: no exception, and no reading that nobody sent.

Half of them are random, half are good ones with flipped bits, lost, added and changed bytes, other identifiers and junk
in between. Frames go through the driver where one decodes them; what comes by serial line is fed byte by byte.
*False* counts readings that were not sent, or that another decoder reads otherwise; it must be no more than the codec's
checksum has to let through (*by chance*). *Altered* counts those that damage made in a form that nothing tells from the
device's own: where there is no checksum, a digit can become another. Ends with 1 where a codec is not as it should be.
Run with ``python benchmarks/fuzz.py [--frames 1000000] [--quick] [--only NAME] [--seed 1] [--json]``.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from random import Random

from fuzzing.codecs import CODECS
from fuzzing.outcome import Outcome

QUICK_FRAMES = 20_000
HEADER = f"{'codec':34}{'fed':9}{'number':>9} {'of':7}{'readings':>9}{'exceptions':>11}{'false':>6}{'by chance':>10}"


def outcomes(names: list[str], count: int, seed: int) -> Iterator[Outcome]:
    for name in names:
        yield from CODECS[name]().outcomes(count, Random(f"{seed} {name}"))


def row(outcome: Outcome) -> str:
    judged = outcome.judged
    return (
        f"{outcome.codec:34}{outcome.fed:9}{outcome.count:9} {outcome.unit:7}{judged.readings:9}"
        f"{len(outcome.exceptions):11}{judged.wrong:6}{judged.by_chance:10.2g}{judged.altered:8}{outcome.seconds:7.1f}"
        f"  {outcome.redundancy}{'' if outcome.good else '  <-- NOT AS IT SHOULD BE'}"
    )


def as_json(outcome: Outcome) -> dict[str, object]:
    said = asdict(outcome) | {"good": outcome.good}
    return {key: value for key, value in said.items() if key != "judged"} | outcome.judged._asdict()


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, default=1_000_000, help="frames or bytes for each codec")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_FRAMES} of them")
    parser.add_argument("--only", choices=CODECS, action="append", help="this codec; may be said again")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


def main() -> int:
    asked = parsed()
    count = QUICK_FRAMES if asked.quick else asked.frames
    found = []
    if not asked.json:
        print(f"{HEADER}{'altered':>8}{'s':>7}  what tells a false one")
    for outcome in outcomes(asked.only or list(CODECS), count, asked.seed):
        found.append(outcome)
        if not asked.json:
            print(row(outcome), *outcome.exceptions, sep="\n    ", flush=True)
    if asked.json:
        print(json.dumps([as_json(outcome) for outcome in found], indent=2))
    return 0 if all(outcome.good for outcome in found) else 1


if __name__ == "__main__":
    sys.exit(main())
