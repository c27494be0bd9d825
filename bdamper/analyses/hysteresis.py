"""Hysteresis of the contacts: loops, dissipated energy, and the curve of first loading.

Loops
    :mod:`bdamper.harmonic_balance.contact_cycle` contains the equations. The loop of a face is the
    sum of its point forces over the mean displacement of its points, weighted by area. The loop of
    all contacts is the force at the response location that does the same work on the fundamental
    harmonic. With the relative motion ``X_i`` of point i in the fundamental harmonic and the
    response ``x``, the point moves as the response times ``|X_i/x|`` with the phase of ``X_i/x``.
    The force is

        f(theta) = sum_i |X_i/x| f_i(theta - phase of X_i/x)

    without the mean forces, which do no work. The area of this loop is the energy that the contacts
    dissipate from the fundamental harmonic. Its slope and width give the equivalent stiffness and
    damping.

First loading
    The damper is at rest under the preload :math:`P`, and a force :math:`Q` at one of its locations
    grows from zero. The static equations of :mod:`bdamper.contact.static_state` become

    .. math:: K q + G^T F(G q + P x_0) = P f + Q d

    where :math:`d` is the motion of the location in each mode, along :math:`Q`. Residual modes do
    not move the location, so curves for different contact stiffnesses differ by the contact only.
    Points begin to slip one after the other. The slope decreases from the stuck stiffness to zero,
    at the force at which the damper slides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.sweep import SweepResult
from bdamper.contact.static_state import static_state
from bdamper.harmonic_balance.checks import Solutions, solutions_of
from bdamper.harmonic_balance.contact_cycle import bodily_motion, energies, histories
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import SectorData
from bdamper.harmonic_balance.study_boundary import accepts_study
from bdamper.model.loads import direction_vector
from bdamper.model.structure import Interface
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable, Result, draw
from bdamper.util.errors import COMPLETE, FAILED, ModelError, SettingError
from bdamper.util.formatting import amount, peak_text, percent, short_repr, without_rounding
from bdamper.util.progress import one_thread
from bdamper.util.records import named_fields
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import FilePath, Recorded, Storable
from bdamper.util.tables import ROW, Column, Quantity, Tabular

AXES = ("t1", "t2", "n")
WHOLE = "whole"
"""Name of the loop of all contacts."""
NOTHING = 1e-9
"""Dissipated energy relative to the work of the excitation below which nothing slips: the residual
of a solution.
"""
Solved = ResponseCurve | Peak | OptimalCurve


_OF_CONTACTS = {
    "dissipated (mJ)": "dissipated by contacts (mJ)",
    "damping ratio (%)": "damping ratio, contacts only (%)",
}
"""Printed names of columns that do not contain the modal damping."""


@short_repr
@dataclass(frozen=True)
class Hysteresis(Result, Plottable, Tabular, Recorded, Storable, kind="bdamper-hysteresis"):
    """Energies, equivalent stiffness and damping of the contacts, and loops for a single solution.

    For a single solution the fields are numbers, or arrays over the contact points. For several
    solutions each has a row, and there are no loops.

    ``plot`` draws loops of force against displacement, or stiffness and damping of several
    solutions against amplitude (:func:`bdamper.plot.plot_hysteresis`). ``plot_history`` draws time
    histories of forces and gap (:func:`bdamper.plot.plot_history`), ``plot_energy`` the dissipated
    energy on the faces (:func:`bdamper.plot.plot_energy`).

    Parameters
    ----------
    preload : float or (n,) float, N
    frequency : float or (n,) float, Hz
    amplitude : float or (n,) float, m
        Amplitude of the fundamental harmonic of the response.
    interface : tuple of str
        Interface of each contact point.
    energy : (n_points,) or (n, n_points) float, J
        Energy dissipated at each contact point per cycle.
    damping, excitation : float or (n,) float, J
        Energy dissipated by modal damping, and work of the excitation, per cycle and sector.
    kinetic : float or (n,) float, J
        Maximum kinetic energy if all points pass the mean position simultaneously.
    stiffness, width : float or (n,) float, N/m
        Equivalent stiffness of the contacts at the response location, and equivalent viscous
        damping times angular frequency; NaN if the response is zero.
    branch : (n,) int
        Branch of the curve of each solution.
    theta : (n_theta,) float, rad
        Phase angle of the excitation from 0 to 2 pi, both included.
    points : (n_points, 3) float, m
    frame : (n_points, 3, 3) float
        Rows t1, t2, n.
    area : (n_points,) float, m2
    displacement : (n_points, 3, n_theta) float, m
        Relative displacement of the contact elements along t1 and t2, and closing along n. It
        includes the elasticity of residual modes. NaN at points that the settings omit.
    force : (n_points, 3, n_theta) float, N
    gap : (n_points, n_theta) float, m
        Distance of the surfaces, 0 in contact; NaN at points without normal spring.
    response : (n_theta,) float, m
        Fundamental harmonic of the response.
    whole : (n_theta,) float, N
        Force at the response location equivalent to all contacts.
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
    _summary_fields = (
        "preload",
        "frequency",
        "amplitude",
        "excitation",
        "damping",
        "stiffness",
        "damping_ratio",
        "by_interface",
    )

    def __len__(self) -> int:
        return np.size(self.frequency)

    @property
    def single(self) -> bool:
        """Whether the result belongs to a single solution and has loops."""
        return self.theta is not None

    @property
    def axis(self) -> Annotated[tuple[str, ...], Quantity(dims=("axis",))]:
        """Names of the axes of displacements and forces."""
        return AXES

    @property
    def interfaces(self) -> tuple[str, ...]:
        """Names of the interfaces."""
        return tuple(dict.fromkeys(self.interface))

    @property
    def by_interface(self) -> dict[str, Any]:
        """Energy dissipated per cycle on each interface, J."""
        return {name: self.energy[..., self.rows(name)].sum(axis=-1) for name in self.interfaces}

    @property
    def lost(self) -> Annotated[Any, Quantity("J", name="dissipated")]:
        """Energy dissipated per cycle by all contacts, J."""
        return self.energy.sum(axis=-1)

    @property
    def damping_ratio(self) -> Annotated[Any, Quantity(label="Equivalent damping ratio")]:
        """Equivalent damping ratio of the contacts.

        It is the dissipated energy over 4 pi times the kinetic energy.
        """
        at_rest = np.equal(self.kinetic, 0.0)
        return self.lost / np.where(at_rest, np.nan, 4.0 * np.pi * self.kinetic)

    @property
    def viscous(self) -> Annotated[Any, Quantity("N s/m", name="viscous_damping")]:
        """Equivalent viscous damping, N s/m."""
        return self.width / (2.0 * np.pi * self.frequency)

    @property
    def imbalance(self) -> Any:
        """Error of the energy balance.

        It is the work of the excitation minus all dissipated energies, relative to the work.
        """
        work = np.where(np.equal(self.excitation, 0.0), np.nan, self.excitation)
        return (self.excitation - self.damping - self.lost) / work

    def _dimension(self) -> str:
        return "contact_point" if self.single else "point"

    def columns(self) -> dict[str, Column]:
        """Return one row for each contact point, or for each of several solutions."""
        columns = super().columns()
        if not self.single:
            for name, energy in self.by_interface.items():
                columns[f"dissipated_{name}"] = Column(energy, "J")
            return columns
        n_points = len(self.interface)
        of_points = {
            name: column
            for name, column in columns.items()
            if column.dims or len(column.values) == n_points
        }
        # a row of the table is a contact point
        for name in ("interface", "energy"):
            of_points[name] = of_points[name]._replace(dims=())
        return of_points

    def rows(self, interface: str) -> NDArray:
        """Return the indices of the points of an interface."""
        validation.choice("interface", interface, self.interfaces)
        return np.flatnonzero(np.array(self.interface) == interface)

    def loop(self, where: int | str = WHOLE, direction: str = "t1") -> tuple[NDArray, NDArray]:
        """Return displacement (m) without its mean, and force (N), (n_theta,) each, over one cycle.

        Parameters
        ----------
        where : int or str
            Index of a contact point, name of an interface, or "whole" for all contacts.
        direction : {"t1", "t2", "n"}
            Direction at a point or an interface.

        Raises
        ------
        SettingError
            If there is no such point or interface, or the settings omit it.
        """
        axis = AXES.index(validation.choice("direction", direction, AXES))
        if isinstance(where, str):
            validation.choice("where", where, (WHOLE, *self.interfaces))
            if where == WHOLE:
                return self.response, self.whole
            rows = self.rows(where)
        else:
            last = len(self.points) - 1
            rows = np.array([validation.integer("where, index of a contact point", where, 0, last)])
        active = np.isfinite(self.displacement[rows, 0, 0])
        rows = rows[active]
        validation.check(
            len(rows), "where", "an active contact", f"{where!r}, which the settings omit"
        )
        mean_over_face = np.average(self.displacement[rows, axis], axis=0, weights=self.area[rows])
        # the last angle repeats the first
        vibration = mean_over_face - mean_over_face[:-1].mean()
        return vibration, self.force[rows, axis].sum(axis=0)

    def plot_history(self, where: int, path: FilePath | None = None, **options: Any) -> Any:
        """Draw the time histories of forces and gap of a contact point
        (:func:`bdamper.plot.plot_history`).
        """
        return draw(self, "figure", "history", path, where, **options)

    def plot_energy(self, path: FilePath | None = None) -> Any:
        """Draw the energy dissipated per cycle on the faces (:func:`bdamper.plot.plot_energy`)."""
        return draw(self, "figure", "energy", path)

    def _facts(self) -> tuple[Fact, ...]:
        return super()._facts() if self.single else ()

    def _statement(self) -> Statement:
        if not self.single:
            i = int(np.argmax(self.damping_ratio))
            peak = peak_text(self.amplitude[i], self.frequency[i])
            subject = f"{peak}, preload {amount(self.preload[i], 'N')}"
            ratio = percent(self.damping_ratio[i])
            table, further = self._few_rows()
            return Statement(
                [f"Largest damping ratio of the contacts {ratio}: {subject}"],
                remarks=further,
                table=table,
            )
        share = self.lost / self.excitation if self.excitation else float("nan")
        subject = peak_text(self.amplitude, self.frequency)
        rows = [
            Row("Work of the excitation", self._energy_text(self.excitation), "per period"),
            Row("Modal damping", self._energy_text(self.damping)),
            Row("Contacts", self._energy_text(self.lost), f"{percent(share)} of the work"),
            *self._interface_rows(),
            Row("Equivalent damping ratio", percent(self.damping_ratio), "contacts only"),
            Row("Equivalent stiffness", amount(self.stiffness, "N/m"), "contacts only"),
        ]
        verdict = f"The contacts dissipate {percent(share)} of the work of the excitation"
        return Statement([f"{verdict}: {subject}, preload {amount(self.preload, 'N')}"], rows)

    def _rows(self) -> list[tuple[str, ...]]:
        """Return the table with names that distinguish contacts from modal damping."""
        return [tuple(_OF_CONTACTS.get(cell, cell) for cell in row) for row in super()._rows()]

    def _interface_rows(self) -> list[Row]:
        """Return the energy that each of several interfaces dissipates."""
        if len(self.by_interface) < 2:
            return []
        return [
            Row(f"  {name}", self._energy_text(lost)) for name, lost in self.by_interface.items()
        ]

    def _energy_text(self, energy: float) -> str:
        """Return an energy (J); one that is rounding error of the work is zero."""
        return amount(without_rounding(energy, self.excitation), "J")


