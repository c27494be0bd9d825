"""Predictions beside measurements: ``python -m benchmarks.rigs [FOLDER]``.

It writes the tables of docs/measurements.md and the picture of the friction-damped beam, which needs
no file.  The Brake-Reuss beam needs FOLDER with the public files

* ``brb_force_controlled.csv``: stepped sines (Chen et al., MSSP 166, 2022, 108401 and 108402), with
  the columns level, frequency (Hz), force (N), acceleration (m/s^2) and phase (rad);
* ``brb_hammer_mode.csv``: frequency and damping ratio over amplitude from a hammer test of the same
  beam.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import brentq

import bdamper as bd
from bdamper.analyses.nonlinear_mode import NonlinearMode
from bdamper.importers import MeasuredMode, read_mode, read_responses

MODAL_MASS = 1.9505
"""Of the first bending mode of the Brake-Reuss beam at the accelerometer, from its lowest sweep, kg."""
NOISE = 0.05


# ---- Friction-damped beam ----


CONTACT_STIFFNESS, FRICTION_LIMIT = 1e8, 106.0
"""Of the Jenkins element, N/m and N."""
MEASURED_FREQUENCIES = (107.621, 428.744, 1279.82)
"""Frequencies (Hz) of the rig at small amplitude, measured in 2025 (repository maltekrack/NLtest, BT02)."""
MEASURED_SHIFT, MEASURED_DAMPING = 0.36, 0.15
"""Published decrease of the first frequency from stick to sliding, and highest damping ratio."""
AT_CONTACT, AT_TIP = 2 * 5 - 2, 2 * 14 - 2
"""Deflections of node 5 and of the tip among the degrees of freedom."""


def beam_matrices() -> tuple[NDArray, NDArray]:
    """Return mass and stiffness of a cantilever after the public parameters of NLvib's example 10.

    It has a length of 0.71 m and a section 50 mm high and 60 mm wide, in 14 Euler-Bernoulli
    elements.  The degrees of freedom are deflection and rotation of each node from the second on.
    """
    length, height, width, n_elements = 0.710, 0.05, 0.06, 14
    youngs_modulus, density = 0.6725 * 210e9, 7850.0

    area, second_moment = width * height, width * height**3 / 12.0
    e = length / n_elements
    bending = np.array(
        [
            [12.0, 6.0 * e, -12.0, 6.0 * e],
            [6.0 * e, 4.0 * e**2, -6.0 * e, 2.0 * e**2],
            [-12.0, -6.0 * e, 12.0, -6.0 * e],
            [6.0 * e, 2.0 * e**2, -6.0 * e, 4.0 * e**2],
        ]
    )
    inertia = np.array(
        [
            [156.0, 22.0 * e, 54.0, -13.0 * e],
            [22.0 * e, 4.0 * e**2, 13.0 * e, -3.0 * e**2],
            [54.0, 13.0 * e, 156.0, -22.0 * e],
            [-13.0 * e, -3.0 * e**2, -22.0 * e, 4.0 * e**2],
        ]
    )
    n = 2 * n_elements + 2
    stiffness, mass = np.zeros((n, n)), np.zeros((n, n))
    for k in range(n_elements):
        nodes = slice(2 * k, 2 * k + 4)
        stiffness[nodes, nodes] += youngs_modulus * second_moment / e**3 * bending
        mass[nodes, nodes] += density * area * e / 420.0 * inertia
    # deflection and rotation of the clamped end are zero
    return mass[2:, 2:], stiffness[2:, 2:]


def stuck_frequencies(contact_stiffness: float) -> NDArray:
    """Return the natural frequencies (Hz) of the beam with a sticking contact (N/m)."""
    mass, stiffness = beam_matrices()
    stiffness[AT_CONTACT, AT_CONTACT] += contact_stiffness
    return np.sqrt(eigh(stiffness, mass, eigvals_only=True)) / (2.0 * np.pi)


def fitted_stiffness() -> float:
    """Return the contact stiffness (N/m) with which the beam has the measured first frequency."""
    return float(
        brentq(lambda k: stuck_frequencies(k)[0] - MEASURED_FREQUENCIES[0], 1e7, CONTACT_STIFFNESS)
    )


def friction_damped_beam(
    harmonics: int, n_modes: int = 6, contact_stiffness: float = CONTACT_STIFFNESS
) -> bd.Study:
    """Return the beam with a Jenkins element on the deflection of node 5 from the clamped end.

    Modes above ``n_modes`` are condensed into a spring in series with the element.
    """
    mass, stiffness = beam_matrices()
    omega2, shapes = eigh(stiffness, mass)
    at_contact, at_tip = shapes[AT_CONTACT], shapes[AT_TIP]
    residual = float((at_contact[n_modes:] ** 2 / omega2[n_modes:]).sum())
    kt = 1.0 / (1.0 / contact_stiffness + residual)
    sliding = {k: float(at_contact[k]) for k in range(n_modes)}
    tip = {k: float(at_tip[k]) for k in range(n_modes)}
    return bd.lumped(
        np.ones(n_modes),
        np.zeros(n_modes),
        omega2[:n_modes],
        contacts=[bd.Contact(sliding, kt=kt, mu=1.0, preload=FRICTION_LIMIT)],
        forces=tip,
        response=tip,
        harmonics=harmonics,
    )


def beam_rows() -> list[str]:
    """Return the rows of the friction-damped beam for both stiffnesses and numbers of harmonics."""
    rows = []
    for name, contact_stiffness in (("public", CONTACT_STIFFNESS), ("fitted", fitted_stiffness())):
        for harmonics in (1, 3, 9):
            mode = beam_mode(harmonics, contact_stiffness)
            top = int(mode.damping_ratio.argmax())
            shift = 1.0 - mode.frequency.min() / mode.frequency.max()
            rows.append(
                f"| {name}, {contact_stiffness:.4g} N/m | {harmonics} | "
                f"{100.0 * mode.damping_ratio[top]:.1f} % at {1e6 * mode.amplitude[top]:.0f} µm | "
                f"{100.0 * shift:.1f} % | {mode.status} |"
            )
    return rows


def beam_mode(harmonics: int, contact_stiffness: float) -> NonlinearMode:
    """Return the first nonlinear mode of the beam."""
    study = friction_damped_beam(harmonics, contact_stiffness=contact_stiffness)
    return study.nonlinear_mode(0.0, 1, (1e-5, 2e-2))


def frequency_rows() -> list[str]:
    """Return the natural frequencies of the sticking beam beside the measured ones."""
    public, fitted = stuck_frequencies(CONTACT_STIFFNESS), stuck_frequencies(fitted_stiffness())
    return [
        f"| {mode} | {measured:.1f} | {public[mode - 1]:.1f} | {fitted[mode - 1]:.1f} |"
        for mode, measured in enumerate(MEASURED_FREQUENCIES, 1)
    ]


def draw_beam(path: Path) -> None:
    """Draw frequency and damping of the beam over the amplitude, with the published values."""
    import matplotlib.pyplot as plt

    figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(5.0, 5.0))
    for harmonics, style in ((1, ":"), (3, "-"), (9, "--")):
        mode = beam_mode(harmonics, fitted_stiffness())
        micrometres = 1e6 * mode.amplitude
        label = f"computed, {harmonics} harmonic" + "s" * (harmonics > 1)
        upper.plot(micrometres, mode.frequency, color="0.1", linestyle=style, label=label)
        lower.plot(micrometres, 100.0 * mode.damping_ratio, color="0.1", linestyle=style)
    stick = MEASURED_FREQUENCIES[0]
    upper.axhline(stick, color="C3", label="measured in stick")
    sliding = (1.0 - MEASURED_SHIFT) * stick
    upper.axhline(sliding, color="C3", linestyle="--", label="measured in sliding, 36 % lower")
    lower.axhline(100.0 * MEASURED_DAMPING, color="C3", label="measured, up to 15 %")
    upper.set(ylabel="Frequency (Hz)")
    lower.set(xscale="log", xlabel="Amplitude of the tip (µm)", ylabel="Damping ratio (%)")
    for axes in (upper, lower):
        axes.legend(fontsize=7.0)
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


# ---- Brake-Reuss beam ----


def brake_reuss_beam(
    frequency: float = 80.4,
    damping_ratio: float = 1.5e-3,
    stiffness: float = 2e4,
    friction: float = 5.0,
    exponent: float = 1.0,
) -> bd.Study:
    """Return the first mode of the beam with its lap joint."""
    return bd.joint(frequency, damping_ratio, stiffness, friction, exponent, mass=MODAL_MASS)


RANGES = {
    "frequency": (79.0, 82.0),
    "damping_ratio": (1e-4, 1e-2),
    "stiffness": (1e3, 4e5),
    "friction": (0.1, 500.0),
    "exponent": (0.1, 4.0),
}


def resonances(runs: Sequence[bd.MeasuredResponse]) -> MeasuredMode:
    """Return amplitude, frequency and damping ratio of each sweep at its highest point.

    In resonance the force F balances the damping: zeta = F / (2 m a) with the acceleration a.
    """
    amplitude, frequency, damping_ratio = [], [], []
    for run in runs:
        top = int(run.data.amplitude.argmax())
        amplitude.append(abs(run.data.displacement[top]))
        frequency.append(run.data.frequency[top])
        damping_ratio.append(run.data.force[top] / (2.0 * MODAL_MASS * run.data.amplitude[top]))
    return MeasuredMode(np.array(amplitude), np.array(frequency), np.array(damping_ratio))


def deviations(study: bd.Study, measured: MeasuredMode) -> tuple[NDArray, NDArray]:
    """Return the relative deviations of damping ratio and frequency at the measured amplitudes."""
    low, high = 0.5 * measured.amplitude.min(), 1.3 * measured.amplitude.max()
    mode = study.nonlinear_mode(0.0, 1, (low, high))
    damping_ratio = np.interp(measured.amplitude, mode.amplitude, mode.damping_ratio)
    frequency = np.interp(measured.amplitude, mode.amplitude, mode.frequency)
    return damping_ratio / measured.damping_ratio - 1.0, frequency / measured.frequency - 1.0


Deviations = tuple[NDArray, NDArray, NDArray, NDArray]
"""Of damping ratio and frequency in the hammer test, and of both in the sweeps."""


def fitted_to(folder: Path) -> dict[str, Deviations]:
    """Return for each set of fitted tests the deviations from the hammer test and from the sweeps."""
    hammer = read_mode(folder / "brb_hammer_mode.csv")
    sweeps = [
        bd.MeasuredResponse(run)
        for run in read_responses(folder / "brb_force_controlled.csv", "level", phase_of="none")
    ]
    tests = {"sweeps": sweeps, "hammer test": [hammer], "both": [*sweeps, hammer]}
    out = {}
    for name, used in tests.items():
        found = bd.fit(brake_reuss_beam, used, RANGES, noise=NOISE, intervals="linear")
        study = found.apply(brake_reuss_beam)
        out[name] = (*deviations(study, hammer), *deviations(study, resonances(sweeps)))
    return out


def span_of(deviation: NDArray, digits: int = 0) -> str:
    """Return the least and the largest deviation in per cent."""
    low, high = 100.0 * deviation.min(), 100.0 * deviation.max()
    return f"{low:+.{digits}f} to {high:+.{digits}f} %"


def rows_of(computed: Mapping[str, Deviations]) -> list[str]:
    """Return the rows of the Brake-Reuss beam by the tests to which it is fitted."""
    rows = []
    for name, (of_hammer, f_hammer, of_sweeps, f_sweeps) in computed.items():
        rows.append(
            f"| {name} | {span_of(of_hammer)} | {span_of(f_hammer, 2)} | "
            f"{', '.join(f'{100.0 * x:+.0f}' for x in of_sweeps)} % | {span_of(f_sweeps, 2)} |"
        )
    return rows


# ---- Reduction by the dampers of the first page ----


def reduction_rows() -> list[str]:
    """Return how far the dampers of the typical blade lower its peak, for several damping ratios."""
    study = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), engine_order=5)
    rows = []
    for damping_ratio in (0.002, 0.004, 0.006):
        damped = study.replace(damping_ratio=damping_ratio)
        curve = damped.optimal_curve((30.0, 1000.0), 12, check=False)
        free = curve.free.amplitude
        best = curve.optimum
        others = [damped.peak(factor * best.preload).amplitude for factor in (2.0, 4.0)]
        cells = " | ".join(f"{free / amplitude:.1f}" for amplitude in (best.amplitude, *others))
        rows.append(f"| {100.0 * damping_ratio:.1f} % | {cells} |")
    return rows


# ---- Page ----

PAGE = Path(__file__).resolve().parents[1] / "docs" / "measurements.md"
OF_BEAM = "| contact stiffness | harmonics | largest damping ratio | frequency shift | status |"
OF_FREQUENCIES = "| mode | measured (Hz) | public stiffness (Hz) | fitted stiffness (Hz) |"
OF_JOINT = (
    "| fitted to | damping, hammer | frequency, hammer | damping, sweeps | frequency, sweeps |"
)
OF_REDUCTION = (
    "| damping ratio | at the optimum | at twice this preload | at four times this preload |"
)
"""Heads of the tables that the command writes."""


def with_table(page: str, head: str, rows: Sequence[str]) -> str:
    """Return the page with other rows in the table that has a head."""
    lines = page.splitlines()
    # a line of dashes follows the head
    first = lines.index(head) + 2
    end = first
    while end < len(lines) and lines[end].startswith("|"):
        end += 1
    return "\n".join([*lines[:first], *rows, *lines[end:]]) + "\n"


def main() -> None:
    """Write the tables and the picture of the page."""
    page = PAGE.read_text(encoding="utf-8")
    page = with_table(page, OF_BEAM, beam_rows())
    page = with_table(page, OF_FREQUENCIES, frequency_rows())
    page = with_table(page, OF_REDUCTION, reduction_rows())
    if len(sys.argv) > 1:
        page = with_table(page, OF_JOINT, rows_of(fitted_to(Path(sys.argv[1]))))
    PAGE.write_text(page, encoding="utf-8")
    draw_beam(PAGE.parent / "images" / "friction-damped-beam.png")


if __name__ == "__main__":
    main()
