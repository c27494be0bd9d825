/* bdamper._core.SectorEquations: equations of one structure from arrays; Eased: a factor on the excitation
 * as parameter; Modes: nonlinear modes.
 *
 * The binding parses, checks and copies; it contains no mathematics. */
#include "binding/binding.h"

/* ---- creation ---- */

/* Arguments of SectorEquations(), in order. */
typedef struct {
    PyObject *n_mode, *stiffness, *mass, *damping, *G, *kt, *kn, *mu, *n0, *w, *law, *shift, *force,
        *load, *row_scale, *point_law;
} sector_objects;

static int is_vector(PyObject *object, const char *name) {
    if (PyArray_Check(object) && PyArray_NDIM((PyArrayObject *)object) == 1) return 1;
    PyErr_Format(PyExc_TypeError, "%s: expected a one-dimensional numpy array", name);
    return 0;
}

/* Numbers of harmonics, modes and unknowns. */
static int read_sizes(core_arguments *arguments, PyObject *object, bd_hbm_input *in,
                      npy_intp *n_modes, npy_intp *n_unknown) {
    if (!is_vector(object, "n_mode")) return 0;
    const npy_intp n_group = PyArray_DIM((PyArrayObject *)object, 0);
    in->n_mode = core_array(arguments, object, "n_mode", NPY_INT, "intc", 1, &n_group, BD_INPUT);
    if (!in->n_mode || !core_check_n_harm(n_group - 1)) return 0;
    in->n_harm = (int)(n_group - 1);
    *n_modes = *n_unknown = 0;
    for (npy_intp l = 0; l < n_group; ++l) {
        if (in->n_mode[l] < 0 || in->n_mode[l] > 100000) {
            PyErr_Format(PyExc_ValueError, "n_mode: expected 0 to 100000 modes, found %d",
                         in->n_mode[l]);
            return 0;
        }
        *n_modes += in->n_mode[l];
        *n_unknown += (l == 0 ? 1 : 2) * in->n_mode[l];
    }
    if (*n_unknown >= 1 && *n_unknown <= 30000) return 1;
    PyErr_Format(PyExc_ValueError, "n_mode: expected 1 to 30000 unknowns, found %zd",
                 (Py_ssize_t)*n_unknown);
    return 0;
}

/* Modal matrices, forces, and modes G at the points. */
static int read_modes(core_arguments *arguments, const sector_objects *o, bd_hbm_input *in,
                      npy_intp n_modes, npy_intp n_unknown) {
    const npy_intp n_G = 3 * (npy_intp)in->n_point * n_modes;
    in->stiffness =
        core_numbers(arguments, o->stiffness, "stiffness", 1, &n_modes, BD_NON_NEGATIVE);
    if (!in->stiffness) return 0;
    in->mass = core_numbers(arguments, o->mass, "mass", 1, &n_modes, BD_NON_NEGATIVE);
    if (!in->mass) return 0;
    in->damping = core_numbers(arguments, o->damping, "damping", 1, &n_modes, BD_NON_NEGATIVE);
    if (!in->damping) return 0;
    in->force = core_numbers(arguments, o->force, "force", 1, &n_unknown, BD_FINITE);
    if (!in->force) return 0;
    in->G = core_array(arguments, o->G, "G", NPY_CDOUBLE, "complex128", 1, &n_G, BD_INPUT);
    return in->G && core_check_numbers(in->G, 2 * n_G, "G", BD_FINITE);
}

