"""Reading and writing of models."""

from bdamper.io.model_file import load_model, save_model

__all__ = ["load_model", "save_model"]
