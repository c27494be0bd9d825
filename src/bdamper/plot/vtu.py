"""Export of mode shapes and responses to VTU files, for ParaView (through meshio, extra ``bdamper[viz]``)."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_dispatch import asked
from bdamper.model.structure import Model
from bdamper.plot.motion import surface_motion
from bdamper.util import validation
from bdamper.util.errors import SettingError, needed
from bdamper.util.storage import writing


def shown_shapes(model: Model, body: str | None, nodal_diameter: int | None, what: str) -> tuple[str, int]:
    """Body and nodal diameter whose shapes are shown: those asked for, or the first that the meshes carry."""
    carriers = [name for name, mesh in model.meshes.items() if mesh.modes]
    body = carriers[0] if body is None and carriers else body
    validation.require(carriers, what, "a model with mode shapes on the mesh of a body", "none")
    if body not in carriers:
        raise SettingError(f"{what}: expected a body with mode shapes on its mesh out of {carriers}, found {body!r}")
    modes = model.meshes[body].modes
    d = next(iter(modes)) if nodal_diameter is None else nodal_diameter
    validation.require(d in modes, what, f"a nodal diameter out of {sorted(modes)}", d)
    return body, d


def export_modes(
    model: Model, path: str | PathLike[str], body: str | None = None, nodal_diameter: int | None = None
) -> Path:
    """Write the mode shapes on the surface of a body, one pair of vector fields (real, imaginary) for each mode.

    Parameters
    ----------
    model : Model
    path : path-like
        Ends with ``.vtu``.
    body : str, optional
        The first one that carries shapes by default.
    nodal_diameter : int, optional
        The first one that is there by default.

    Returns
    -------
    Path

    Raises
    ------
    SettingError
        If the model carries no such shapes.
    """
    meshio = needed("meshio", "export to VTU", "viz")
    body, d = shown_shapes(model, body, nodal_diameter, "export of modes")
    mesh = model.meshes[body]
    frequency = np.sqrt(model.bodies[body].bases[d].omega2) / (2.0 * np.pi)
    fields: dict[str, NDArray] = {}
    for k in range(mesh.modes[d].shape[2]):
        shape, name = mesh.modes[d][..., k], f"mode {k + 1}, {frequency[k]:.2f} Hz"
        fields[f"{name}, real"] = np.ascontiguousarray(shape.real)
        if np.iscomplexobj(shape):
            fields[f"{name}, imaginary"] = np.ascontiguousarray(shape.imag)
    with writing(path):
        meshio.Mesh(mesh.points, [("quad", mesh.quads)], point_data=fields).write(path)
    return Path(path)


@asked
def export_response(problem: Problem, unknowns: NDArray, folder: str | PathLike[str], name: str = "response") -> list[Path]:
    """Write the motion of every body with a surface at one solution: mean, real and imaginary part of the vibration.

    The mean is left out where the mesh has no mode shapes of nodal diameter 0.

    Parameters
    ----------
    problem : Problem
    unknowns : (n_unknowns,) float
        For example ``curve.unknowns[curve.peak.index]``.
    folder : path-like
    name : str
        Files are called ``<name>_<body>.vtu``.

    Returns
    -------
    list of Path

    Raises
    ------
    SettingError
        If the model has no surface, or one without mode shapes at the nodal diameter of the excitation.
    """
    if not problem.model.meshes:
        raise SettingError("export of a response: expected a model with the surface of a body, found none")
    meshio = needed("meshio", "export to VTU", "viz")
    out = []
    for body, motion in surface_motion(problem, unknowns).items():
        path = Path(folder) / f"{name}_{body}.vtu"
        mean = {"mean displacement, m": motion.mean} if np.isfinite(motion.mean).all() else {}
        fields = mean | {
            "vibration, real, m": np.ascontiguousarray(motion.amplitude.real),
            "vibration, imaginary, m": np.ascontiguousarray(motion.amplitude.imag),
        }
        quads = problem.model.meshes[body].quads
        with writing(path):
            meshio.Mesh(motion.points, [("quad", quads)], point_data=fields).write(path)
        out.append(path)
    return out