/* Parameters of the contact points. */
static int read_points(core_arguments *arguments, const sector_objects *o, bd_hbm_input *in) {
    const npy_intp n_point = in->n_point, by2[2] = {n_point, 2}, by3[2] = {n_point, 3};
    if (!(in->kt = core_numbers(arguments, o->kt, "kt", 2, by2, BD_FINITE))) return 0;
    if (!(in->kn = core_numbers(arguments, o->kn, "kn", 1, &n_point, BD_NON_NEGATIVE))) return 0;
    if (!(in->mu = core_numbers(arguments, o->mu, "mu", 1, &n_point, BD_NON_NEGATIVE))) return 0;
    if (!(in->n0 = core_numbers(arguments, o->n0, "n0", 1, &n_point, BD_FINITE))) return 0;
    if (!(in->w = core_doubles(arguments, o->w, "w", 2, by2, BD_INPUT))) return 0;
    in->law = core_array(arguments, o->law, "law", NPY_INT, "intc", 1, &n_point, BD_INPUT);
    if (!in->law) return 0;
    int has_cubic = 0;
    for (npy_intp p = 0; p < n_point; ++p) {
        /* the exact evaluation refuses user laws */
        const int is_user_law = in->law[p] == BD_LAW_USER && in->evaluation != BD_EXACT;
        if (!is_user_law && !core_check_law(in->law[p], in->evaluation)) return 0;
        if (!core_check_slider(in->w + 2 * p, in->law[p])) return 0;
        has_cubic |= in->law[p] == BD_LAW_CUBIC;
    }
    /* cubic springs may be softening */
    if (!has_cubic && !core_check_numbers(in->kt, 2 * n_point, "kt", BD_NON_NEGATIVE)) return 0;
    if (o->load != Py_None) {
        in->load = core_numbers(arguments, o->load, "load", 1, &n_point, BD_FINITE);
        if (!in->load) return 0;
    }
    in->shift = core_numbers(arguments, o->shift, "shift", 2, by3, BD_FINITE);
    return in->shift != NULL;
}

/* Read all arguments of SectorEquations(). */
static int read_input(const sector_objects *o, int evaluation, bd_hbm_input *in,
                      const double **row_scale, bd_point_law **point_law) {
    core_arguments arguments = {0};
    npy_intp n_modes, n_unknown;
    if (!read_sizes(&arguments, o->n_mode, in, &n_modes, &n_unknown)) return 0;
    if (!is_vector(o->kn, "kn")) return 0;
    const npy_intp n_point = PyArray_DIM((PyArrayObject *)o->kn, 0);
    if (n_point > 10000000) {
        PyErr_Format(PyExc_ValueError, "kn: expected at most 10000000 points, found %zd",
                     (Py_ssize_t)n_point);
        return 0;
    }
    in->n_point = (int)n_point;
    if (!core_point_laws(o->point_law, n_point, point_law)) return 0;
    in->point_law = *point_law;
    if (!core_check_evaluation(evaluation, in->n_time, in->n_harm)) return 0;
    in->evaluation = (bd_evaluation)evaluation;
    if (!read_modes(&arguments, o, in, n_modes, n_unknown)) return 0;
    if (!read_points(&arguments, o, in)) return 0;
    if (!core_check_point_laws(in->law, in->point_law, n_point)) return 0;
    if (o->row_scale == Py_None) return 1;
    *row_scale = core_numbers(&arguments, o->row_scale, "row_scale", 1, &n_unknown, BD_POSITIVE);
    return *row_scale != NULL;
}

/* Nodes of a speed family: other Sectors, their squared speeds, and the engine order. */
typedef struct {
    PyObject *nodes, *squares;
    double order;
} family_objects;

/* Make a speed family of a sector if nodes are given. Return 0 with an exception. */
static int make_family(core_equations *self, const bd_hbm_input *in, const family_objects *o) {
    if (o->nodes == Py_None) {
        if (o->squares == Py_None && o->order == 0.0) return 1;
        PyErr_SetString(PyExc_ValueError, "squares, order: expected none without nodes");
        return 0;
    }
    int are_sectors = PyTuple_Check(o->nodes) && PyTuple_GET_SIZE(o->nodes) >= 2;
    for (npy_intp i = 0; are_sectors && i < PyTuple_GET_SIZE(o->nodes); ++i)
        are_sectors = Py_TYPE(PyTuple_GET_ITEM(o->nodes, i)) == Py_TYPE(self);
    if (!are_sectors) {
        PyErr_SetString(PyExc_TypeError, "nodes: expected a tuple of two or more Sectors");
        return 0;
    }
    core_arguments arguments = {0};
    const npy_intp n = PyTuple_GET_SIZE(o->nodes);
    const double *squares = core_numbers(&arguments, o->squares, "squares", 1, &n, BD_POSITIVE);
    if (!squares || !core_check_number(o->order, "order", BD_POSITIVE)) return 0;
    const bd_hbm **node = PyMem_Malloc(sizeof *node * (size_t)n);
    if (!node) {
        PyErr_NoMemory();
        return 0;
    }
    for (npy_intp i = 0; i < n; ++i)
        node[i] = ((core_equations *)PyTuple_GET_ITEM(o->nodes, i))->hbm;
    const bd_status status = bd_family_create(self->hbm, in, (int)n, node, squares, o->order);
    PyMem_Free((void *)node);
    if (status == BD_BAD_ARGUMENT)
        PyErr_SetString(
            PyExc_ValueError,
            "nodes: expected Sectors of the same sizes and contact laws, with finite sliders, "
            "at different speeds");
    else if (status != BD_OK)
        core_check_status(status);
    return status == BD_OK;
}

