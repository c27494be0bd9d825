"""Studies with settings that cost little, named in one place: unit tractions, ten blade modes, one harmonic.

Tests of what does not depend on the accuracy of the reduced model use them.
"""

from __future__ import annotations

from typing import Any

import bdamper as bd

PLAIN = {"contact_stiffness": "unit_traction", "blade_modes": 10, "harmonics": 1}


def plain_study(*args: Any, **settings: Any) -> bd.Study:
    """A study with these settings, unless others are given."""
    return bd.Study(*args, **(PLAIN | settings))
