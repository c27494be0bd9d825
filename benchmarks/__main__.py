"""Runs every benchmark of this directory, or those named: ``python -m benchmarks [core tracking ...]``."""

from __future__ import annotations

import importlib
import pkgutil
import sys

import benchmarks


def main() -> None:
    modules = [m.name for m in pkgutil.iter_modules(benchmarks.__path__)]
    names = [name.removeprefix("bench_") for name in modules if name.startswith("bench_")]
    asked = sys.argv[1:] or names
    unknown = [name for name in asked if name not in names]
    if unknown:
        sys.exit(f"benchmarks: expected names out of {names}, found {unknown}")
    sys.argv[1:] = []  # a benchmark must not read these arguments
    for name in asked:
        print(f"# {name}\n", flush=True)
        importlib.import_module(f"benchmarks.bench_{name}").main()


if __name__ == "__main__":
    main()