static PyObject *Sector_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"n_mode", "stiffness",  "mass",   "damping",     "G",     "kt",
                            "kn",     "mu",         "n0",     "w",           "law",   "shift",
                            "force",  "evaluation", "n_time", "load",        "nodes", "squares",
                            "order",  "row_scale",  "own",    "elimination", NULL};
    sector_objects o = {.load = Py_None, .row_scale = Py_None, .point_law = Py_None};
    family_objects family = {.nodes = Py_None, .squares = Py_None};
    bd_hbm_input in = {0};
    int evaluation = BD_EXACT, elimination = BD_BY_SIZE;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOOOOOOOOO|iiOOOdOOi:SectorEquations", names,
                                     &o.n_mode, &o.stiffness, &o.mass, &o.damping, &o.G, &o.kt,
                                     &o.kn, &o.mu, &o.n0, &o.w, &o.law, &o.shift, &o.force,
                                     &evaluation, &in.n_time, &o.load, &family.nodes,
                                     &family.squares, &family.order, &o.row_scale, &o.point_law,
                                     &elimination))
        return NULL;
    const double *row_scale = NULL;
    bd_point_law *point_law = NULL;
    core_equations *self = NULL;
    if (elimination < BD_BY_SIZE || elimination > BD_CONDENSED) {
        PyErr_Format(PyExc_ValueError, "elimination: expected 0, 1 or 2, found %d", elimination);
        return NULL;
    }
    if (!core_check_kernel() || !read_input(&o, evaluation, &in, &row_scale, &point_law)) goto done;
    const core_state *state = PyType_GetModuleState(type);
    bd_sector *sector;
    if (!(self = core_equations_new(type, NULL))) goto done;
    /* the modes of a family change with the parameter */
    if (family.nodes != Py_None) elimination = BD_FULL;
    if (!core_check_status(bd_sector_create(&sector, &in, row_scale, &state->lapack,
                                            (bd_elimination)elimination))) {
        Py_CLEAR(self);
        goto done;
    }
    self->equations = &sector->dense.base;
    self->hbm = &sector->hbm;
    self->point_law = Py_NewRef(o.point_law);
    if (!make_family(self, &in, &family)) Py_CLEAR(self);
done:
    PyMem_Free(point_law);
    return (PyObject *)self;
}

static PyType_Slot Sector_slots[] = {
    {Py_tp_new, Sector_new},
    {Py_tp_dealloc, core_equations_dealloc},
    {Py_tp_methods, core_equations_methods},
    {Py_tp_getset, core_equations_getset},
    {Py_tp_doc,
     "Harmonic balance equations of one structure from arrays; the parameter is omega.\n\n"
     "With nodes, squares and order, all arrays are polynomials of the squared speed "
     "(omega/order)^2. nodes is "
     "a tuple of Sectors of equal sizes, squares are their squared speeds, and order is an engine "
     "order. "
     "Derivatives with respect to omega are then taken along the engine order line.\n\n"
     "elimination is 1 for factors of the full Jacobian, 2 for factors condensed to the motion at "
     "the contact points, 0 for a choice by size."},
    {0, NULL}};

PyType_Spec core_sector_spec = {.name = "bdamper._core.SectorEquations",
                                .basicsize = sizeof(core_equations),
                                .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
                                .slots = Sector_slots};

/* ---- factor on the excitation ---- */

