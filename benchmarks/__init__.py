"""Benchmarks: ratios within one run, printed as tables.  ``python -m benchmarks``."""

import re
from typing import Any

PLAIN: dict[str, Any] = {"contact_stiffness": "unit_traction", "blade_modes": 10, "harmonics": 1}
"""Settings of the benchmarks that name no others: what they measured before a study had residual modes by default."""


def fill(text: str, name: str, table: str) -> str:
    """The document with the table between the marks of a name replaced."""
    pattern = rf"(<!-- {name} -->\n).*?(<!-- end -->)"
    if not re.search(pattern, text, re.S):
        raise ValueError(f"no place for '{name}' in the document")
    return re.sub(pattern, lambda m: m.group(1) + table + "\n" + m.group(2), text, flags=re.S)
