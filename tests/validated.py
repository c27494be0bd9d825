"""Public problems and closed forms beside the answers of the package: one place for the page, its command and the tests.

Every problem is a function that computes it anew: where it comes from, numbers beside each other with a tolerance, and a
picture.  ``make validate`` writes them into ``docs/evidence/validated.md``.  A row that is known not to agree says why.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

import bdamper as bd
from bdamper.plot import colours
from bdamper.plot.axes import DASHED, MARKERS, STYLES, runs
from tests.analyses import jenkins, wedge

TWO_PI = 2.0 * np.pi


class Row(NamedTuple):
    """One quantity: what it should be, what the package says, relative tolerance, and why it may differ, if it does."""

    quantity: str
    reference: float
    ours: float
    tolerance: float
    differs: str = ""

    @property
    def error(self) -> float:
        return abs(self.ours / self.reference - 1.0)

    @property
    def agrees(self) -> bool:
        return self.error <= self.tolerance


@dataclass(frozen=True)
class Problem:
    """A problem, computed.

    Parameters
    ----------
    source, measure : str
        Where the reference comes from, and what is compared.
    rows : tuple of Row
    draw : callable
        Draws the picture into axes, into a list of them where there are several panels.
    panels : int
    """

    source: str
    measure: str
    rows: tuple[Row, ...]
    draw: Callable[[Any], None]
    panels: int = 1


def _over(ax, x, reference, ours, xlabel, ylabel, log=False):
    """A reference as a line, our points on it."""
    ax.plot(*reference, "-", color="0.6", linewidth=2.5, label="reference")
    ax.plot(
        x, ours, "o", color=colours(1)[0], markersize=3.0 if len(x) > 10 else 6.0, label="bdamper"
    )
    ax.set(xlabel=xlabel, ylabel=ylabel, **({"xscale": "log"} if log else {}))


def _parts(ax, x, y, unstable, label, **look):
    """A curve, dashed where it is not stable."""
    for first, last in runs(unstable):
        part = slice(first, last + 2)  # joined to the next stretch
        ax.plot(x[part], y[part], **{**look, "linestyle": DASHED if unstable[first] else "-"})
    ax.plot([], [], label=label, **look)


def _dashed(ax, text="unstable", colour="k"):
    """What dashes mean, for the legend."""
    ax.plot([], [], color=colour, linestyle=DASHED, label=text)


def _circles(ax, x, y, label, **look):
    """Values of the reference, as open marks."""
    marks = {
        "linestyle": "none",
        "marker": "o",
        "color": "k",
        "markersize": 7.0,
        "markerfacecolor": "none",
    }
    ax.plot(x, y, **{**marks, "label": label, **look})


def _limit(ax, y, text, colour="0.45", right=True, above=True):
    """A thin level line that bears its name at its right or left end."""
    ax.axhline(y, color=colour, linewidth=0.9, zorder=0)
    look = {
        "ha": "right" if right else "left",
        "va": "bottom" if above else "top",
        "fontsize": 7.0,
        "color": colour,
    }
    place = {"xycoords": ax.get_yaxis_transform(), "textcoords": "offset points"}
    ax.annotate(
        text, (float(right), y), xytext=(0 if right else 3, 2 if above else -2), **place, **look
    )


OVER_SLIP = "Amplitude over that of first slip"
"""Name of an axis."""


# ---- oscillators ----

GRIFFIN = {0.5: (18.94337543, 1.00334229), 1.5: (2.91810452, 1.23088592)}
"""Amplitude and frequency (rad/s) of the peak by slip limit."""
LEAST = 1.470413, 2.91702888
"""Slip limit of the least peak, and that peak."""


def griffin() -> Problem:
    rows, found = [], []
    for limit in np.arange(0.5, 2.6, 0.125):
        contact = bd.Contact(0, kt=1.0, mu=0.5, preload=2.0 * limit)
        peak = bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=1).peak(
            0.0, (0.1, 0.3)
        )
        found.append((limit, peak.amplitude))
        if limit in GRIFFIN:
            amplitude, omega = GRIFFIN[limit]
            rows += [
                Row(f"peak at the limit {limit}", amplitude, peak.amplitude, 2e-8 / amplitude),
                Row(
                    f"its frequency (rad/s) at the limit {limit}",
                    omega,
                    TWO_PI * peak.frequency,
                    2e-8 / omega,
                ),
            ]
    contact = bd.Contact(0, 1, kt=1.0, kn=1.0, mu=0.5)
    study = bd.lumped(
        [1.0, 1.0],
        [0.02, 0.0],
        [1.0, 0.0],
        contacts=[contact],
        forces={0: 1.0},
        load_per_preload={1: 1.0},
        harmonics=1,
    )
    curve = study.optimal_curve((2.0, 4.0), 4, frequency=(0.1, 0.3), check=False)
    rows += [
        Row("limit of the least peak", LEAST[0], 0.5 * curve.optimum.preload, 1e-5),
        Row("least peak", LEAST[1], curve.optimum.amplitude, 1e-7),
    ]

    def draw(ax):
        reference = np.transpose([(limit, a) for limit, (a, _) in GRIFFIN.items()] + [LEAST])
        ax.plot(*np.transpose(found), ".-", color=colours(1)[0], label="bdamper")
        _circles(ax, *reference, "closed form")
        ax.set(xlabel="Slip limit (multiples of the exciting force)", yscale="log")
        ax.set(
            ylabel="Peak amplitude (multiples of force / stiffness)",
            title="Peaks of one mass meet the closed form",
        )

    return Problem(
        'J. H. Griffin, "Friction damping of resonant stresses in gas turbine engine airfoils", J. Eng. Power 102 (1980)',
        "one mass with an elastic friction element, one harmonic: peaks, and the slip limit of the lowest one",
        tuple(rows), draw,
    )  # fmt: skip


def _den_hartog(b, ratio):
    """Amplitude of the first harmonic of the motion without stops: each half period is one linear solution."""
    V, C, S = 1.0 / (1.0 - b**2), np.cos(np.pi / b), np.sin(np.pi / b)
    top = np.sqrt(V**2 - (ratio * S / (b * (1.0 + C))) ** 2)
    matrix = [[V, 0.0, 1.0, 0.0], [0.0, -V * b, 0.0, 1.0], [-V, 0.0, C, S], [0.0, V * b, -S, C]]
    c, s, cosine, sine = np.linalg.solve(matrix, [top - ratio, 0.0, -top - ratio, 0.0])
    nodes, weights = np.polynomial.legendre.leggauss(60)
    t = 0.5 * np.pi / b * (nodes + 1.0)
    x = V * (c * np.cos(b * t) - s * np.sin(b * t)) + ratio + cosine * np.cos(t) + sine * np.sin(t)
    return abs((weights * x) @ np.exp(-1j * b * t))


def den_hartog() -> Problem:
    rows, seen, steps = [], [], np.array([100.0, 400.0, 1600.0]) ** -0.5
    for b, ratio in ((0.8, 0.3), (0.8, 0.5), (1.25, 0.3), (1.25, 0.5)):
        found = []
        for step in steps:
            contact = bd.Contact(0, kt=step**-2, mu=0.5, preload=2.0 * ratio)
            study = bd.lumped(
                1.0, 0.0, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=tuple(range(1, 64, 2))
            )
            curve = study.frequency_response(0.0, (b / TWO_PI, 1.02 * b / TWO_PI))
            found.append(curve.amplitude[np.argmin(curve.frequency)])
        rigid, reference = float(np.polyfit(steps, found, 2)[2]), _den_hartog(b, ratio)
        rows.append(Row(f"frequency {b}, friction {ratio}: first harmonic", reference, rigid, 4e-3))
        seen.append((np.array(found), reference))

    def draw(ax):
        for (found, reference), row, colour in zip(seen, rows, colours(4)):
            ax.plot(steps, found, "o-", color=colour, label=row.quantity.partition(":")[0])
            _circles(ax, 0.0, reference, None)
        _circles(ax, [], [], "closed form, rigid")
        ax.set(
            xlabel="(contact stiffness / stiffness)$^{-1/2}$",
            ylabel="Amplitude of the first harmonic",
        )

    return Problem(
        'J. P. Den Hartog, "Forced vibrations with combined Coulomb and viscous friction", Trans. ASME 53 (1931)',
        "one mass with rigid friction: amplitude of the first harmonic, extrapolated from 32 odd harmonics and three "
        "contact stiffnesses",
        tuple(rows), draw,
    )  # fmt: skip


def _layers(n: int) -> NDArray:
    """Stiffness over tip deflection and slip at n points of two equal layers: E, width, depth of a layer and length are 1.

    The layers bend together (Hermite cubics) and stretch against each other (linear elements); the rest is condensed.
    """
    d, points = 1.0 / n, 3 * np.arange(n)
    w, a, b = np.array([12.0, 6.0 * d, -12.0, 6.0 * d]), 4.0 * d**2, 2.0 * d**2
    bend = np.array([w, [6.0 * d, a, -6.0 * d, b], -w, [6.0 * d, b, -6.0 * d, a]]) / 12.0 / d**3
    K = np.zeros((3 * n + 3, 3 * n + 3))  # deflection, angle and stretch of each point
    for first in points:
        K[np.ix_(first + [0, 1, 3, 4], first + [0, 1, 3, 4])] += 2.0 * bend
        K[np.ix_(first + [2, 5], first + [2, 5])] += 2.0 / d * np.array([[1, -1], [-1, 1]])
    motions = np.zeros((n + 1, 3 * n))
    motions[0, -3] = 1.0
    motions[1:][np.arange(n), points + 1], motions[1:][np.arange(n), points + 2] = (
        1.0,
        2.0,
    )  # slip h theta + 2 u
    return np.linalg.inv(motions @ np.linalg.solve(K[3:, 3:], motions.T))


def goodman_klumpp() -> Problem:
    """Units: E, width, depth of a layer and length are 1; the force slips both layers when friction is 3/4 of it."""
    n, shares, ours = 8, np.array([0.25, 0.5, 0.75]), []
    K, lengths = _layers(n), np.append(np.full(n - 1, 1.0 / n), 0.5 / n)
    slow = 1e-4 * np.sqrt(np.linalg.eigvalsh(K)[0]) / TWO_PI
    for share in shares:
        sliders = [
            bd.Contact(i + 1, kt=1e4 * l, mu=1.0, preload=0.75 * share * l)
            for i, l in enumerate(lengths)
        ]
        study = bd.lumped(
            np.ones(n + 1),
            np.zeros(n + 1),
            K,
            contacts=sliders,
            forces={0: 1.0},
            harmonics=tuple(range(1, 34, 2)),
        )
        curve = study.frequency_response(0.0, (slow, 1.02 * slow))
        ours.append(-np.pi * curve.harmonics[np.argmin(curve.frequency), 1].imag)

    def energy(share):  # 8 q L^3 (P - 4 q h/3)/(E b h^2), with the friction q = mu p b
        return 6.0 * share * (1.0 - share)

    # the loop of force and deflection is a parallelogram between the stiffness of one beam and that of two
    area = 4.0 * shares * (1.0 - shares) * (1.0 / (6.0 / 12.0) - 1.0 / (3.0 * 8.0 / 12.0))
    assert np.allclose(area, energy(shares), rtol=1e-12)
    rows = [
        Row(f"friction {a:g} of the limit: energy per cycle", energy(a), x, 0.015)
        for a, x in zip(shares, ours)
    ]

    def draw(ax):
        x = np.linspace(0.0, 1.0, 101)
        _over(
            ax,
            shares,
            (x, energy(x)),
            ours,
            "Friction over the friction at which nothing slips",
            "Energy per cycle",
        )

    return Problem(
        'L. E. Goodman and J. H. Klumpp, "Analysis of slip damping with reference to turbine-blade vibration", J. Appl. '
        "Mech. 23 (1956); derived again from the slip and from the stiffness of one beam and of two layers",
        "cantilever of two layers under uniform pressure, with a force at the tip: dissipation in slow cycles, 8 points, "
        "17 odd harmonics",
        tuple(rows), draw,
    )  # fmt: skip


DUFFING = {
    "hardening": (1.0, 0.1, 0.2),
    "softening": (-0.1, 0.05, 0.06),
    "NLvib, example 1": (0.1, 0.05, 0.18),
}
"""Cubic stiffness, damping, force."""


def _duffing_form(k, c, F, top):
    """Two branches of the closed form up to the peak, (2, n) frequencies (rad/s) and (n,) amplitudes, and its folds."""
    a = np.linspace(1e-2, top, 20_000)[:-1]
    p = 1.0 + 0.75 * k * a**2
    root = np.sqrt(np.maximum((p - 0.5 * c**2) ** 2 - p**2 + (F / a) ** 2, 0.0))
    squares = p - 0.5 * c**2 + root * np.array([[-1.0], [1.0]])
    w = np.sqrt(np.where(squares > 0.0, squares, np.nan))
    turns = [(branch[i + 1], a[i + 1]) for branch in w for i in np.flatnonzero(np.diff(np.sign(np.diff(branch))))
             if np.isfinite(branch[i : i + 3]).all()]  # fmt: skip
    return w, a, turns


def duffing() -> Problem:
    rows, curves = [], []
    for name, (k, c, F) in DUFFING.items():
        curve = bd.lumped(1.0, c, 1.0, cubic={0: k}, forces={0: F}, harmonics=1).frequency_response(
            0.0, (0.05, 0.35)
        )
        a, w = curve.amplitude, TWO_PI * curve.frequency
        assert curve.complete
        force = np.hypot(1.0 - w**2 + 0.75 * k * a**2, c * w) * a
        worst = int(np.argmax(np.abs(force / F - 1.0)))
        # both branches exist where the frequency equation, quadratic in w^2, has real roots
        top = brentq(
            lambda a, k=k, c=c, F=F: 1.0 + 0.75 * k * a**2 - 0.25 * c**2 - (F / (a * c)) ** 2,
            0.5,
            3.0,
        )
        rows += [
            Row(f"{name}: worst force", F, float(force[worst]), 1e-7),
            Row(f"{name}: peak", top, curve.peak.amplitude, 1e-7),
            Row(f"{name}: folds", 2.0, float(len(curve.folds)), 0.0),
        ]
        peak = np.sqrt(1.0 + 0.75 * k * top**2 - 0.5 * c**2), top
        curves.append((name, w, a, curve.backward, _duffing_form(k, c, F, top), peak))

    def draw(ax):
        called = {"NLvib, example 1": "the system of\nNLvib's example 1"}
        for i, ((name, w, a, unstable, (freq, height, folds), peak), colour) in enumerate(
            zip(curves, colours(3))
        ):
            for branch in freq:
                ax.plot(branch, height, color="0.85", linewidth=5.0, zorder=0)
            _parts(ax, w, a, unstable, f"bdamper, {called.get(name, name)}", color=colour)
            _circles(
                ax, *np.transpose([peak, *folds]), "closed form: peak, folds" if i == 2 else None
            )
        ax.plot([], [], color="0.85", linewidth=5.0, label="closed form")
        _dashed(ax)
        ax.set(
            xlabel="Frequency (rad/s)",
            ylabel="Amplitude",
            yscale="log",
            xlim=(0.3, 2.2),
            ylim=(0.05, 4.0),
        )

    return Problem(
        'G. Duffing (1918), see A. H. Nayfeh and D. T. Mook, "Nonlinear Oscillations" (1979), section 4.1; third: NLvib, '
        "example 1",
        "cubic spring, one harmonic: curve, peak and folds in closed form",
        tuple(rows), draw,
    )  # fmt: skip


def shaw_and_holmes() -> Problem:
    stop, rows, seen = bd.Contact(normal=0, kn=3.0), [], []
    for harmonics in (5, 9, 15):
        study = bd.lumped(1.0, 1e-3, 1.0, contacts=[stop], forces={0: 1e-3}, harmonics=harmonics)
        omega = TWO_PI * study.peak(0.0, (0.2, 0.23)).frequency
        seen.append((harmonics, 1e6 * abs(omega / (4.0 / 3.0) - 1.0)))
        why = "few harmonics" if harmonics == 5 else ""
        rows.append(Row(f"frequency (rad/s), {harmonics} harmonics", 4.0 / 3.0, omega, 1e-5, why))

    def draw(ax):
        ax.plot(*np.transpose(seen), "o", color=colours(1)[0], markersize=6.0)
        _limit(ax, 10.0, "tolerance")
        ax.set(
            xlabel="Number of harmonics",
            ylabel="Relative error of the frequency (10⁻⁶)",
            yscale="log",
            ylim=(0.1, 100.0),
        )
        ax.set_xticks([n for n, _ in seen])

    return Problem(
        'S. W. Shaw and P. J. Holmes, "A periodically forced piecewise linear oscillator", J. Sound Vib. 90 (1983)',
        "an oscillator that meets a spring on one side: half a period has the frequency 1, the other half 2",
        tuple(rows), draw,
    )  # fmt: skip


def jenkins_mode() -> Problem:
    fine = bd.ContinuationOptions(tolerance=1e-12)
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
    modes = [
        bd.lumped(
            1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=harmonics
        ).nonlinear_mode(0.0, 1, (0.5, 20.0), options=fine)
        for harmonics in (1, tuple(range(1, 22, 2)))
    ]
    rows = []
    for mode, reference, name, tolerance in zip(
        modes,
        (jenkins.closed_form, jenkins.exact),
        ("one harmonic", "harmonics to 21"),
        (1e-10, 1e-5),
    ):
        slipping = np.flatnonzero(mode.amplitude > 1.05)[::8]
        both = np.array([reference(a) for a in mode.amplitude[slipping]])
        for k, (what, ours) in enumerate(
            (("frequency", TWO_PI * mode.frequency), ("damping", mode.damping_ratio))
        ):
            worst = int(np.argmax(np.abs(ours[slipping] / both[:, k] - 1.0)))
            rows.append(
                Row(
                    f"{name}: {what} at the worst point",
                    both[worst, k],
                    float(ours[slipping[worst]]),
                    tolerance,
                )
            )

    def draw(ax):
        a = np.concatenate([[0.5, 1.0], np.geomspace(1.002, 20.0, 80)])
        zeta = [
            0.01 / np.sqrt(2.0) if x <= 1.0 else jenkins.exact(x)[1] for x in a
        ]  # stuck, then the exact motion
        _over(
            ax,
            modes[1].amplitude,
            (a, zeta),
            modes[1].damping_ratio,
            OVER_SLIP,
            "Modal damping ratio",
            True,
        )

    return Problem(
        "definition: M. Krack, Computers & Structures 154 (2015); closed form of one harmonic and of the exact motion",
        "one mass with an elastic friction element, worst of several points",
        tuple(rows), draw,
    )  # fmt: skip


def limit_cycles() -> Problem:
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
    study = bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=1)
    flow = np.linspace(-0.115, -0.03, 9)
    found = [study.flutter(0.0, float(z), amplitude=(0.5, 40.0)) for z in flow]
    gap = lambda a, z: jenkins.closed_form(a)[1] + z
    rows = []
    for z, cycles in list(zip(flow, found))[::4]:
        ends = brentq(gap, 1.001, 2.58, (z,), xtol=1e-14), brentq(gap, 2.59, 40.0, (z,), xtol=1e-14)
        rows += [
            Row(
                f"{what} cycle, damping of the flow {z:.4g}",
                end,
                float(cycles.amplitude[1 + k]),
                1e-9,
            )
            for k, (what, end) in enumerate(zip(("stable", "unstable"), ends))
        ]

    several = bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=(1, 3, 5, 7))
    cycle = several.flutter(0.0, -0.1, amplitude=(0.5, 2.5))
    a, omega, one = cycle.amplitude[1], TWO_PI * cycle.frequency[1], np.ones((1, 1))
    for factor in (0.9, 1.1):
        start = np.array([factor * a])
        matrices, faces = (
            (one[0], np.array([0.02 - 0.2 * omega]), one),
            (one, 0.0 * one, 1.0, 0.0, 1.0, 1.0),
        )
        height = jenkins.integrated(
            matrices, faces, 0.0 * start, omega, start, 0.0 * start, start - 1.0, 40
        )
        rows.append(
            Row(f"time integration from {factor} of a stable cycle", float(height[-1]), a, 0.01)
        )

    def draw(ax):
        a = np.geomspace(1.0, 40.0, 200)
        line = np.array([-jenkins.closed_form(x)[1] for x in a])
        _parts(
            ax,
            line,
            a,
            np.arange(len(a)) >= np.argmin(line),
            "closed form, stable",
            color="0.6",
            zorder=0,
        )
        _dashed(ax, "closed form, unstable", "0.6")
        for k, face, what in ((1, colours(1)[0], "stable"), (2, "w", "unstable")):
            look = {"color": colours(1)[0], "markerfacecolor": face, "label": f"bdamper, {what}"}
            ax.plot(flow, [c.amplitude[k] for c in found], "o", **look)
        ax.set(
            xlabel="Damping ratio of the flow", ylabel=OVER_SLIP, yscale="log", xlim=(-0.125, -0.02)
        )

    return Problem(
        "closed form of the same mode, and integration by a Runge-Kutta method",
        "amplitudes at which friction balances a flow that excites: stable (filled), unstable (open)",
        tuple(rows), draw,
    )  # fmt: skip


# ---- several masses ----

PYHARM = 10.001165
"""Highest amplitude on the curve of pyHarm-os 1.2.2 with 1024 samples."""


def two_masses() -> Problem:
    face = bd.Contact((0, 1), kt=0.5, mu=1.0, preload=0.2)
    study = bd.lumped(
        [1.0, 0.5],
        [0.02, 0.01],
        [[1.5, -0.5], [-0.5, 1.0]],
        contacts=[face],
        forces={0: 0.3},
        response=0,
        harmonics=7,
    )
    fine = bd.ContinuationOptions(max_step=0.02, step=0.02)
    curve = study.frequency_response(0.0, (0.5 / TWO_PI, 2.2 / TWO_PI), options=fine)
    rows = (Row("highest amplitude", PYHARM, curve.peak.amplitude, 1e-6),)

    def draw(ax):
        ax.plot(TWO_PI * curve.frequency, curve.amplitude, color=colours(1)[0], label="bdamper")
        _circles(ax, TWO_PI * curve.peak.frequency, PYHARM, "pyHarm, highest\namplitude: 10.00117")
        ax.set(xlabel="Frequency (rad/s)", ylabel="Amplitude", yscale="log")

    return Problem(
        "pyHarm-os 1.2.2; `make peers` runs it again", "two masses with a friction element between them, seven harmonics",
        rows, draw,
    )  # fmt: skip


NLVIB = (
    "<https://github.com/julianjurai/NLvib-py>, examples/comparison, where NLvib was run by Octave"
)
"""Where its figures stand; frequencies are those of the highest points computed, 0.005 to 0.01 rad/s apart."""
NLVIB_TWO = (
    ("cubic springs, mass 1", 2, 0, 0.41849, 1.0278),
    ("cubic springs, mass 2", 2, 1, 1.71678, 1.0337),
    ("spring on one side, mass 1", 3, 0, 0.98093, 0.7541),
)
NLVIB_CHAIN = (
    ("mass 1", 7, 0, 0.167247, 1.2585),
    ("mass 2", 7, 1, 0.206248, 1.2684),
    ("mass 3", 7, 2, 0.699148, 1.6642),
)
"""What is seen, number of the example and of the mass from 0, largest RMS, its frequency (rad/s)."""


def _chain(springs):
    """Matrix of springs between the ground, masses in a row and the ground."""
    a, b = np.asarray(springs[:-1]), np.asarray(springs[1:])
    return np.diag(a + b) - np.diag(b[:-1], 1) - np.diag(b[:-1], -1)


def _nlvib_study(example, mass):
    """The study of an example with the response of a mass, and its frequencies (rad/s)."""
    if example == 2:
        cubic, settings = (
            {0: 1.0, (0, 1): 0.0042},
            {"forces": {0: 0.11}, "response": mass, "harmonics": 7},
        )
        damping = _chain([0.002, 0.013, 0.0])
        return bd.lumped(
            [1.0, 0.05], damping, _chain([1.0, 0.0453, 0.0]), cubic=cubic, **settings
        ), (0.8, 1.4)
    if example == 3:
        K, stop = _chain([0.0, 1.0, 1.0]), bd.Contact(normal=0, kn=100.0, gap=1.0)
        study = bd.lumped(
            [1.0, 1.0], 0.03 * K, K, contacts=[stop], forces={1: 0.1}, response=mass, harmonics=21
        )
        return study, (0.5, 0.8)
    K, friction = _chain(np.ones(4)), {"kt": 20.0, "mu": 1.0, "preload": 1.0}
    contacts = [
        bd.Contact(0, **friction),
        bd.Contact((1, 0), **friction),
        bd.Contact(normal=2, kn=1.0, gap=0.25),
    ]
    study = bd.lumped(
        np.ones(3),
        0.02 * K,
        K,
        contacts=contacts,
        cubic={1: 1.0, (2, 1): 1.0},
        forces={1: 1.0},
        response=mass,
        harmonics=7,
    )
    return study, (0.5, 2.0)


def _nlvib(figures, measure) -> Problem:
    rows, curves = [], []
    for name, example, mass, height, omega in figures:
        study, ends = _nlvib_study(example, mass)
        fine = bd.ContinuationOptions(max_step=0.02, step=0.02)
        curve = study.frequency_response(0.0, (ends[0] / TWO_PI, ends[1] / TWO_PI), options=fine)
        assert curve.complete
        square = np.linalg.norm(curve.harmonics, axis=1) / np.sqrt(
            2.0
        )  # convention of NLvib, where the mean is halved as well
        top = int(np.argmax(square))
        rows += [
            Row(f"example {example}, {name}: largest RMS", height, float(square[top]), 1e-3),
            Row(
                f"example {example}, {name}: its frequency (rad/s)",
                omega,
                TWO_PI * float(curve.frequency[top]),
                3e-3,
            ),
        ]
        curves.append((f"example {example}, {name}", TWO_PI * curve.frequency, square))

    def draw(ax):
        for k, (name, omega, square) in enumerate(curves):
            ax.plot(
                omega,
                square,
                color=colours(len(curves))[k],
                linestyle=STYLES[k],
                label=name.replace(", ", ",\n"),
            )
        _circles(ax, *np.transpose([figure[:2:-1] for figure in figures]), "NLvib, highest")
        ax.set(xlabel="Frequency (rad/s)", ylabel="Root mean square", yscale="log")

    source = (
        'M. Krack and J. Gross, "Harmonic Balance for Nonlinear Vibration Problems" (2019), NLvib; '
        f"its results: {NLVIB}"
    )
    return Problem(source, measure, tuple(rows), draw)


def nlvib_two_masses() -> Problem:
    return _nlvib(
        NLVIB_TWO,
        "two masses, with cubic springs and with a stiff spring on one side (its 1,024 samples move the peak by 3e-4)",
    )


def nlvib_chain() -> Problem:
    return _nlvib(
        NLVIB_CHAIN,
        "a chain of three masses with two friction elements, two cubic springs and a stop with a gap",
    )


def planar_wedge() -> Problem:
    rows, curves = [], []
    for mu, harmonics in ((0.3, 1), (0.5, 3), (0.8, 1)):
        study, program = wedge.study(mu, harmonics), wedge.Program(mu, harmonics)
        z = program.branch(program.start(*program.stuck(2), 3e-5), 6e-5 * mu / 0.5)[-1]
        mode = study.nonlinear_mode(wedge.LOAD, 3, (3e-5, float(np.exp(z[-1]))))
        name = f"friction coefficient {mu}, harmonics {harmonics}"
        curves.append(
            (
                mu,
                harmonics,
                study.nonlinear_mode(wedge.LOAD, 3, (1e-5, 4e-4)),
                (float(np.exp(z[-1])), z[-2]),
            )
        )
        rows += [
            Row(
                f"{name}: frequency (Hz) where it slips",
                1e3 * z[-3] / TWO_PI,
                mode.frequency[-1],
                1e-6,
            ),
            Row(f"{name}: damping there", z[-2], mode.damping_ratio[-1], 1e-6),
        ]

    def draw(ax):
        for panel, (mu, harmonics, mode, known) in zip(ax, curves):
            a, zeta = 1e6 * mode.amplitude, mode.damping_ratio
            panel.plot(a, zeta, color=colours(1)[0], label="bdamper")
            panel.plot(a[mode.folds], zeta[mode.folds], "o", color=colours(1)[0], markersize=3.5, markerfacecolor="w",
                       label="the branch turns")  # fmt: skip
            _circles(
                panel, 1e6 * known[0], known[1], "independent program", marker="s", markersize=8.0
            )
            panel.set(ylabel="Modal damping ratio", xscale="log", ylim=(0.0, None))
            panel.set_title(f"Friction coefficient {mu}, {_harmonics(harmonics)}")
        ax[-1].set_xlabel("Amplitude (µm)")

    return Problem(
        'N. N. Balaji and E. Ferhatoglu, "Vibration response variability in friction-damped systems" (parameters from '
        "<https://github.com/Nidish96/nonuniq>); a separate program in NumPy (tests/analyses/wedge.py)",
        "third mode of two masses with a free wedge between them; circles mark turning points of the branch",
        tuple(rows), draw, 3,
    )  # fmt: skip


FORCE, DRIVEN = 120.0, 150.0
"""N on the first mass of the wedge along x, at so many Hz."""


def _harmonics(n):
    return f"{n} harmonic{'s' if n > 1 else ''}"


def _integrated_wedge(force):
    """Mean amplitude (µm) of the last 40 of 200 periods from rest."""
    rest = wedge.Program(0.5, 1)
    (slide, close), at, k = wedge.rows().swapaxes(0, 1), np.eye(6), wedge.STIFFNESS
    matrices, faces = (wedge.MASS, wedge.DAMPING, wedge.stiffness()), (slide, close, k, k, 0.5, 0.0)
    start = rest.q, 0.0 * rest.q, rest.slider
    seen = jenkins.integrated(
        matrices, faces, wedge.LOAD * at[5], TWO_PI * DRIVEN, *start, 200, force * at[0]
    )
    return 1e6 * float(np.mean(seen[-40:]))


def forced_wedge() -> Problem:
    rows, cycles = [], []
    for harmonics in (1, 3, 5, 9):
        x = wedge.Program(0.5, harmonics).forced(TWO_PI * DRIVEN, FORCE)
        study = wedge.study(0.5, harmonics)
        study = study.replace(
            excitation=bd.Excitation(study.excitation.location, study.excitation.direction, FORCE)
        )
        curve = study.frequency_response(wedge.LOAD, (0.93 * DRIVEN, 1.07 * DRIVEN))
        away = np.hypot(
            50.0 * (curve.frequency / DRIVEN - 1.0), curve.amplitude / np.hypot(*x[0, 1:3]) - 1.0
        )
        near = curve.unknowns[np.argmin(away)]
        scale, system = np.full(len(near) + 1, np.abs(near).max()), study.problem.system(wedge.LOAD)
        found = system.correct_at(near, TWO_PI * DRIVEN, scale, 1e-12, 40, True)
        rows.append(
            Row(
                f"amplitude (µm), {_harmonics(harmonics)}",
                1e6 * np.hypot(*x[0, 1:3]),
                1e6 * abs(system.rows.value(found.y)),
                1e-5,
            )
        )
        cycles.append((harmonics, curve))
    why = "the periodic motion is not stable; in time the amplitude varies between 231 and 236 µm"
    half = wedge.Program(0.5, 9).forced(TWO_PI * DRIVEN, 0.5 * FORCE)
    for force, found, known in (
        (0.5 * FORCE, 1e6 * np.hypot(*half[0, 1:3]), ""),
        (FORCE, rows[-1].ours, why),
    ):
        rows.append(
            Row(
                f"time integration under {force:g} N, 9 harmonics",
                _integrated_wedge(force),
                found,
                1e-3,
                known,
            )
        )

    def draw(ax):
        inset = ax.inset_axes((0.05, 0.56, 0.36, 0.4))
        inset.yaxis.tick_right()
        for row, (harmonics, curve), colour, marker in zip(rows, cycles, colours(4), MARKERS):
            for each in (ax, inset):
                _parts(
                    each,
                    curve.frequency,
                    1e6 * curve.amplitude,
                    curve.backward,
                    _harmonics(harmonics),
                    color=colour,
                )
            _circles(inset, DRIVEN, row.reference, None, marker=marker, color=colour)
        _circles(ax, [], [], "independent program\n(in the inset)")
        _dashed(ax, "unstable: runs back\nin frequency")
        heights = [row.reference for row in rows[:4]]
        inset.set(xlim=(DRIVEN - 0.5, DRIVEN + 0.5), ylim=(min(heights) - 6.0, max(heights) + 6.0))
        inset.set_xticks([DRIVEN - 0.4, DRIVEN, DRIVEN + 0.4])
        inset.tick_params(labelsize=6.0)
        ax.indicate_inset_zoom(inset, edgecolor="0.3")
        ax.set(xlabel="Frequency (Hz)", ylabel="Amplitude (µm)")

    return Problem(
        "the same program, and integration by a Runge-Kutta method",
        f"forced response at {DRIVEN:g} Hz under {FORCE:g} N", tuple(rows), draw,
    )  # fmt: skip


PAPER = {1: (4.4, 17.2), 2: (5.5, 3.4)}
"""By mode: amplitude of the stuck resonance over the optimum, and its frequency shift (%)."""


def paper() -> Problem:
    from benchmarks import bench_paper

    rows, curves = [], []
    for mode, (ratio, shift) in PAPER.items():
        *_, band, interval, _ = bench_paper.DRIVEN[mode]
        curve = bench_paper.study(mode, **bd.CIGEROGLU_2009).optimal_curve(
            interval, 8, frequency=band, check=False
        )
        rows += [
            Row(f"mode {mode}: stuck over optimum", ratio, curve.ratio, 0.05),
            Row(
                f"mode {mode}: shift of the stuck resonance (%)",
                shift,
                curve.stuck_shift_percent,
                0.05,
            ),
        ]
        curves.append((mode, curve))

    def draw(ax):
        height, shift = ax
        for (mode, curve), colour, marker in zip(curves, colours(3)[::2], MARKERS):
            look = {"marker": marker, "markersize": 3.5, "color": colour, "label": f"mode {mode}"}
            height.plot(curve.preload, 100.0 * curve.amplitude / curve.stuck.amplitude, **look)
            shift.plot(curve.preload, curve.shift_percent, **look)
            ratio, moved = PAPER[mode]
            _limit(
                height,
                100.0 / ratio,
                f"paper, mode {mode}: {100.0 / ratio:.1f} %",
                colour,
                above=mode == 1,
            )
            _limit(shift, moved, f"paper, mode {mode}, stuck: {moved:g} %", colour, right=mode == 2)
        height.set(ylabel="Peak amplitude\n(% of the stuck peak)", xscale="log", ylim=(0.0, 105.0))
        shift.set(
            xlabel="Preload (N)",
            ylabel="Frequency of the peak\n(% above that without contact)",
            xscale="log",
        )

    return Problem(
        "E. Cigeroglu, N. An, C.-H. Menq, J. Eng. Gas Turbines Power 131 (2009), Figs 8 and 9",
        "the paper's method (`bd.CIGEROGLU_2009`) on a disk made for these four numbers: confirms the method, not the disk",
        tuple(rows), draw, 2,
    )  # fmt: skip


# ---- large ones ----


def whitehead() -> Problem:
    from tests.mistuning import test_whitehead as wheels

    rows, seen = [], []
    for n in (4, 6, 8):
        disk = np.zeros(n // 2 + 1)
        disk[0] = 1e4
        structure = wheels.DiskMatrices.of(wheels.study(n, 0, disk, 1e-5, m=0.3).problem)
        soft, stiff = (np.sqrt(structure.local.modes(d)[0][0]) for d in (1, 0))
        patterns = [f * (stiff / soft - 1.0) * np.eye(n)[0] for f in np.linspace(0.95, 1.1, 61)]
        found = float(wheels.amplification(structure, 0, patterns)[0].max())
        rows.append(Row(f"{n} blades", 0.5 * (1.0 + np.sqrt(n)), found, 0.01))
        seen.append((n, found))

    def draw(ax):
        n = np.linspace(2.0, 10.0, 50)
        ax.plot(n, 0.5 * (1.0 + np.sqrt(n)), color="0.6", linewidth=2.5, label="bound, (1 + √N)/2")
        ax.plot(*np.transpose(seen), "o", color=colours(1)[0], label="worst pattern found")
        ax.set(xlabel="Number of blades N", ylabel="Amplification of the worst blade")
        ax.set_title("Mistuning without friction: the worst wheels reach Whitehead's bound")

    return Problem(
        'D. S. Whitehead, "Effect of mistuning on the vibration of turbo-machine blades induced by wakes", J. Mech. Eng. '
        "Sci. 8 (1966)",
        "largest amplification of a wheel without friction over all patterns, (1 + sqrt N)/2",
        tuple(rows), draw,
    )  # fmt: skip


def calculix() -> Problem:
    from bdamper.fem.element_stress import element_rows, node_average, von_mises_size
    from bdamper.fem.generated_models import SectorFE, blade_points, solids_of
    from examples.calculix.decks import sector_input
    from tests.calculix_runs import centrifugal_stress, run

    fe, rows, seen = SectorFE(), [], []
    for d in (0, 5):
        ours = np.sqrt(fe.cyclic(d).modes(8)[0]) / TWO_PI
        text = sector_input(fe, d, 8)
        with tempfile.TemporaryDirectory() as folder:
            theirs = run(text, Path(folder)).reshape(-1, 2)[:, 0]
        worst = int(np.argmax(np.abs(ours / theirs - 1.0)))
        rows.append(
            Row(
                f"nodal diameter {d}: worst of 8 frequencies (Hz)", theirs[worst], ours[worst], 1e-5
            )
        )
        seen.append((f"frequency, nodal diameter {d}", np.abs(ours / theirs - 1.0)))
    nodes = blade_points(fe.blade, fe.geometry)
    pairs, owner = element_rows(solids_of(fe.blade), fe.blade.nodes, nodes)
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = centrifugal_stress(
            fe, node_average(owner, len(nodes)) @ pairs, nodes, Path(folder)
        )
    size, apart = von_mises_size(theirs), von_mises_size(ours - theirs)
    worst = int(np.argmax(apart / size))
    rows.append(
        Row(f"stress of rotation, worst of {len(nodes)} nodes (MPa)", 1e-6 * size[worst],
            1e-6 * (size[worst] + apart[worst]), 3e-4)
    )  # fmt: skip
    seen.append(("stress of rotation", np.sort(apart / size)))

    def draw(ax):
        for (what, error), marker, colour in zip(seen, MARKERS, colours(3)):
            ax.plot(
                1 + np.arange(len(error)),
                1e6 * np.sort(error),
                marker,
                color=colour,
                label=what.replace(", ", ",\n"),
            )
        _limit(ax, 10.0, "tolerance of frequencies")
        _limit(ax, 300.0, "tolerance of stresses")
        ax.set(
            xlabel="Mode or node, sorted by its difference",
            ylabel="Relative difference from CalculiX (10⁻⁶)",
            yscale="log",
        )

    return Problem(
        "CalculiX on the same mesh",
        "frequencies of a sector; nodal stress under rotation, all components",
        tuple(rows),
        draw,
    )


def models_by_others() -> Problem:
    """Frequencies of models that other programs and packages carry, read as they are."""
    from bdamper.importers import ContactFaces, read_ansys
    from tests import others_files as others
    from tests.imports import build

    rows, seen = [], []

    def frequencies(body, name, theirs, tolerance, **settings):
        moving = (
            others.front(body)
            if "n_blades" not in settings
            else body.numbers[body.nodes[:, 2] > 5.0 - 1e-9]
        )
        rub = ContactFaces("rub", moving, body_a="blade", body_b="ground", points=4)
        made = build(body, contacts=[rub], n_modes=8, nodal_diameters=list(theirs), **settings)
        found = made.frequencies
        pairs = [(f, g, d) for d, known in theirs.items() for f, g in zip(known, found[d])]
        error = np.array([abs(g / f - 1.0) for f, g, _ in pairs])
        reference, ours, d = pairs[int(error.argmax())]
        rows.append(
            Row(
                f"{name}: worst of {len(pairs)} frequencies, nodal diameter {d} (Hz)",
                reference,
                ours,
                tolerance,
            )
        )
        seen.append((name, np.maximum(error, 1e-9)))

    for name, highest, faces, tolerance in (
        ("segdyn", 6, None, 1e-5), ("fullseg", 2, ("NLEFT", "NRIGHT"), 1e-3), ("segmenttet", 2, ("NLEFT", "NRIGHT"), 1e-3)
    ):  # fmt: skip
        text = others.deck(name)
        text += "" if "*BOUNDARY" in text else others.held(text)
        with tempfile.TemporaryDirectory() as folder:
            body = others.sector(text, Path(folder))
            theirs = others.cyclic_frequencies(text, Path(folder), highest)
        frequencies(body, name, theirs, tolerance, faces=faces, **others.AXES)
        if name == "segdyn":
            stuck = others.stuck_frequency(others.shrouded(body))
            rows.append(
                Row(
                    "segdyn as a shrouded wheel that sticks, nodal diameter 3 (Hz)",
                    theirs[3][0],
                    stuck,
                    3e-4,
                )
            )
    body = read_ansys(others.ANSYS / "file.full", others.ANSYS / "HexBeam.cdb")
    known = {0: (1283.20036921, 1283.20036921, 5781.97486169)}
    beam = {"n_blades": 1, "axis": (0, 1, 0), "radial": (0, 0, 1), "check_units": False}
    frequencies(body, "HexBeam and file.full", known, 1e-9, **beam)

    def draw(ax):
        for (name, error), marker, colour in zip(seen, MARKERS, colours(4)):
            ax.plot(
                1 + np.arange(len(error)),
                1e6 * np.sort(error),
                marker,
                color=colour,
                label=name,
                linestyle="none",
            )
        _limit(ax, 1e3, "tolerance where faces differ")
        _limit(ax, 10.0, "tolerance where faces match")
        what = "Relative difference of frequencies (10⁻⁶)"
        ax.set(xlabel="Frequency, sorted by its difference", ylabel=what, yscale="log")

    return Problem(
        "decks and cyclic runs of the test suite of CalculiX (Debian: calculix-ccx-test), held at bore or rim if they hold "
        "nothing; beam and frequencies of ansys-mapdl-reader (PyPI)",
        "frequencies of finite element models by others; the meshes of the sector faces of fullseg and segmenttet "
        "differ; the shrouds of segdyn touch at 16 points",
        tuple(rows),
        draw,
    )


def others_here() -> bool:
    """Whether models by others are installed."""
    from tests.others_files import ANSYS, has_decks

    return has_decks() and ANSYS.is_dir()


NEEDS: dict[str, tuple[str, Callable[[], bool]]] = {
    "CalculiX": ("CalculiX (ccx)", lambda: shutil.which("ccx") is not None),
    "Finite element models by others": (
        "CalculiX with its decks, and the files that make others unpacks",
        others_here,
    ),
}
"""What a problem needs besides this package, and whether it is there."""


def available(name: str) -> bool:
    """Whether what a problem needs is installed."""
    return name not in NEEDS or NEEDS[name][1]()


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "Griffin's oscillator": griffin,
    "Den Hartog's oscillator": den_hartog,
    "Goodman and Klumpp's beam": goodman_klumpp,
    "Duffing": duffing,
    "Shaw and Holmes' impact oscillator": shaw_and_holmes,
    "Nonlinear mode of the Jenkins element": jenkins_mode,
    "Limit cycles": limit_cycles,
    "Two masses beside pyHarm": two_masses,
    "NLvib's two masses": nlvib_two_masses,
    "NLvib's chain of three masses": nlvib_chain,
    "Planar wedge": planar_wedge,
    "Planar wedge, forced": forced_wedge,
    "The paper's four numbers": paper,
    "Whitehead's limit": whitehead,
    "CalculiX": calculix,
    "Finite element models by others": models_by_others,
}
