"""One response curve by the installed package, away from its sources; fails where something is missing."""

import subprocess
from importlib import metadata
from pathlib import Path

import numpy as np

import bdamper as bd

PEAK = (2.99575e-4, 359.839)
"""Amplitude (m) and frequency (Hz) of the first mode of the shipped disk under 2000 N, as in the example of `bd.Study`."""

package = Path(bd.__file__).parent
assert "site-packages" in package.parts, f"not the installed package: {package}"
assert (package / "py.typed").is_file(), (
    "py.typed is missing: type checkers would not read the hints"
)
assert bd.__version__ == metadata.version("bdamper"), (bd.__version__, metadata.version("bdamper"))
files = metadata.files("bdamper") or []
assert any(f.name == "LICENSE" for f in files), "the licence is missing"
assert not any(f.parts[0] == "tests" or f.suffix == ".c" for f in files), (
    "tests or sources were installed"
)

assert metadata.metadata("bdamper")["License-Expression"] == "BSD-3-Clause"
assert sum(path.stat().st_size for path in (package / "data").iterdir()) < 7.8e6, (
    "more models than the wheel has room for"
)
message = "it came from somewhere, though scikit-fem is not installed"
try:
    bd.reference_model("paper_disk", 48)
except bd.BdamperError as error:
    message = str(error)
assert "bdamper[fe]" in message, message

model = bd.reference_model("bladed_disk")
study = bd.Study(
    model,
    engine_order=5,
    friction_coefficient=0.3,
    excitation=bd.Excitation("tip", direction="tangential", amplitude=1.0),
)
curve = study.frequency_response(preload=2000.0, frequency=(270.0, 370.0))
print(curve)
assert curve.complete
np.testing.assert_allclose((curve.peak.amplitude, curve.peak.frequency), PEAK, rtol=1e-4)
subprocess.run(["bdamper", "optimum", "--demo", "--png", "optimum.png"], check=True)
assert Path("optimum.png").read_bytes()[1:4] == b"PNG"
print(f"bdamper {bd.__version__}: wheel complete, peak as expected")
