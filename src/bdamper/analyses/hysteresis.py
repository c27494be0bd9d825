"""Hysteresis of the contacts: loops of force over displacement, and the energy that they take from the vibration.

:mod:`bdamper.harmonic_balance.contact_cycle` has the equations.  A face has the sum of the forces of its points over the
mean of their displacements, weighted by area.  The contacts as a whole have one loop, that of the force at the response
location which does the work of all of them: with the relative motion ``X_i`` of each point in the fundamental harmonic, as
the modes of the bodies carry it, and the response ``x``, a point moves as the response times ``|X_i/x|`` with the phase of
``X_i/x``, and

    f(theta) = sum_i |X_i/x| f_i(theta - phase of X_i/x)

without the mean of the forces, which does no work.  The area of this loop is what the contacts take from the fundamental
harmonic of the motion; its slope and width are the equivalent stiffness and damping.

First loading of a seated damper along its faces: force over displacement at constant preload.

The static equations of :mod:`bdamper.contact.static_state` under the load :math:`P` that seats the damper, then a force
:math:`Q` at a location of it, growing from zero while :math:`P` stays:

.. math:: K q + G^T F(G q + P x_0) = P f + Q d,

:math:`d` the modes of the location in the direction of :math:`Q`.  Residual modes do not move the location and :math:`Q`
does no work on them, so curves of different contact stiffnesses differ by the contact alone.  As points begin to slip one
after the other the slope decreases from the stuck stiffness to zero, at the force at which the damper slides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.sweep import SweepResult
from bdamper.contact.static_state import OPEN, SLIP_MINUS, SLIP_PLUS, PreloadState, static_state
from bdamper.harmonic_balance.contact_cycle import bodily_motion, energies, histories
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import Solutions, asked, solutions_of
from bdamper.harmonic_balance.sector import Sector
from bdamper.model.loads import direction_vector
from bdamper.model.structure import Interface
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import validation
from bdamper.util.display import Comparable, Fact, Plottable, draw
from bdamper.util.errors import COMPLETE, FAILED, ModelError, SettingError, with_reason
from bdamper.util.formatting import amount, percent, short_repr
from bdamper.util.progress import one_thread
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import ROW, Column, Quantity, Tabular

# ---- Hysteresis of the contacts ----


AXES = ("t1", "t2", "n")
WHOLE = "whole"
"""Name of the loop of all contacts together."""
NOTHING = 1e-9
"""Energy relative to the work of the excitation below which nothing slips: the residual of a solution."""
Solved = ResponseCurve | Peak | OptimalCurve


@short_repr
@dataclass(frozen=True)
class Hysteresis(Plottable, Comparable, Tabular, Recorded, Storable, kind="bdamper-hysteresis"):
    """Energies, equivalent stiffness and damping of the contacts; of a single solution also its motions and forces.

    A single solution has numbers, and arrays with a value for each contact point.  Of several solutions each has a row, and
    there are no loops.

    ``plot`` draws (:func:`bdamper.plot.plot_hysteresis`) loops of force over displacement, or stiffness and damping of
    several solutions over the amplitude; ``plot_history`` forces and the gap over time (:func:`bdamper.plot.plot_history`),
    ``plot_energy`` the energy lost over the faces (:func:`bdamper.plot.plot_energy`).

    Parameters
    ----------
    preload : float or (n,) float, N
    frequency : float or (n,) float, Hz
    amplitude : float or (n,) float, m
        Of the fundamental harmonic of the response.
    interface : tuple of str
        Of each contact point.
    energy : (n_points,) or (n, n_points) float, J
        Lost at each contact point in a cycle.
    damping, excitation : float or (n,) float, J
        Lost to the damping of the modes; work of the excitation, of one sector.
    kinetic : float or (n,) float, J
        Largest kinetic energy of the motion, if all of it passed through rest together.
    stiffness, width : float or (n,) float, N/m
        Equivalent stiffness of the contacts seen from the response, and equivalent viscous damping times the angular
        frequency; NaN where the response is at rest.
    branch : (n,) int
        Branch of the curve that each of several solutions lies on.
    theta : (n_theta,) float, rad
        Angle of the excitation, from 0 to 2 pi, both included.
    points : (n_points, 3) float, m
    frame : (n_points, 3, 3) float
        Rows t1, t2, n.
    area : (n_points,) float, m2
    displacement : (n_points, 3, n_theta) float, m
        Of the contact elements, along t1 and t2 and closing along n; the elasticity around the contacts that residual modes
        hold adds to it.  NaN at points that the settings leave out.
    force : (n_points, 3, n_theta) float, N
    gap : (n_points, n_theta) float, m
        Distance of the surfaces, 0 in contact; NaN at points without a normal spring.
    response : (n_theta,) float, m
        Fundamental harmonic of the response.
    whole : (n_theta,) float, N
        Force at the response that does the work of all contacts on the fundamental harmonic of the motion.
    settings : mapping
    model_hash : str
    """

    preload: Annotated[Any, Quantity("N")]
    frequency: Annotated[Any, Quantity("Hz")]
    amplitude: Annotated[Any, Quantity("m", "Response amplitude")]
    interface: Annotated[tuple[str, ...], Quantity(dims=("contact_point",))]
    energy: Annotated[NDArray, Quantity("J", dims=(ROW, "contact_point"))]
    damping: Annotated[Any, Quantity("J", "Damping of the modes", name="modal_damping")]
    excitation: Annotated[Any, Quantity("J", "Work of the excitation", name="work")]
    kinetic: Annotated[Any, Quantity("J")]
    stiffness: Annotated[Any, Quantity("N/m", "Equivalent contact stiffness")]
    width: Any
    branch: Annotated[Any, Quantity()] = None
    theta: Annotated[Any, Quantity("rad", dims=("theta",))] = None
    points: Annotated[Any, Quantity("m", parts=("X", "Y", "Z"))] = None
    frame: Any = None
    area: Annotated[Any, Quantity("m2")] = None
    displacement: Annotated[Any, Quantity("m", dims=(ROW, "axis", "theta"))] = None
    force: Annotated[Any, Quantity("N", dims=(ROW, "axis", "theta"))] = None
    gap: Annotated[Any, Quantity("m", dims=(ROW, "theta"))] = None
    response: Annotated[Any, Quantity("m", dims=("theta",))] = None
    whole: Annotated[Any, Quantity("N", dims=("theta",))] = None
    _summary_fields = ("preload", "frequency", "amplitude", "excitation", "damping", "stiffness", "damping_ratio",
        "by_interface")

    def __len__(self) -> int:
        return np.size(self.frequency)

    @property
    def single(self) -> bool:
        """Whether it is of a single solution and has its motions and forces."""
        return self.theta is not None

    @property
    def axis(self) -> Annotated[tuple[str, ...], Quantity(dims=("axis",))]:
        """Names of the axes of displacements and forces."""
        return AXES

    @property
    def interfaces(self) -> tuple[str, ...]:
        """Names of the faces, each once."""
        return tuple(dict.fromkeys(self.interface))

    @property
    def by_interface(self) -> dict[str, Any]:
        """Energy that each face takes in a cycle, J."""
        return {name: self.energy[..., self.rows(name)].sum(axis=-1) for name in self.interfaces}

    @property
    def lost(self) -> Annotated[Any, Quantity("J")]:
        """Energy that all contacts take in a cycle, J."""
        return self.energy.sum(axis=-1)

    @property
    def damping_ratio(self) -> Annotated[Any, Quantity(label="Equivalent damping ratio")]:
        """Equivalent damping ratio of the contacts: lost energy over 4 pi times the kinetic energy."""
        return self.lost / np.where(np.equal(self.kinetic, 0.0), np.nan, 4.0 * np.pi * self.kinetic)

    @property
    def viscous(self) -> Annotated[Any, Quantity("N s/m", name="viscous_damping")]:
        """Equivalent viscous damping, N s/m."""
        return self.width / (2.0 * np.pi * self.frequency)

    @property
    def imbalance(self) -> Any:
        """What is left of the work of the excitation after both losses, relative to it."""
        own = np.where(np.equal(self.excitation, 0.0), np.nan, self.excitation)
        return (self.excitation - self.damping - self.lost) / own

    def _dimension(self) -> str:
        return "contact_point" if self.single else "point"

    def columns(self) -> dict[str, Column]:
        """A row for each contact point of a single solution; for each of several, with what each face takes."""
        found, n = super().columns(), len(self.interface)
        if not self.single:
            return found | {f"lost_{name}": Column(energy, "J") for name, energy in self.by_interface.items()}
        of_points = {name: c for name, c in found.items() if c.dims or len(c.values) == n}
        rows = ("interface", "energy")
        return {name: c._replace(dims=()) if name in rows else c for name, c in of_points.items()}

    def rows(self, interface: str) -> NDArray:
        """Indices of the points of one face."""
        return np.flatnonzero(np.array(self.interface) == validation.choice("interface", interface, self.interfaces))

    def loop(self, where: int | str = WHOLE, direction: str = "t1") -> tuple[NDArray, NDArray]:
        """Displacement (m), without its mean, and force (N), (n_theta,) each, over one cycle.

        Parameters
        ----------
        where : int or str
            A contact point by its index, a face by its name, or "whole": the contacts as a whole.
        direction : {"t1", "t2", "n"}
            Of a point or a face.

        Raises
        ------
        SettingError
            If there is no such point or face, or the settings leave all of it out.
        """
        k = AXES.index(validation.choice("direction", direction, AXES))
        if isinstance(where, str):
            validation.choice("where", where, (WHOLE, *self.interfaces))
            if where == WHOLE:
                return self.response, self.whole
            rows = self.rows(where)
        else:
            rows = np.array([validation.integer("where, index of a contact point", where, 0, len(self.points) - 1)])
        rows = rows[np.isfinite(self.displacement[rows, 0, 0])]
        validation.check(len(rows), "where", "contact that takes part", f"{where!r}, which the settings leave out")
        moved = np.average(self.displacement[rows, k], axis=0, weights=self.area[rows])
        return moved - moved[:-1].mean(), self.force[rows, k].sum(axis=0)

    def plot_history(self, where: int, **options: Any) -> Any:
        """Forces and gap of one contact point over time: :func:`bdamper.plot.plot_history`."""
        return draw(self, "history", where, **options)

    def plot_energy(self, **options: Any) -> Any:
        """Energy lost per cycle over the faces: :func:`bdamper.plot.plot_energy`."""
        return draw(self, "energy", **options)

    def _facts(self) -> tuple[Fact, ...]:
        """Energies of a cycle, and equivalent stiffness and damping of the contacts, of a single solution."""
        return super()._facts() if self.single else ()

    def _headline(self) -> str:
        if not self.single:
            k = int(np.argmax(self.damping_ratio))
            at = f"{amount(self.amplitude[k], 'm')} and {amount(self.frequency[k], 'Hz')}"
            load = amount(self.preload[k], "N")
            return f"Largest damping ratio of the contacts {percent(self.damping_ratio[k])}, at {at}, preload {load}."
        share = self.lost / self.excitation if self.excitation else float("nan")
        most = max(self.by_interface, key=lambda name: self.by_interface[name], default="")
        where = f", most of it at {most}" if self.lost > NOTHING * self.excitation else ""
        return (
            f"The contacts take {percent(share)} of the work of the excitation{where}: equivalent damping ratio "
            f"{percent(self.damping_ratio)} at {amount(self.amplitude, 'm')} and {amount(self.frequency, 'Hz')}."
        )


def _solutions(problem: Problem, result: Solved) -> tuple[Solutions, NDArray]:
    """Solutions of a result where it has a value, and the branch that each lies on."""
    kinds = ResponseCurve, Peak, OptimalCurve
    validation.instance("result", result, kinds, "a response curve, a peak or an optimal curve of this study")
    if isinstance(result, ResponseCurve):
        check_curve(problem, result)
    solved, branch = solutions_of(problem, result), np.zeros(1, int)
    if isinstance(result, ResponseCurve):
        branch = result.branch
    elif isinstance(result, OptimalCurve):
        branch = np.cumsum(~result.goes_on)  # points of one smooth branch go on from each other
    known = np.isfinite(solved.frequency)
    validation.check(known.any(), "result", "solutions", f"none ({type(result).__name__})")
    return Solutions(*(column[known] for column in solved)), branch[known]


def _on_points(problem: Problem, system: Equations[Sector], values: NDArray) -> NDArray:
    """Sums over the elements of the equations that belong to each contact point of the structure."""
    if system.structure.points.index is None:
        return values
    out = np.zeros((problem.coupling.n_points, *values.shape[1:]))
    np.add.at(out, system.structure.points.index, values)
    return out


@one_thread
def dissipation(problem: Problem, result: Solved) -> Hysteresis:
    """Energy lost per cycle, equivalent stiffness and damping along a result.

    Parameters
    ----------
    problem : Problem
    result : ResponseCurve, Peak or OptimalCurve
        Of this problem.  An optimal curve shows them over amplitude at resonance: a response depends on preload and
        excitation through their ratio alone where there are no gaps.

    Returns
    -------
    Hysteresis

    Raises
    ------
    SettingError
        If the result is of another problem, or holds no solution.
    """
    solved, branch = _solutions(problem, result)
    rows = [_of_solution(problem, *solution) for solution in zip(*solved)]
    columns: dict[str, Any] = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return Hysteresis(branch=branch, **columns, **_identity(problem))


def _of_solution(problem: Problem, u: NDArray, frequency: float, preload: float) -> dict[str, Any]:
    """Energies, equivalent stiffness and damping of one solution."""
    system, shown = problem.system(preload), ~problem.coupling.spring_points
    e = energies(system, u, 2.0 * np.pi * frequency, _counted(problem, system))
    return {
        "preload": float(preload), "frequency": float(frequency), "amplitude": float(np.abs(system.response(u)[1])),
        "energy": _on_points(problem, system, e["contact"])[shown], "damping": e["damping"],
        "excitation": e["excitation"], "kinetic": e["kinetic"], "stiffness": e["stiffness"].real,
        "width": e["stiffness"].imag,
    }  # fmt: skip


def _faces(problem: Problem) -> list[Interface]:
    return [problem.coupling.model.interfaces[name] for name in problem.coupling.interfaces]


def _identity(problem: Problem) -> dict[str, Any]:
    """What both results say of the problem: the interface of each contact point, settings, model."""
    names = tuple(face.name for face in _faces(problem) if face.kind != "spring" for _ in range(face.n_points))
    return {"interface": names, **problem.recorded()}


def _counted(problem: Problem, system: Equations[Sector]) -> NDArray:
    """(n,) bool: elements of the equations that belong to contacts; cubic and linear springs are a part of the bodies."""
    faces = _faces(problem)
    contact = np.repeat([face.kind in ("friction", "constraint") for face in faces], [face.n_points for face in faces])
    return contact if system.structure.points.index is None else contact[system.structure.points.index]


@one_thread
def hysteresis(problem: Problem, result: Solved, index: int | None = None, *, n_theta: int = 720) -> Hysteresis:
    """Loops of force over displacement at all contact points, at the highest point of a result or at another one.

    Parameters
    ----------
    problem : Problem
    result : ResponseCurve, Peak or OptimalCurve
        Of this problem.
    index : int, optional
        Of the point of a curve, among those with a value; the highest point of a response curve and the least of an optimal
        curve by default.
    n_theta : int
        Steps of the cycle.

    Returns
    -------
    Hysteresis

    Raises
    ------
    SettingError
        If the result is of another problem, or holds no solution.
    """
    n_theta = validation.integer("n_theta", n_theta, least=16)
    if index is None and isinstance(result, ResponseCurve) and len(result):
        index = result.peak.index
    elif index is None and isinstance(result, OptimalCurve):
        known = result.amplitude[np.isfinite(result.amplitude)]
        index = int(np.argmin(known)) if len(known) else None
    solved, branch = _solutions(problem, result)
    k = 0 if index is None else validation.integer("index of a point", index, -len(branch), len(branch) - 1)
    u, frequency, preload = (column[k] for column in solved)
    system = problem.system(preload)
    theta = np.linspace(0.0, 2.0 * np.pi, n_theta + 1)
    X, F = histories(system, u, theta)
    counted, shown = _counted(problem, system), ~problem.coupling.spring_points
    response = complex(system.response(u)[1])
    places = np.arange(system.n_points) if system.structure.points.index is None else system.structure.points.index
    first = np.unique(places, return_index=True)[1]  # of two elements of a point the first, with the point's own normal
    sense = np.where(np.isin(np.arange(len(places)), first), 1.0, -1.0)
    force = _on_points(problem, system, np.stack([F[:, 0], F[:, 1], sense[:, None] * F[:, 2]], axis=1))
    displacement = np.full(force.shape, np.nan)
    displacement[places[first]] = X[first]
    kn, n0 = system.structure.points.kn[first], system.structure.points.n0[first]
    distance = (-n0 / np.where(kn > 0.0, kn, np.nan))[:, None] - X[first, 2]
    gap = np.full(force[:, 2].shape, np.nan)
    gap[places[first]] = np.where(force[places[first], 2] != 0.0, 0.0, np.maximum(distance, 0.0))
    at_points = {"displacement": displacement, "force": force, "gap": gap}
    of_faces = {n: np.concatenate([getattr(face, n) for face in _faces(problem)]) for n in ("points", "frame", "area")}
    columns: dict[str, Any] = {name: values[shown] for name, values in (at_points | of_faces).items()}
    return Hysteresis(
        theta=theta, response=(response * np.exp(1j * theta)).real, whole=_whole(system, u, F, theta, counted),
        **_of_solution(problem, u, frequency, preload), **columns, **_identity(problem),
    )  # fmt: skip


def _whole(system: Equations[Sector], u: NDArray, F: NDArray, theta: NDArray, counted: NDArray) -> NDArray:
    """(n_theta,) force at the response that does the work of all contacts on the fundamental harmonic."""
    (_, mean, _), response = system.contact(u), complex(system.response(u)[1])
    if response == 0.0:
        return np.full(len(theta), np.nan)
    ratio = (bodily_motion(system, u) / response)[counted]
    vibration = (F - mean[..., :1])[counted]
    out = np.zeros(len(theta))
    for r, f in zip(ratio.ravel(), vibration.reshape(-1, len(theta))):
        out += abs(r) * np.interp((theta - np.angle(r)) % (2.0 * np.pi), theta, f)
    return out


# ---- First loading of a seated damper along its faces ----


@asked
def microslip(
    problem: Problem,
    preload: float,
    forces: Sequence[float] | NDArray,
    *,
    location: str = "damper",
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> SweepResult:
    """Displacement of a location under forces that grow while the load stays.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    forces : (n,) float, N
        Increasing, above zero.
    location : str
    direction : (3,) float
        Of the force, along X, Y, Z.

    Returns
    -------
    SweepResult
        Over "force", from zero: "displacement" of the location along it (m), since the force is there; "slipping" and
        "open", shares of the closed points that slip in either direction and of all points that are apart; "residual" of
        modal equilibrium, relative.  Forces under which the damper slides have failed.

    Raises
    ------
    SettingError
        If the forces do not increase from zero.
    ModelError
        If there is no static state under the preload.
    """
    wanted = validation.numbers("microslip forces", forces, above=0.0, unit="N")
    validation.check_value(not np.any(np.diff(wanted) <= 0.0), "microslip forces", "increasing forces above 0 N", forces)
    validation.choice("microslip location", location, sorted(problem.model.locations))
    seat = problem.static(preload)
    if not seat.converged:
        raise ModelError(f"microslip: no static state under {preload:g} N: {seat.note}")
    basis = problem.static_basis
    along = problem.coupling.location_modes(location, 0).real
    d = direction_vector(direction, "microslip direction") @ np.pad(along, ((0, 0), (0, basis.n_modes - along.shape[1])))
    if not np.any(d):
        raise SettingError(f"microslip: expected a location that moves along {direction}, '{location}' does not")
    own = problem.static_system
    system = replace(
        own, force=d.real, shift=np.zeros_like(own.shift), constant_force=preload * own.force + own.constant_force,
        constant_shift=own.shift_at(preload),
    )  # fmt: skip
    state = replace(seat, load=0.0)
    values = [_answers(state, 0.0)]
    for force in wanted:
        state = static_state(system, float(force), start=state, steps=2)
        if not state.converged:
            break
        values.append(_answers(state, float(d.real @ (state.q - seat.q))))
    beyond = len(wanted) + 1 - len(values)
    status = (COMPLETE,) * len(values) + (with_reason(FAILED, "the damper slides"),) * beyond
    points = tuple({"force": force} for force in (0.0, *wanted.tolist()))
    found = (*values, *[{}] * beyond)
    return SweepResult(("force",), points, found, status, np.zeros(len(points)), (len(points),), **problem.recorded())


def _answers(state: PreloadState, moved: float) -> dict[str, float]:
    closed = float(np.mean(state.status[:, 0] != OPEN))
    slips = float(((state.status == SLIP_PLUS) | (state.status == SLIP_MINUS)).any(axis=1).mean())
    slipping = slips / max(closed, 1e-300)
    return {"displacement": moved, "slipping": slipping, "open": 1.0 - closed, "residual": state.residual}
