"""Measure the rows named on the command line and print them as JSON; without a name, all of them, and keep them."""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from dataclasses import asdict

from benchmarks import machine, plots, results, sgemm
from benchmarks.measure import Options, Unavailable
from benchmarks.rows import ROWS


def main() -> int:
    """Run; 0 where every row was measured or skipped, 1 where one failed, 2 for an unknown name."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="rows to measure (default: all)")
    parser.add_argument("--list", action="store_true", help="list the rows and stop")
    parser.add_argument("--save", action="store_true", help="also keep named rows in results.json and the docs")
    parser.add_argument("--quick", action="store_true", help="a tenth of the work, for development; never kept")
    parser.add_argument(
        "--threads", type=int, default=Options.threads, help="threads of both sides (default: all cores)"
    )
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(f"{name:<28} {row.title}" for name, row in ROWS.items()))
        return 0
    unknown = [name for name in arguments.names if name not in ROWS]
    if unknown:
        print(f"no row {', '.join(unknown)}; python -m benchmarks --list names them", file=sys.stderr)
        return 2
    options = Options(threads=arguments.threads, quick=arguments.quick)
    keep = (arguments.save or not arguments.names) and not arguments.quick
    failed = False
    for name in arguments.names or ROWS:
        measured = measure(name, options)
        failed |= measured["status"] == "failed"
        print(json.dumps(measured, indent=1, ensure_ascii=False), flush=True)
        if keep:
            rows = results.merge(results.load(), [measured], list(ROWS))
            results.publish(rows, {name: row.title for name, row in ROWS.items()})
            plots.draw(rows)
    return int(failed)


def measure(name: str, options: Options) -> results.Row:
    """One row with when and on what it was measured, or with the reason why it was not."""
    print(f"{name}: {ROWS[name].title}", file=sys.stderr, flush=True)
    row: results.Row = {"name": name, "status": "measured"}
    start = time.monotonic()
    try:
        result = ROWS[name].measure(options)
        row |= asdict(result) | {"reached": result.reached}
    except Unavailable as reason:
        row |= {"status": "skipped", "reason": str(reason)}
    except Exception as error:  # a row may fail as it likes: hours of other rows are kept, and the exit code is 1
        traceback.print_exc()
        row |= {"status": "failed", "reason": f"{type(error).__name__}: {error}".splitlines()[0]}
    stamp = {"seconds": round(time.monotonic() - start, 1), "time": time.strftime("%Y-%m-%d %H:%M")}
    stamp |= {"threads": options.threads, "quick": options.quick, "machine": machine.describe()}
    return row | stamp | {"sgemm": sgemm.rates(options.threads)}


if __name__ == "__main__":
    sys.exit(main())
