"""Disturb applies, make every fault of the table in docs/reliability.md, let controllers race; write what came of it.

`make soak` does all of it; `python -m tools.soak --only races --races 10` a part of a part. It needs what the lab
needs, takes the lab for itself for some minutes at a time, and brings it down in the end. Exit code 0: after each
disturbance the next apply ended as if nothing had been, all faults came to what the table says, each race had one
winner.
"""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

from tools.soak import faults, moments, races, results

RESULTS = Path(__file__).parent / "results.md"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.soak", description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=results.PARTS, default=results.PARTS, help="parts (default: all)")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only every Nth moment (default: all)")
    parser.add_argument("--races", type=int, default=50, metavar="N", help="so many races (default: 50)")
    parser.add_argument(
        "--lab-wait", type=float, default=3600, metavar="S", help="seconds to wait for the lab, each time"
    )
    parser.add_argument("--output", type=Path, default=RESULTS, help="the document (default: results.md here)")
    wanted = parser.parse_args()
    # like Ctrl-C: what was started ends too, and the lab goes down
    signal.signal(signal.SIGTERM, lambda _number, _frame: sys.exit(128 + signal.SIGTERM))

    def tell(result: results.Result) -> None:
        results.write(wanted.output, result)
        print("; ".join([f"{result.part}: {result.left} to go", *result.figures]), flush=True)

    parts = {
        "moments": lambda: moments.soak(wanted.every, wanted.lab_wait, tell),
        "faults": lambda: faults.soak(wanted.lab_wait, tell),
        "races": lambda: races.soak(wanted.races, wanted.lab_wait, tell),
    }
    fine = [parts[part]() for part in results.PARTS if part in wanted.only]
    return 0 if all(fine) else 1


if __name__ == "__main__":
    sys.exit(main())
