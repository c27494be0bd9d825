"""Model files, and models from the files of finite element programs.

In: a model file, or numbers and files of Abaqus, Ansys, CalculiX, Nastran, MATLAB and others, which the `read_...`
functions turn into an `FEBody` each; a measured response.  Out: a :class:`bdamper.model.model.Model` from `load_model`,
or a `BuiltModel`, which prints its report, from `build_model`, which checks units, axes and sector faces, lays the contact
points (`ContactFaces`) and reduces the bodies.  `save_model` writes a model file.
"""

from bdamper.io.ansys import read_ansys, read_cdb, read_full, read_rst
from bdamper.io.build import build_model
from bdamper.io.built_model import BuiltModel
from bdamper.io.calculix import read_calculix, read_frd, read_inp
from bdamper.io.contact_faces import ContactFaces
from bdamper.io.fe_body import UNITS, FEBody, MassProperties, Modes, Units
from bdamper.io.matrices import read_abaqus_matrix, read_arrays, read_dofs, read_elements, read_matrix, read_nodes, read_set
from bdamper.io.measured import Measurement, load_measured, read_response
from bdamper.io.model_file import load_model, save_model
from bdamper.io.nastran import read_bdf, read_nastran, read_op2, read_op4
from bdamper.io.over_speed import over_speed
from bdamper.io.reading import read_body
from bdamper.io.universal_file import read_measurements, read_unv

__all__ = [
    "UNITS", "BuiltModel", "ContactFaces", "FEBody", "MassProperties", "Measurement", "Modes",
    "Units", "build_model", "load_measured", "load_model", "over_speed", "read_abaqus_matrix", "read_ansys",
    "read_arrays", "read_bdf", "read_body", "read_calculix", "read_cdb", "read_dofs", "read_elements", "read_frd",
    "read_full", "read_inp", "read_matrix", "read_measurements", "read_nastran", "read_nodes", "read_op2",
    "read_op4", "read_response", "read_rst", "read_set", "read_unv", "save_model",
]  # fmt: skip
