"""Tell which external links of the documentation are gone; what cannot be reached, as without a network, is only counted.

    python tools/check_links.py docs/_build/linkcheck/output.json

The file is that of ``sphinx -b linkcheck``.  Links inside the documentation are checked by ``make docs`` and by the tests.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

GONE = ("404", "410", "Anchor")
"""What the report of a link begins with, or contains after a colon, whose page or place in it does not exist any more."""


def main(path: str) -> int:
    """Print links that are gone and how many there are of each kind; 1 if one is gone and others show a network."""
    found = [json.loads(line) for line in Path(path).read_text(encoding="utf-8").splitlines()]
    broken = [link for link in found if link["status"] == "broken"]
    gone = [link for link in broken if any(word in link["info"] for word in GONE)]
    for link in gone:
        print(f"{link['filename']}:{link['lineno']}: {link['uri']}: {link['info']}")
    working = sum(link["status"] in ("working", "redirected") for link in found)
    print(
        f"{working} links work, {len(gone)} are gone, {len(broken) - len(gone)} could not be reached"
    )
    return 1 if gone and working else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
