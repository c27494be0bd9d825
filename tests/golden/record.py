"""Record the answers of all scenes: ``python -m tests.golden.record`` writes answers.json with values and counts.

A scene whose value changes on purpose is recorded anew by name, ``python -m tests.golden.record NAME ...``, and the reason
stands in the changelog.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from tests.golden.scenes import SCENES

FILE = Path(__file__).with_name("answers.json")


def main(names: list[str]) -> None:
    answers = json.loads(FILE.read_text()) if FILE.exists() else {}
    for name in names or SCENES:
        start = time.process_time()
        values, counts = SCENES[name]()
        print(f"{time.process_time() - start:7.2f} s  {name}: {counts}", flush=True)
        answers[name] = {"values": values, "counts": counts}
    FILE.write_text(
        json.dumps({name: answers[name] for name in SCENES if name in answers}, indent=1) + "\n"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
