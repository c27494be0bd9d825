"""Pictures of the manual that need a browser or a long computation.

``python -m tools.manual_pictures`` draws all of them into docs/images; names as arguments select some:

* ``left-out``: a response curve at very low preload, with the ranges that have no solution
  (docs/messages.md).
* ``mode-point``: contact states where a nonlinear mode has its largest damping
  (docs/nonlinear-modes.md).
* ``designs``, ``contacts``: three designs, and what the contacts of one do (docs/how-to.md).
* ``advice``: effects and their changes of a peak (docs/accuracy.md).
* ``campbell``: frequencies against speed, with the lines of two engine orders (docs/speed.md).
* ``interference``: what the assembly load of a shroud does (docs/joints.md).
* ``rubbing``: a blade that rubs on the ground, with two folds (docs/lumped.md).
* ``report``: the beginning of the report of the typical blade (docs/fit.md).
* ``explorer``: the explorer of the typical blade in a window of 1280 by 800 pixels
  (docs/how-to.md).

Report and explorer need the extras ``bdamper[app-test]`` and ``bdamper[report]``, and a browser (Debian:
chromium, chromium-driver).
"""

from __future__ import annotations

import argparse
import base64
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bdamper as bd
from bdamper.plot import new_axes, plot_curve, save_figure
from tests.chromium import MISSING, headless, is_installed

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
SCALE = 2
"""Pixels of a picture for each pixel of the window, for sharp letters in print."""
REPORT_SIZE, EXPLORER_SIZE = (775, 1000), (1280, 800)
"""Width and height of the windows (pixels)."""
LONGEST = 600.0
"""Longest time (s) until the explorer has computed everything."""


def typical_blade() -> bd.Study:
    """Return the study of examples/demo.py."""
    return bd.Study(
        bd.reference_model("turbine_blade"),
        bd.Excitation("tip", direction="tangential", amplitude=1.0),
        engine_order=5,
        friction_coefficient=0.3,
    )


def difficult_disk(**settings: Any) -> bd.Study:
    """Return the study of the recipes, with settings other than the defaults."""
    return bd.Study(
        bd.reference_model("bladed_disk", contact_points=9),
        bd.Excitation("tip", direction="tangential", amplitude=1.0),
        engine_order=5,
        friction_coefficient=0.3,
        **settings,
    )


QUICK = {"harmonics": 1, "contact_stiffness": "unit_traction", "blade_modes": 5}
"""Settings of the recipes."""


def left_out() -> None:
    """Draw a response curve at very low preload."""
    study = difficult_disk()
    curve = study.frequency_response(12.0, (250.0, 400.0))
    ax = plot_curve(curve, new_axes(4.4, 2.8))
    ax.set(xlim=(255.0, 315.0), ylim=(1.5e-5, None))
    save_figure(ax, IMAGES / "left-out.png")


def mode_point() -> None:
    """Draw the contact states where a nonlinear mode has its largest damping."""
    study = difficult_disk()
    mode = study.nonlinear_mode(500.0, 1, (5e-5, 5e-4))
    nearest = int(abs(mode.amplitude - 2e-4).argmin())
    save_figure(mode.plot_contacts(study, point=nearest), IMAGES / "mode-point.png")


def designs() -> None:
    """Draw response curves of three designs."""
    study = difficult_disk(**QUICK)
    changes = {
        "half the friction": {"friction_coefficient": 0.15},
        "damper 50 % heavier": {"damper_mass_factor.damper": 1.5},
    }
    compared = bd.compare(
        {"now": study} | changes, lambda s: s.frequency_response(500.0, (280.0, 380.0))
    )
    save_figure(compared.plot(), IMAGES / "designs.png")


def contacts() -> None:
    """Draw loops, energy and equivalent stiffness and damping of the faces of a damper."""
    study = difficult_disk(**QUICK)
    curve = study.frequency_response(500.0, (280.0, 380.0))
    cycle = study.hysteresis(curve)
    cycle.plot(IMAGES / "loop_faces.png", where=["left", "right"])
    cycle.plot_energy(IMAGES / "energy.png")
    study.dissipation(curve).plot(IMAGES / "losses.png", over="frequency")


def advice() -> None:
    """Draw the change of a peak without each effect."""
    study = difficult_disk(harmonics=1, blade_modes=5)
    found = study.effect_significance(5000.0, (250.0, 400.0), tolerance=0.01)
    save_figure(found.plot(), IMAGES / "advice.png")


