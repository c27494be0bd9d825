"""Checks of a model in memory (placeholder of the numerical checks)."""

from __future__ import annotations

from bdamper.errors import ModelError
from bdamper.model import Model


def check_model(model: Model, *, where: str = "model") -> None:
    if not isinstance(model, Model):
        raise ModelError(f"{where}: expected a Model, found {type(model).__name__}")
