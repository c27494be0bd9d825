"""Keywords of mesh files, grouped by their effect on nodes, elements and sets.

For decks of CalculiX and Abaqus, and for archives of Ansys, tables hold the keywords that create,
move or tie nodes, elements or sets, which are errors.  The readers note the names of keywords that
they pass over.

For bulk data of Nastran the reader accepts three groups of cards: cards that define the mesh, cards
without effect on it, and cards that add stiffness or mass, which only the matrices contain.  Any
other card is an error.

References
----------
G. Dhondt, *CalculiX CrunchiX User's Manual*; Dassault Systèmes, *Abaqus Keywords Reference Guide*;
Ansys, *Command Reference*; MSC, *Nastran Quick Reference Guide*.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum
from typing import NoReturn

from bdamper.util.errors import check, mismatch


def _table(text: str) -> frozenset[str]:
    return frozenset(text.split())


def refuse(found: str, item: str, read: Iterable[str]) -> NoReturn:
    """Raise a ModelError for a keyword that belongs to none of the groups.

    Parameters
    ----------
    found : str
        Keyword.
    item : str
        File and line.
    read : iterable of str
        Keywords that are read.

    Raises
    ------
    ModelError
        Always.
    """
    advice = (
        "which may create, move or tie nodes, elements or sets and is not read: write the mesh "
        "without it"
    )
    raise mismatch(item, f"a mesh of {', '.join(read)}", f"{found}, {advice}")


# --------------------------------------------------------------------------------------------------
# CalculiX and Abaqus; names without blanks, because both programs ignore them

INP_READ: Mapping[str, frozenset[str]] = {
    "*INCLUDE": _table("INPUT"),
    "*PART": _table("NAME"),
    "*ENDPART": _table(""),
    "*ASSEMBLY": _table("NAME"),
    "*ENDASSEMBLY": _table(""),
    "*INSTANCE": _table("NAME PART"),
    "*ENDINSTANCE": _table(""),
    "*SYSTEM": _table(""),
    "*NODE": _table("NSET SYSTEM"),
    "*NGEN": _table("NSET"),
    "*NFILL": _table("NSET"),
    "*ELEMENT": _table("TYPE ELSET"),
    "*ELGEN": _table("ELSET"),
    "*NSET": _table("NSET ELSET INSTANCE GENERATE UNSORTED INTERNAL"),
    "*ELSET": _table("ELSET INSTANCE GENERATE UNSORTED INTERNAL"),
    "*SURFACE": _table("NAME TYPE INTERNAL"),
    "*TRANSFORM": _table("NSET TYPE"),
}
"""Keywords that define the mesh, with their permitted parameters."""

INP_IN_MATRICES = _table(
    """*BEAMGENERALSECTION *BEAMSECTION *CONTACT *CONTACTCONTROLS *CONTACTDAMPING *CONTACTINCLUSIONS
    *COHESIVESECTION *CONTACTPAIR *CONTACTPROPERTYASSIGNMENT *DASHPOT *GAP *GASKETSECTION *MASS
    *MASSADJUST *MATRIXASSEMBLE *MATRIXINPUT *MEMBRANESECTION *NONSTRUCTURALMASS *REBAR *REBARLAYER
    *ROTARYINERTIA *SHELLGENERALSECTION *SHELLSECTION *SPRING *SURFACESECTION *USERELEMENT
    *USERSECTION
    """
)
"""Stiffness and mass of parts other than solid elements."""

INP_HARMLESS = _table(
    """*ACCELERATION *AMPLITUDE *ANISOTROPIC *ANNEAL *BASEMOTION *BOUNDARY *BOUNDARYF *BUCKLE *CFLUX
    *CLOAD *COMPLEXFREQUENCY *CONDUCTIVITY *CONTACTFILE *CONTACTOUTPUT *CONTACTPRINT *CONTROLS
    *CORRELATIONLENGTH *COUPLEDTEMPERATURE-DISPLACEMENT *CREEP *CYCLICHARDENING *CYCLICSYMMETRYMODEL
    *DAMPING *DEFORMATIONPLASTICITY *DENSITY *DEPVAR *DFLUX *DISTRIBUTION *DISTRIBUTIONTABLE *DLOAD
    *DSLOAD *DYNAMIC *ELASTIC *ELEMENTMATRIXOUTPUT *ELEMENTOUTPUT *ELFILE *ELPRINT *ENDSTEP
    *ENERGYFILE *ENERGYOUTPUT *ENERGYPRINT *EXPANSION *FIELD *FILEFORMAT *FILM *FILTER *FREQUENCY
    *FRICTION *GAPCONDUCTANCE *GLOBALDAMPING *HCF *HEADING *HEATTRANSFER *HOURGLASSSTIFFNESS
    *HYPERELASTIC *HYPERFOAM *INCIDENTWAVE *INITIALCONDITIONS *INTEGRATEDOUTPUT *MATERIAL
    *MATRIXGENERATE *MATRIXOUTPUT *MODALDAMPING *MODALDYNAMIC *MODALFILE *MODALOUTPUT *MODALPRINT
    *MONITOR *NOANALYSIS *NODALTHICKNESS *NODEFILE *NODEOUTPUT *NODEPRINT *NORMAL *ORIENTATION
    *OUTPUT *PERMEABILITY *PHYSICALCONSTANTS *PLASTIC *POTENTIAL *PREPRINT *PRINT *RADIATE
    *RANDOMRESPONSE *RATEDEPENDENT *RESPONSESPECTRUM *RESTART *RETAINEDNODALDOFS *SECTIONCONTROLS
    *SECTIONPRINT *SELECTCYCLICSYMMETRYMODES *SELECTEIGENMODES *SOLIDSECTION *SOLUTIONTECHNIQUE
    *SPECIFICHEAT *STATIC *STEADYSTATEDYNAMICS *STEP *SUBSTRUCTUREGENERATE *SUBSTRUCTUREMATRIXOUTPUT
    *SURFACEBEHAVIOR *SURFACEINTERACTION *TEMPERATURE *TIMEPOINTS *UNCOUPLEDTEMPERATURE-DISPLACEMENT
    *USERMATERIAL *USEROUTPUTVARIABLES *VIEWFACTOR *VISCO *VISCOELASTIC
    """
)
"""Materials, loads, supports, steps and output.  Elastic constants are read; nothing here changes
the mesh, and the reader does not note these names.
"""

_INP_CREATES = """
    *ASSEMBLEDFASTENER *CRACKPROPAGATION *DISPLAYBODY *ELCOPY *ENRICHMENT *ENRICHMENTACTIVATION
    *FASTENER *FLUIDSECTION *IMPORT *IMPORTELSET *IMPORTNSET *NCOPY *NMAP *PARAMETER
    *PARTICLEGENERATOR *PERIODICMEDIA *PRE-TENSIONSECTION *REFINEMESH *SUBSTRUCTUREPROPERTY *SYMMETRICMODELGENERATION
    *TRACERPARTICLE"""
_INP_MOVES = """
    *ADAPTIVEMESH *ADAPTIVEMESHCONSTRAINT *ADAPTIVEMESHREFINEMENT *ADJUST *CLEARANCE
    *CONTACTCLEARANCE *CONTACTCLEARANCEASSIGNMENT *CONTACTINITIALIZATION
    *CONTACTINITIALIZATIONASSIGNMENT *CONTACTINITIALIZATIONDATA *IMPERFECTION *MAPSOLUTION
    *MODELCHANGE"""
_INP_TIES = """
    *BOND *CONNECTORSECTION *COUPLING *CYCLICSYMMETRY *DISTRIBUTING *DISTRIBUTINGCOUPLING
    *EMBEDDEDELEMENT *EQUATION *KINEMATIC *KINEMATICCOUPLING *MPC *MULTIPOINTCONSTRAINT *NETWORKMPC
    *RIGIDBODY *SHELLTOSOLIDCOUPLING *SPOTWELD *TIE"""
INP_CHANGES = _table(_INP_CREATES + _INP_MOVES + _INP_TIES)
"""Keywords that create, move, remove or tie nodes or elements."""


CURE = (
    "remove it before the matrices are written; Sector.fixed fixes a set of nodes, forces= loads "
    "one"
)
_CURES = {
    **dict.fromkeys(
        ("*TIE", "*SHELLTOSOLIDCOUPLING"),
        "merge the meshes at the tied faces, or make each side a separate body and connect them "
        "by ContactFaces",
    ),
    **dict.fromkeys(
        ("*EQUATION", "*MPC"),
        "remove it before the matrices are written; Sector.faces ties the sector faces",
    ),
    **dict.fromkeys(
        (
            "*COUPLING",
            "*KINEMATIC",
            "*DISTRIBUTING",
            "*KINEMATICCOUPLING",
            "*DISTRIBUTINGCOUPLING",
            "*RIGIDBODY",
        ),
        CURE,
    ),
}
"""Cures for constraints between nodes, by keyword."""


class Effect(Enum):
    """Effect of a keyword of a deck."""

    MESH = "defines the mesh"
    IN_MATRICES = "adds stiffness or mass, which only the matrices contain"
    NONE = "has no effect on the mesh"
    UNKNOWN = "is passed over and noted"


def effect_on_mesh(keyword: str, parameters: Mapping[str, str], item: str) -> Effect:
    """Return the effect of a keyword of a deck.

    Parameters
    ----------
    keyword : str
        Keyword in capitals without blanks.
    parameters : mapping of name to str
    item : str
        File and line, for messages.

    Raises
    ------
    ModelError
        If the keyword could change the mesh.
    """
    if keyword in INP_READ:
        permitted = INP_READ[keyword]
        unknown = [
            f"{name}={value}".rstrip("=")
            for name, value in parameters.items()
            if name not in permitted
        ]
        expected = f"no parameters of {keyword} but {', '.join(sorted(permitted))}"
        check(not unknown, item, expected, ", ".join(unknown))
        return Effect.MESH
    # both keywords can tie or move nodes, depending on their parameters
    ties = keyword == "*CONTACTPAIR" and ("ADJUST" in parameters or "TIED" in parameters)
    cyclic = keyword == "*TIE" and "CYCLICSYMMETRY" in parameters
    if keyword in _CURES and not cyclic:
        raise mismatch(item, f"a mesh without constraints ({_CURES[keyword]})", keyword)
    if ties or (keyword in INP_CHANGES and not cyclic):
        refuse(", ".join([keyword, *parameters]), item, INP_READ)
    if cyclic or keyword in INP_HARMLESS:
        return Effect.NONE
    if keyword in INP_IN_MATRICES:
        return Effect.IN_MATRICES
    # Abaqus accepts the beginning of a keyword if no other keyword begins so
    for name in (*INP_READ, *sorted(INP_CHANGES)):
        if name.startswith(keyword):
            raise mismatch(item, "keywords in full", f"{keyword}, which may mean {name}")
    return Effect.UNKNOWN


# --------------------------------------------------------------------------------------------------
# Ansys

CDB_READ = ("NBLOCK", "EBLOCK", "CMBLOCK", "ET", "ETBLOCK", "MPDATA")

# Each release of Ansys writes further settings.  Listed are therefore the commands that act on the
# mesh.
_CDB_NODES = """
    N NGEN NMODIF NROTAT NSCALE NSYM NDELE NREAD NKPT NORA NORL NANG NAXIS FILL QUAD CENTER MOVE
    TRANSFER NUMMRG NUMCMP UPGEOM UPCOORD DAMORPH DEMORPH DVMORPH"""
_CDB_ELEMENTS = """
    E EN EMORE EGEN ENGEN ENSYM ESYM EMODIF EDELE EREAD EMID EMTGEN EINTF EORIENT ESURF AFSURF
    LFSURF NDSURF GCGEN PSMESH ENDRELEASE SHSD SWGEN SWADD SE SESYMM SETRAN BRANCH RUN BEND MITER
    TEE REDUCE VALVE FLANGE BELLOW"""
_CDB_MESHING = """
    KMESH LMESH AMESH VMESH FVMESH IMESH VSWEEP VEXT VOFFST VROTAT VDRAG KGEN LGEN AGEN VGEN KSYMM
    LSYMM ARSYM VSYMM KTRAN LTRAN ATRAN VTRAN KCLEAR LCLEAR ACLEAR VCLEAR NREFINE EREFINE KREFINE
    LREFINE AREFINE AREMESH REMESH MSHCOPY MODMSH MAP2DTO3D"""
_CDB_TIES = """
    CE CEINTF CERIG CESGEN CECYC CECMOD CEDELE CP CPINTF CPNGEN CPSGEN CPLGEN CPCYC CPMERGE CPDELE
    RBE3 PERBC2D CYCLIC EDCNSTR EDWELD"""
_CDB_FILES = "CDREAD RESUME /CLEAR /INPUT *USE *ULIB"
_CDB_SIGNIFICANT = 4  # characters of a command's name that Ansys reads
_CDB_CHANGES = frozenset(
    name[:_CDB_SIGNIFICANT]
    for group in (_CDB_NODES, _CDB_ELEMENTS, _CDB_MESHING, _CDB_TIES, _CDB_FILES)
    for name in group.split()
)


def changes_mesh(command: str) -> bool:
    """Return whether a command of Ansys makes, moves, deletes or ties nodes or elements, or reads
    another file.

    Parameters
    ----------
    command : str
        Name in capitals, in full or abbreviated.
    """
    return command[:_CDB_SIGNIFICANT] in _CDB_CHANGES


# --------------------------------------------------------------------------------------------------
# Nastran

BDF_READ = _table(
    """CHEXA CORD1C CORD1R CORD1S CORD2C CORD2R CORD2S CPENTA CTETRA DMIG GRDSET GRID MAT1
    PSOLID SET1
    """
)
BDF_TIES = _table("RBE2 RBE3 MPC")
BDF_IN_MATRICES = _table(
    """CBAR CBEAM CBEND CBUSH CBUSH1D CBUSH2D CDAMP1 CDAMP2 CDAMP3 CDAMP4 CDAMP5 CELAS1 CELAS2
    CELAS3 CELAS4 CGAP CMASS1 CMASS2 CMASS3 CMASS4 CONM1 CONM2 CONROD CPYRAM CQUAD4 CQUAD8 CQUADR
    CROD CSHEAR CTRIA3 CTRIA6 CTRIAR CTUBE CVISC NSM NSM1 NSMADD NSML NSML1
    """
)
BDF_HARMLESS = _table(
    """ACCEL ACCEL1 ASET ASET1 BSET BSET1 CREEP CSET CSET1 DAREA DELAY DLOAD DPHASE DTI EIGB EIGC
    EIGP EIGR EIGRL FORCE FORCE1 FORCE2 FREQ FREQ1 FREQ2 FREQ3 FREQ4 FREQ5 GRAV LOAD LSEQ MAT10
    MAT11 MAT2 MAT3 MAT4 MAT5 MAT8 MAT9 MATS1 MATT1 MATT2 MATT3 MATT4 MATT5 MATT8 MATT9 MDLPRM
    MOMENT MOMENT1 MOMENT2 NLPARM NLPCI OMIT OMIT1 PARAM PBAR PBARL PBEAM PBEAML PBEND PBUSH PBUSH1D
    PBUSHT PCOMP PCOMPG PDAMP PDAMP5 PDAMPT PELAS PELAST PGAP PLOAD PLOAD1 PLOAD2 PLOAD4 PLOTEL
    PMASS PROD PSHEAR PSHELL PTUBE PVISC QSET QSET1 RFORCE RFORCE1 RLOAD1 RLOAD2 SLOAD SPC SPC1
    SPCADD SPCD SPCOFF SPCOFF1 SUPORT SUPORT1 TABDMP1 TABLED1 TABLED2 TABLED3 TABLED4 TABLEM1
    TABLEM2 TABLEM3 TABLEM4 TABLES1 TABLEST TABRND1 TABRNDG TEMP TEMPD TLOAD1 TLOAD2 TSTEP TSTEPNL
    USET USET1
    """
)
"""Materials, sections, loads, supports, sets of degrees of freedom and settings of a solution."""