static PyObject *Eased_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"sector", "omega", "ramp", "support", NULL};
    PyObject *sector, *ramp_object, *support_object = Py_None;
    double omega, *ramp, *support = NULL;
    core_state *state = PyType_GetModuleState(type);
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!dO|O:Eased", names, state->sector, &sector,
                                     &omega, &ramp_object, &support_object))
        return NULL;
    core_arguments arguments = {0};
    core_equations *inner = (core_equations *)sector;
    const npy_intp n = inner->equations->n, square[2] = {n, n};
    if (!core_check_number(omega, "omega", BD_FINITE)) return NULL;
    if (!(ramp = core_numbers(&arguments, ramp_object, "ramp", 1, &n, BD_FINITE))) return NULL;
    if (support_object != Py_None &&
        !(support = core_numbers(&arguments, support_object, "support", 2, square, BD_FINITE)))
        return NULL;
    core_equations *self = core_equations_new(type, inner);
    if (!self) return NULL;
    if (!core_check_status(bd_eased_create(&self->equations, (bd_sector *)inner->equations, omega,
                                           ramp, support))) {
        Py_DECREF(self);
        return NULL;
    }
    self->hbm = inner->hbm;
    return (PyObject *)self;
}

static PyType_Slot Eased_slots[] = {{Py_tp_new, Eased_new},
                                    {Py_tp_dealloc, core_equations_dealloc},
                                    {Py_tp_methods, core_equations_methods},
                                    {Py_tp_getset, core_equations_getset},
                                    {Py_tp_doc,
                                     "Equations of a sector at fixed omega; the parameter is a "
                                     "factor on the part ramp (n_unknown) of the "
                                     "excitation.\n\n"
                                     "The factor also fades out the linear force support "
                                     "(n_unknown, n_unknown), unless None. Lock and cost are "
                                     "shared with the sector."},
                                    {0, NULL}};

PyType_Spec core_eased_spec = {.name = "bdamper._core.Eased",
                               .basicsize = sizeof(core_equations),
                               .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
                               .slots = Eased_slots};

/* ---- nonlinear modes ---- */

static PyObject *Modes_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"sector", "re", "im", "weight", "row_scale", NULL};
    PyObject *sector, *object[2], *scale_object = Py_None;
    double weight, *row[2], *row_scale = NULL;
    core_state *state = PyType_GetModuleState(type);
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!OOd|O:Modes", names, state->sector, &sector,
                                     &object[0], &object[1], &weight, &scale_object))
        return NULL;
    core_arguments arguments = {0};
    core_equations *inner = (core_equations *)sector;
    const npy_intp n = inner->equations->n, n2 = n + 2;
    if (inner->hbm->variation) {
        PyErr_SetString(PyExc_ValueError,
                        "sector: expected a sector at fixed speed, found a speed family");
        return NULL;
    }
    if (!core_check_number(weight, "weight", BD_POSITIVE)) return NULL;
    for (int i = 0; i < 2; ++i)
        if (!(row[i] = core_numbers(&arguments, object[i], names[1 + i], 1, &n, BD_FINITE)))
            return NULL;
    if (scale_object != Py_None &&
        !(row_scale = core_numbers(&arguments, scale_object, "row_scale", 1, &n2, BD_POSITIVE)))
        return NULL;
    core_equations *self = core_equations_new(type, inner);
    if (!self) return NULL;
    if (!core_check_status(bd_modes_create(&self->equations, (bd_sector *)inner->equations, row[0],
                                           row[1], weight, row_scale))) {
        Py_DECREF(self);
        return NULL;
    }
    self->hbm = inner->hbm;
    return (PyObject *)self;
}

static PyType_Slot Modes_slots[] = {{Py_tp_new, Modes_new},
                                    {Py_tp_dealloc, core_equations_dealloc},
                                    {Py_tp_methods, core_equations_methods},
                                    {Py_tp_getset, core_equations_getset},
                                    {Py_tp_doc,
                                     "Nonlinear modes of a sector without its excitation; the "
                                     "parameter is ln a, with the amplitude a.\n\n"
                                     "Unknowns are the unknowns of the sector, with the vibration "
                                     "divided by a, then omega and zeta. re and im "
                                     "(n_unknown of the sector) define the motion with the "
                                     "amplitude a. weight scales the two equations of this "
                                     "definition. Lock and cost are shared with the sector."},
                                    {0, NULL}};

PyType_Spec core_modes_spec = {.name = "bdamper._core.Modes",
                               .basicsize = sizeof(core_equations),
                               .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
                               .slots = Modes_slots};