def _solutions(problem: Problem, result: Solved) -> tuple[Solutions, NDArray]:
    """Return the converged solutions of a result, and the branch of each."""
    kinds = ResponseCurve, Peak, OptimalCurve
    validation.instance(
        "result", result, kinds, "a response curve, a peak or an optimal curve of this study"
    )
    if isinstance(result, ResponseCurve):
        check_curve(problem, result)
    solutions = solutions_of(problem, result)
    if isinstance(result, ResponseCurve):
        branch = result.branch
    elif isinstance(result, OptimalCurve):
        branch = np.cumsum(~result.goes_on)
    else:
        branch = np.zeros(1, int)
    solved = np.isfinite(solutions.frequency)
    empty = f"this {type(result).__name__} has no converged solution"
    validation.check_sentence(solved.any(), "result", empty)
    return Solutions(*(column[solved] for column in solutions)), branch[solved]


def _on_points(problem: Problem, system: Equations[SectorData], values: NDArray) -> NDArray:
    """Sum values of the contact elements at each contact point of the model."""
    index = system.structure.points.index
    if index is None:
        return values
    # a point may have several elements
    sums = np.zeros((problem.coupling.n_points, *values.shape[1:]))
    np.add.at(sums, index, values)
    return sums


@one_thread
def dissipation(problem: Problem, result: Solved) -> Hysteresis:
    """See :meth:`bdamper.Study.dissipation`."""
    solutions, branch = _solutions(problem, result)
    rows = [
        _of_solution(problem, u, frequency, preload) for u, frequency, preload, _ in zip(*solutions)
    ]
    columns: dict[str, Any] = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return Hysteresis(branch=branch, **columns, **_identity(problem))


