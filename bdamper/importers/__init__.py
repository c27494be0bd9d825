"""Models from the files of finite element programs and from matrices, and measured responses.

Each ``read_...`` function reads files of Abaqus, Ansys, CalculiX, Nastran, MATLAB or plain arrays;
most return an `FEBody`.  `build_model` checks units, axes and sector faces, computes the contact
points of `ContactFaces`, reduces the bodies and returns a `BuiltModel`, which prints its report.
Its options are `Sector`, `Placement`, `Reduction`, `Checks`.  `load_measured`, `read_response`,
`read_responses`, `read_mode`, `read_ring_down` and `read_measurements` read measured data.
"""

from bdamper.importers.abaqus import read_abaqus, read_calculix, read_frd, read_inp
from bdamper.importers.ansys import read_ansys, read_cdb, read_full, read_rst
from bdamper.importers.arrays import (
    read_abaqus_matrix,
    read_arrays,
    read_dofs,
    read_elements,
    read_matrix,
    read_nodes,
    read_set,
)
from bdamper.importers.bodies import over_speed
from bdamper.importers.build import BuiltModel, build_model
from bdamper.importers.contact_faces import ContactFaces
from bdamper.importers.example_decks import example_decks, read_job
from bdamper.importers.fe_body import UNITS, FEBody, MassProperties, Modes, Units, read_body
from bdamper.importers.measured_modes import MeasuredMode, read_mode, read_ring_down
from bdamper.importers.measurements import (
    Measurement,
    load_measured,
    read_measurements,
    read_response,
    read_responses,
)
from bdamper.importers.nastran import read_bdf, read_nastran
from bdamper.importers.op2 import read_op2
from bdamper.importers.op4 import read_op4
from bdamper.importers.options import Checks, Placement, Reduction, Sector

__all__ = [
    "UNITS",
    "BuiltModel",
    "Checks",
    "ContactFaces",
    "FEBody",
    "MassProperties",
    "MeasuredMode",
    "Measurement",
    "Modes",
    "Placement",
    "Reduction",
    "Sector",
    "Units",
    "build_model",
    "example_decks",
    "load_measured",
    "over_speed",
    "read_abaqus",
    "read_abaqus_matrix",
    "read_ansys",
    "read_arrays",
    "read_bdf",
    "read_body",
    "read_calculix",
    "read_cdb",
    "read_dofs",
    "read_elements",
    "read_frd",
    "read_full",
    "read_inp",
    "read_job",
    "read_matrix",
    "read_measurements",
    "read_mode",
    "read_nastran",
    "read_nodes",
    "read_op2",
    "read_op4",
    "read_response",
    "read_responses",
    "read_ring_down",
    "read_rst",
    "read_set",
]