def campbell() -> None:
    """Draw the Campbell diagram of the typical blade."""
    found = typical_blade().campbell((300.0, 1000.0), engine_orders=(5, 10), modes=2)
    save_figure(found.plot(), IMAGES / "campbell.png")


def interference() -> None:
    """Draw first slip and highest peak of the shipped shrouded blade against its assembly load."""
    study = bd.Study(
        bd.reference_model("shrouded_blade"),
        bd.Excitation("tip", direction="axial", amplitude=0.5),
        engine_order=4,
        harmonics=1,
        load_per_preload={"front": 1.0, "rear": 0.6},
        constant_loads={"shroud": 20.0},
    )
    task = bd.PeakTask(preload=50.0, frequency=(800.0, 1640.0), shroud="shroud")
    loads = [3.0, 10.0, 30.0, 100.0, 300.0, 1000.0]
    found = bd.sweep(study, {"constant_loads.shroud": loads}, task)
    save_figure(found.plot(), IMAGES / "interference.png")


def rubbing() -> None:
    """Draw the response of two masses of which one rubs on the ground."""
    contact = bd.Contact(0, 1, kt=0.6, kn=6.0, mu=0.4, preload=0.35)
    study = bd.lumped(
        [1.0, 1.0],
        [0.05, 0.05],
        [[1.0, 0.3], [0.3, 2.0]],
        contacts=[contact],
        forces={0: 0.1, 1: 0.12},
        response=1,
        harmonics=13,
    )
    curve = study.frequency_response(0.0, (0.25, 0.54))
    save_figure(plot_curve(curve, new_axes(4.4, 2.8)), IMAGES / "rubbing.png")


# ---- Pages in a browser ----


@contextmanager
def browser(size: tuple[int, int]) -> Iterator[Any]:
    """Provide a browser without a window on the screen, of a size in pixels."""
    if not is_installed():
        sys.exit(MISSING)
    with headless("hide-scrollbars") as found:
        width, height = size
        metrics = {"width": width, "height": height, "deviceScaleFactor": SCALE, "mobile": False}
        found.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        yield found


def photograph(page: Any, path: Path, height: float, width: float) -> None:
    """Save the upper part of a page (pixels of the window) as a picture."""
    clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}
    options = {"format": "png", "clip": clip, "captureBeyondViewport": True}
    shot = page.execute_cdp_cmd("Page.captureScreenshot", options)
    path.write_bytes(base64.b64decode(shot["data"]))


def report() -> None:
    """Write the report of an optimal curve, and photograph it down to the end of the checks."""
    study = typical_blade()
    curve = study.optimal_curve((30.0, 1000.0), 12)
    with tempfile.TemporaryDirectory() as folder, browser(REPORT_SIZE) as page:
        path = Path(folder) / "review.html"
        curve.report(path, study)
        page.get(path.as_uri())
        end = page.execute_script(
            "const checks = [...document.querySelectorAll('h2')].find((e) => e.textContent === 'Checks');"
            "return checks.nextElementSibling.getBoundingClientRect().bottom"
        )
        photograph(page, IMAGES / "report.png", end + 12.0, REPORT_SIZE[0])


def explorer() -> None:
    """Photograph the explorer when all panels and the amplitude by time integration are there."""
    server = bd.explore(typical_blade())
    try:
        with browser(EXPLORER_SIZE) as page:
            page.get(server.address)
            begin = time.monotonic()
            while not page.execute_script(
                "if (!window.Bokeh || !Bokeh.documents.length) return false;"
                "const get = (n) => Bokeh.documents[0].get_model_by_name(n);"
                "return !get('busy').visible && get('answer').text.includes('★')"
            ):
                if time.monotonic() > begin + LONGEST:
                    sys.exit(f"the explorer is not ready after {LONGEST:g} s")
                time.sleep(0.5)
            photograph(page, IMAGES / "explorer.png", EXPLORER_SIZE[1], EXPLORER_SIZE[0])
    finally:
        server.close()


PICTURES: dict[str, Callable[[], None]] = {
    "left-out": left_out,
    "mode-point": mode_point,
    "designs": designs,
    "contacts": contacts,
    "advice": advice,
    "campbell": campbell,
    "interference": interference,
    "rubbing": rubbing,
    "report": report,
    "explorer": explorer,
}


def main() -> None:
    """Draw the pictures that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"out of {', '.join(PICTURES)}; all by default")
    for name in parser.parse_args().names or PICTURES:
        PICTURES[name]()


if __name__ == "__main__":
    main()
