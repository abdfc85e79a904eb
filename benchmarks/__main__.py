"""Run the rows named on the command line (default: all) and print each as one line of JSON."""

import argparse
import json
import os
import platform

import torch

from benchmarks import rows


def main() -> None:
    """Measure and print; every row is the median of repeats."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("name", nargs="*", choices=[*rows.ROWS, []], help="rows to run (default: all)")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="threads (default: all cores)")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    machine = {"machine": platform.processor() or platform.machine(), "threads": arguments.threads}
    for name in arguments.name or rows.ROWS:
        print(json.dumps({"name": name, **rows.ROWS[name](arguments.threads), **machine}), flush=True)


if __name__ == "__main__":
    main()
