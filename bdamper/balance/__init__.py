"""Harmonic balance: the equations of one preload, assembled and solved by the C core."""
