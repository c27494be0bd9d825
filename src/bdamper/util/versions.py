"""Which versions of the package and of its numerical libraries a result was made with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Any


@dataclass(frozen=True)
class Versions:
    """Versions of bdamper, NumPy and SciPy.

    Parameters
    ----------
    bdamper, numpy, scipy : str
    """

    bdamper: str = "unknown"
    numpy: str = "unknown"
    scipy: str = "unknown"

    @classmethod
    def stored(cls, attributes: Mapping[str, Any]) -> Versions:
        """Versions stored in the attributes of a file."""
        names = {name: attributes.get(f"{name}_version") for name in asdict(cls())}
        return cls(**{name: str(value) for name, value in names.items() if value is not None})

    def attributes(self) -> dict[str, str]:
        """Versions as attributes of a file."""
        return {f"{name}_version": version for name, version in asdict(self).items()}

    def __str__(self) -> str:
        return f"bdamper {self.bdamper}, NumPy {self.numpy}, SciPy {self.scipy}"


HERE = Versions(*(metadata.version(name) for name in ("bdamper", "numpy", "scipy")))
"""Of the running process."""
