"""Reading and writing of models, and models from the files of finite element programs."""

from bdamper.io.build import BuiltModel, ContactFaces, build_model
from bdamper.io.fe_body import UNITS, FEBody, MassProperties, Modes, Receptance, Units
from bdamper.io.import_report import ImportReport
from bdamper.io.matrices import read_abaqus_matrix, read_arrays, read_dofs, read_matrix, read_nodes, read_set
from bdamper.io.model_file import load_model, save_model

__all__ = [
    "UNITS",
    "BuiltModel",
    "ContactFaces",
    "FEBody",
    "ImportReport",
    "MassProperties",
    "Modes",
    "Receptance",
    "Units",
    "build_model",
    "load_model",
    "read_abaqus_matrix",
    "read_arrays",
    "read_dofs",
    "read_matrix",
    "read_nodes",
    "read_set",
    "save_model",
]
