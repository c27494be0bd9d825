"""The rotation that carries one sector onto the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def turn(angle: float) -> NDArray:
    """Rotation matrix (3, 3) about Z that turns +Y toward +X by ``angle`` (rad)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
