"""Contact: laws, points, stiffness, residual modes and the static analysis under the preload."""