def _of_solution(problem: Problem, u: NDArray, frequency: float, preload: float) -> dict[str, Any]:
    """Return energies, equivalent stiffness and damping of one solution."""
    system = problem.system(preload)
    omega = 2.0 * np.pi * frequency
    energy = energies(system, u, omega, _in_contacts(problem, system))
    shown = ~problem.coupling.spring_points
    return {
        "preload": float(preload),
        "frequency": float(frequency),
        "amplitude": float(np.abs(system.response(u)[1])),
        "energy": _on_points(problem, system, energy["contact"])[shown],
        "damping": energy["damping"],
        "excitation": energy["excitation"],
        "kinetic": energy["kinetic"],
        "stiffness": energy["stiffness"].real,
        "width": energy["stiffness"].imag,
    }


def _faces(problem: Problem) -> list[Interface]:
    interfaces = problem.coupling.model.interfaces
    return [interfaces[name] for name in problem.coupling.interfaces]


def _identity(problem: Problem) -> dict[str, Any]:
    """Return the interface of each contact point, and settings and model of the problem."""
    names: list[str] = []
    for face in _faces(problem):
        if face.kind != "spring":
            names += [face.name] * face.n_points
    return {"interface": tuple(names), **problem.recorded()}


def _in_contacts(problem: Problem, system: Equations[SectorData]) -> NDArray:
    """Return which contact elements (n,) belong to contacts; springs between bodies do not."""
    faces = _faces(problem)
    is_contact = [face.kind in ("friction", "constraint") for face in faces]
    of_points = np.repeat(is_contact, [face.n_points for face in faces])
    index = system.structure.points.index
    return of_points if index is None else of_points[index]


