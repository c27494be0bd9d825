"""Benchmarks: ratios within one run, printed as tables.  ``python -m benchmarks``."""

from typing import Any

PLAIN: dict[str, Any] = {"contact_stiffness": "unit_traction", "blade_modes": 10, "harmonics": 1}
"""Settings of the benchmarks that name no others: what they measured before a study had residual modes by default."""
