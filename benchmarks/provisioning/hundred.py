"""Scale on real robots of the lab: a hundred, nothing to do. Time, and the most memory of the controller.

python -m benchmarks.provisioning.hundred [--robots 100] [--repeat 3]
"""

from __future__ import annotations

import argparse
import sys

from benchmarks.provisioning import measure, stats
from benchmarks.provisioning.compare import RESULTS, measure_lab, write


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--scratch", action="store_true", help="write no results")
    wish = parser.parse_args()
    wish.tools, wish.scenarios = ["floor", "srprov0"], ["fresh", "nothing"]
    measure.adopt_orphans()
    measure.raise_limits()
    rows = measure_lab(wish.robots, 0, wish)
    found = stats.medians(rows)
    print("\n" + stats.table(found))
    if not wish.scratch:
        write(RESULTS, rows, found, "hundred")
    sys.exit(1 if any(row["problem"] for row in rows) else 0)


if __name__ == "__main__":
    main()