@one_thread
def hysteresis(
    problem: Problem, result: Solved, index: int | None = None, *, n_theta: int = 720
) -> Hysteresis:
    """See :meth:`bdamper.Study.hysteresis`."""
    n_theta = validation.integer("n_theta", n_theta, least=16)
    if index is None:
        index = _most_interesting(result)
    solutions, _ = _solutions(problem, result)
    n_solutions = len(solutions.frequency)
    if index is None:
        index = 0
    else:
        validation.integer("index of a point", index, -n_solutions, n_solutions - 1)
    u, frequency, preload, _ = (column[index] for column in solutions)
    system = problem.system(preload)
    theta = np.linspace(0.0, 2.0 * np.pi, n_theta + 1)
    X, F = histories(system, u, theta)

    # a point may have two elements; the first has the normal of the point
    points = system.structure.points
    point_of_element = np.arange(system.n_points) if points.index is None else points.index
    first = np.unique(point_of_element, return_index=True)[1]
    has_normal = np.isin(np.arange(len(point_of_element)), first)
    normal_sign = np.where(has_normal, 1.0, -1.0)
    normal_force = normal_sign[:, None] * F[:, 2]
    force = _on_points(problem, system, np.stack([F[:, 0], F[:, 1], normal_force], axis=1))
    active = point_of_element[first]
    displacement = np.full(force.shape, np.nan)
    displacement[active] = X[first]
    kn = points.kn[first]
    # a point without normal spring has no gap
    distance = (-points.n0[first] / np.where(kn > 0.0, kn, np.nan))[:, None] - X[first, 2]
    gap = np.full(force[:, 2].shape, np.nan)
    closed = force[active, 2] != 0.0
    gap[active] = np.where(closed, 0.0, np.maximum(distance, 0.0))

    shown = ~problem.coupling.spring_points
    faces = _faces(problem)
    response = complex(system.response(u)[1])
    return Hysteresis(
        **_of_solution(problem, u, frequency, preload),
        theta=theta,
        points=np.concatenate([face.points for face in faces])[shown],
        frame=np.concatenate([face.frame for face in faces])[shown],
        area=np.concatenate([face.area for face in faces])[shown],
        displacement=displacement[shown],
        force=force[shown],
        gap=gap[shown],
        response=(response * np.exp(1j * theta)).real,
        whole=_whole(system, u, F, theta, _in_contacts(problem, system)),
        **_identity(problem),
    )


