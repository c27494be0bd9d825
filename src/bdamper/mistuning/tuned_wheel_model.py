"""The model whose modes are those of the local basis: the tuned wheel in the very space of the mistuned one."""

from __future__ import annotations

from dataclasses import replace

from bdamper.model.structure import Model, SurfaceMesh
from bdamper.model.validation import as_checked
from bdamper.util.errors import ModelError


def local_model(model: Model) -> Model:
    """The same model with all modes of its local basis at every nodal diameter from 0 to N/2.

    A study of it with as many ``blade_modes`` as the basis has coordinates spans the same space as a wheel does.  Shapes
    for pictures, rows of stress and changes with rotor speed belong to the modes that it replaces and are left out.

    Raises
    ------
    ModelError
        If no body of the model carries a local basis.
    """
    bodies, meshes, stress = dict(model.bodies), dict(model.meshes), dict(model.stress)
    for name, body in model.bodies.items():
        if body.local is not None:
            bases = {d: body.local.nodal_diameter(d) for d in range(model.n_blades // 2 + 1)}
            bodies[name] = replace(body, bases=bases)
            if name in meshes:  # its mode shapes are those of other modes
                meshes[name] = SurfaceMesh(meshes[name].points, meshes[name].quads)
            stress = {key: rows for key, rows in stress.items() if rows.body != name}
    if all(body.local is None for body in model.bodies.values()):
        raise ModelError(
            "a wheel needs a local basis of blade and disk, and no body of the model carries one; "
            "bladed_disk(wheel=LocalSizes()) of bdamper.fem and build_model(wheel=nodes of the blade) make it"
        )
    return as_checked(replace(model, bodies=bodies, meshes=meshes, stress=stress))
