"""Accuracy: what richer settings would change, and what accuracy costs in time."""
