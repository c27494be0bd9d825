"""Run the examples, write their figures and print the time of each.

    python tools/run_examples.py [--figures figures] [name ...]

Every example gets a folder of its own below ``figures``, with its pictures and what it printed (``output.txt``); the times
go to ``examples.json`` there, from which the gallery of the documentation is made.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def summary(path: Path) -> str:
    """First line of the docstring of an example."""
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or path.stem).splitlines()[0]


def run(path: Path, folder: Path) -> tuple[float, int]:
    """Run one example; returns seconds and exit status."""
    folder.mkdir(parents=True, exist_ok=True)
    environment = {"MPLBACKEND": "Agg", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", **os.environ}
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, str(path), "--figures", str(folder)],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    seconds = time.perf_counter() - start
    (folder / "output.txt").write_text(done.stdout, encoding="utf-8")
    if done.returncode:
        print(done.stderr, file=sys.stderr)
    return seconds, done.returncode


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="beginnings of file names; all figures of the paper by default")
    parser.add_argument("--figures", type=Path, default=ROOT / "figures", help="where to write figures")
    arguments = parser.parse_args()
    found = sorted((ROOT / "examples").glob("fig*.py"))
    if arguments.names:
        found = [path for path in found if path.stem.startswith(tuple(arguments.names))]
    results, failed = {}, []
    for path in found:
        seconds, status = run(path, arguments.figures / path.stem)
        results[path.stem] = {"seconds": round(seconds, 2), "summary": summary(path)}
        failed += [path.stem] if status else []
        print(f"{path.stem:32}{seconds:8.1f} s{'  FAILED' if status else ''}", flush=True)
    (arguments.figures / "examples.json").write_text(json.dumps(results, indent=2), encoding="utf-8")
    print(f"{'in all':32}{sum(r['seconds'] for r in results.values()):8.1f} s")
    return 1 if failed or not found else 0


if __name__ == "__main__":
    sys.exit(main())