def _most_interesting(result: Solved) -> int | None:
    """Return the index of the peak of a response curve, or of the optimum; None without one."""
    if isinstance(result, ResponseCurve) and len(result):
        return result.peak_index
    if isinstance(result, OptimalCurve):
        # the index counts the preloads with a solution
        amplitude = result.amplitude[np.isfinite(result.amplitude)]
        if len(amplitude):
            return int(np.argmin(amplitude))
    return None


def _whole(
    system: Equations[SectorData], u: NDArray, F: NDArray, theta: NDArray, in_contacts: NDArray
) -> NDArray:
    """Return the force (n_theta,) at the response location that is equivalent to all contacts."""
    response = complex(system.response(u)[1])
    if response == 0.0:
        return np.full(len(theta), np.nan)
    _, mean_force, _ = system.contact(u)
    # work of a contact force over the work of the same force at the response location
    ratio = (bodily_motion(system, u) / response)[in_contacts]
    vibration = (F - mean_force[..., :1])[in_contacts]
    whole = np.zeros(len(theta))
    for r, force in zip(ratio.ravel(), vibration.reshape(-1, len(theta))):
        shifted = (theta - np.angle(r)) % (2.0 * np.pi)
        whole += abs(r) * np.interp(shifted, theta, force)
    return whole


@accepts_study
@validation.check_arguments
def microslip(
    problem: Problem,
    preload: float,
    forces: Sequence[float] | NDArray,
    *,
    location: str = "damper",
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> SweepResult:
    """Compute the displacement of a location while the force on it increases at constant preload.

    The calculation is quasistatic and starts from the static state.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    forces : (n,) float, N
        Positive forces in increasing order.
    location : str
        Location at which the force acts.
    direction : (3,) float
        Direction of the force along X, Y, Z.

    Returns
    -------
    SweepResult
        One row per force, beginning with zero.  "displacement" (m) is measured along the force.
        "slipping" is the fraction of closed points that slip, and "open" the fraction of friction
        points without contact.  "residual" is the relative residual of modal equilibrium.  The status
        is "failed" at the force at which the damper starts to slide, and above.

    Raises
    ------
    SettingError
        If the forces do not increase, or the location cannot move along their direction.
    ModelError
        If there is no static state under the preload.
    """
    increasing = validation.numbers("microslip forces", forces, above=0.0, unit="N")
    validation.check_value(
        not np.any(np.diff(increasing) <= 0.0),
        "microslip forces",
        "increasing forces above 0 N",
        forces,
    )
    validation.choice("microslip location", location, sorted(problem.model.locations))
    seat = problem.static(preload)
    if not seat.ok:
        raise ModelError(f"microslip: no static state under {preload:g} N: {seat.reason}")
    modes = problem.coupling.location_modes(location, harmonic=0).real
    # residual modes move no location
    n_residual = problem.static_basis.n_modes - modes.shape[1]
    modes = np.pad(modes, ((0, 0), (0, n_residual)))
    unit_force = direction_vector(direction, "microslip direction") @ modes
    if not np.any(unit_force):
        raise SettingError(
            f"microslip: expected a location that moves along {direction}; '{location}' does not"
        )
    # the load of these equations is the force; the preload is constant
    static = problem.static_system(preload)
    system = replace(
        static,
        force=unit_force.real,
        shift=np.zeros_like(static.shift),
        constant_force=preload * static.force + static.constant_force,
        constant_shift=static.shift_at(preload),
    )
    steps = np.append(0.0, increasing)
    rows: list[dict[str, float]] = []
    state = replace(seat, load=0.0)
    for force in steps:
        if force > 0.0:
            state = static_state(system, float(force), start=state, steps=2)
        if not state.ok:
            break
        on_friction = replace(state, on_friction_face=problem.friction_points).friction_state
        n_open = on_friction.count("open")
        n_closed = len(on_friction) - n_open
        rows.append(
            {
                "displacement": float(unit_force.real @ (state.q - seat.q)),
                "slipping": on_friction.count("slip") / max(n_closed, 1),
                "open": n_open / len(on_friction),
                "residual": float(state.residual),
            }
        )
    n = len(steps)
    n_failed = n - len(rows)
    columns = {name: [row[name] for row in rows] + [np.nan] * n_failed for name in rows[0]}
    return SweepResult(
        names=("force",),
        points=named_fields({"force": steps}, n),
        values=named_fields(columns, n),
        status=(COMPLETE,) * len(rows) + (FAILED,) * n_failed,
        reason=("",) * len(rows) + ("the damper slides",) * n_failed,
        seconds=np.zeros(n),
        shape=(n,),
        **problem.recorded(),
    )
