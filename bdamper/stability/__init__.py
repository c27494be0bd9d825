"""Stability of periodic solutions and integration in time."""
