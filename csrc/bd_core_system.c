/* bdamper._core.System: the equations of one structure, built once from arrays.
 *
 * Bindings parse, check and copy; they hold no mathematics.  Work is done without the GIL, under the lock of the System
 * that owns the workspace; what a call finds is copied out before the lock is given back, so that nothing depends on which
 * call came last.  Failure to converge is a returned status; only wrong arguments and lack of memory are exceptions. */
#include "bd_clock.h"
#include "bd_core.h"

#include <pythread.h>
#include <string.h>

typedef struct {
    PyObject_HEAD bd_hbm hbm;
    bd_newton_work newton;
    PyThread_type_lock lock;
} SystemObject;

/* ---- lock and clock ---- */

/* Begins work, without the GIL; returns the processor time. */
static double begin_work(SystemObject *self) {
    PyThread_acquire_lock(self->lock, WAIT_LOCK);
    return bd_processor_seconds();
}

static void end_work(SystemObject *self, double started) {
    self->hbm.cost.processor += bd_processor_seconds() - started;
    PyThread_release_lock(self->lock);
}

/* ---- creation ---- */

static void System_dealloc(SystemObject *self) {
    PyTypeObject *type = Py_TYPE(self);
    if (self->hbm.n_mode) bd_hbm_destroy(&self->hbm);
    bd_newton_destroy(&self->newton);
    if (self->lock) PyThread_free_lock(self->lock);
    type->tp_free((PyObject *)self);
    Py_DECREF(type);
}

/* The arguments of System(), in their order. */
typedef struct {
    PyObject *n_mode, *stiffness, *mass, *damping, *G, *kt, *kn, *mu, *n0, *w, *law, *shift, *force, *load;
} system_objects;

static int is_vector(PyObject *object, const char *name) {
    if (PyArray_Check(object) && PyArray_NDIM((PyArrayObject *)object) == 1) return 1;
    PyErr_Format(PyExc_TypeError, "%s: expected a one-dimensional numpy array", name);
    return 0;
}

/* Numbers of harmonics, modes and unknowns. */
static int read_sizes(core_arguments *arguments, PyObject *object, bd_hbm_input *in, npy_intp *n_modes,
                      npy_intp *n_unknown) {
    if (!is_vector(object, "n_mode")) return 0;
    const npy_intp n_group = PyArray_DIM((PyArrayObject *)object, 0);
    in->n_mode = core_array(arguments, object, "n_mode", NPY_INT, "intc", 1, &n_group, BD_INPUT);
    if (!in->n_mode || !core_check_n_harm(n_group - 1)) return 0;
    in->n_harm = (int)(n_group - 1);
    *n_modes = *n_unknown = 0;
    for (npy_intp l = 0; l < n_group; ++l) {
        if (in->n_mode[l] < 0 || in->n_mode[l] > 100000) {
            PyErr_Format(PyExc_ValueError, "n_mode: expected 0 to 100000 modes, found %d", in->n_mode[l]);
            return 0;
        }
        *n_modes += in->n_mode[l];
        *n_unknown += (l == 0 ? 1 : 2) * in->n_mode[l];
    }
    if (*n_unknown >= 1 && *n_unknown <= 30000) return 1;
    PyErr_Format(PyExc_ValueError, "n_mode: expected 1 to 30000 unknowns, found %zd", (Py_ssize_t)*n_unknown);
    return 0;
}

static int read_modes(core_arguments *arguments, const system_objects *o, bd_hbm_input *in, npy_intp n_modes,
                      npy_intp n_unknown) {
    const npy_intp n_G = 3 * (npy_intp)in->n_point * n_modes;
    in->stiffness = core_numbers(arguments, o->stiffness, "stiffness", 1, &n_modes, BD_NON_NEGATIVE);
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

static int read_points(core_arguments *arguments, const system_objects *o, bd_hbm_input *in) {
    const npy_intp n_point = in->n_point, by2[2] = {n_point, 2}, by3[2] = {n_point, 3};
    if (!(in->kt = core_numbers(arguments, o->kt, "kt", 2, by2, BD_FINITE))) return 0;
    if (!(in->kn = core_numbers(arguments, o->kn, "kn", 1, &n_point, BD_NON_NEGATIVE))) return 0;
    if (!(in->mu = core_numbers(arguments, o->mu, "mu", 1, &n_point, BD_NON_NEGATIVE))) return 0;
    if (!(in->n0 = core_numbers(arguments, o->n0, "n0", 1, &n_point, BD_FINITE))) return 0;
    if (!(in->w = core_doubles(arguments, o->w, "w", 2, by2, BD_INPUT))) return 0;
    if (!(in->law = core_array(arguments, o->law, "law", NPY_INT, "intc", 1, &n_point, BD_INPUT))) return 0;
    int softening = 0; /* cubic springs may soften */
    for (npy_intp p = 0; p < n_point; ++p) {
        if (!core_check_law(in->law[p], in->evaluation) || !core_check_slider(in->w + 2 * p, in->law[p])) return 0;
        softening |= in->law[p] == BD_LAW_CUBIC;
    }
    if (!softening && !core_check_numbers(in->kt, 2 * n_point, "kt", BD_NON_NEGATIVE)) return 0;
    if (o->load != Py_None && !(in->load = core_numbers(arguments, o->load, "load", 1, &n_point, BD_FINITE))) return 0;
    return (in->shift = core_numbers(arguments, o->shift, "shift", 2, by3, BD_FINITE)) != NULL;
}

static int read_input(const system_objects *o, int evaluation, bd_hbm_input *in) {
    core_arguments arguments = {0};
    npy_intp n_modes, n_unknown;
    if (!read_sizes(&arguments, o->n_mode, in, &n_modes, &n_unknown) || !is_vector(o->kn, "kn")) return 0;
    const npy_intp n_point = PyArray_DIM((PyArrayObject *)o->kn, 0);
    if (n_point > 10000000) {
        PyErr_Format(PyExc_ValueError, "kn: expected at most 10000000 points, found %zd", (Py_ssize_t)n_point);
        return 0;
    }
    in->n_point = (int)n_point;
    if (!core_check_evaluation(evaluation, in->n_time, in->n_harm)) return 0;
    in->evaluation = (bd_evaluation)evaluation;
    return read_modes(&arguments, o, in, n_modes, n_unknown) && read_points(&arguments, o, in);
}

/* The equations as a family over speed: other Systems, the squares of their speeds, and the engine order. */
typedef struct {
    PyObject *nodes, *squares;
    double order;
} family_objects;

static int make_family(SystemObject *self, const bd_hbm_input *in, const family_objects *o) {
    if (o->nodes == Py_None) return 1;
    if (!PyTuple_Check(o->nodes) || PyTuple_GET_SIZE(o->nodes) < 2) {
        PyErr_SetString(PyExc_TypeError, "nodes: expected a tuple of two or more Systems");
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
    bd_status status = BD_OK;
    for (npy_intp i = 0; i < n && status == BD_OK; ++i) {
        PyObject *item = PyTuple_GET_ITEM(o->nodes, i);
        if (Py_TYPE(item) != Py_TYPE(self)) status = BD_BAD_ARGUMENT;
        node[i] = &((SystemObject *)item)->hbm;
    }
    if (status == BD_OK) status = bd_family_create(&self->hbm, in, (int)n, node, squares, o->order);
    PyMem_Free((void *)node);
    if (status == BD_BAD_ARGUMENT)
        PyErr_SetString(PyExc_ValueError,
                        "nodes: expected Systems of the same sizes and contact laws, with finite sliders, "
                        "at speeds of which no two are the same");
    else if (status != BD_OK)
        core_check_status(status);
    return status == BD_OK;
}

static PyObject *System_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"n_mode", "stiffness", "mass",  "damping", "G",     "kt",    "kn",
                            "mu",     "n0",        "w",     "law",     "shift", "force", "evaluation",
                            "n_time", "load",      "nodes", "squares", "order", NULL};
    system_objects o = {.load = Py_None};
    family_objects family = {.nodes = Py_None, .squares = Py_None};
    bd_hbm_input in = {0};
    int evaluation = BD_EXACT;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOOOOOOOOO|iiOOOd:System", names, &o.n_mode, &o.stiffness, &o.mass,
                                     &o.damping, &o.G, &o.kt, &o.kn, &o.mu, &o.n0, &o.w, &o.law, &o.shift, &o.force,
                                     &evaluation, &in.n_time, &o.load, &family.nodes, &family.squares, &family.order))
        return NULL;
    if (!core_check_kernel() || !read_input(&o, evaluation, &in)) return NULL;
    const core_state *state = PyType_GetModuleState(type);
    SystemObject *self = (SystemObject *)type->tp_alloc(type, 0);
    if (!self) return NULL;
    self->lock = PyThread_allocate_lock();
    if (!self->lock || !core_check_status(bd_hbm_create(&self->hbm, &in)) ||
        !core_check_status(bd_newton_create(&self->newton, self->hbm.n_unknown, &state->lapack)) ||
        !make_family(self, &in, &family)) {
        if (!PyErr_Occurred()) PyErr_NoMemory();
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

/* ---- results with names ---- */

static PyStructSequence_Field counts_fields[] = {{"contact", "Seconds of wall-clock time in contact forces."},
                                                 {"assembly", "Seconds in modal sums and products."},
                                                 {"algebra", "Seconds in linear algebra."},
                                                 {"processor", "Processor seconds of all calls."},
                                                 {"evaluations", "Residuals, with or without Jacobian."},
                                                 {"jacobians", "Jacobians."},
                                                 {"factorisations", "Factorisations of the bordered matrix."},
                                                 {"least_norm", "Solutions by least norm."},
                                                 {NULL, NULL}};
static PyStructSequence_Desc counts_description = {"bdamper._core.Counts", "What a System has cost since it was made.",
                                                   counts_fields, 8};

static PyStructSequence_Field corrected_fields[] = {
    {"status", "0: converged."},
    {"iterations", NULL},
    {"residual", "Largest scaled residual at the returned point."},
    {"first_step", "Length of the first Newton step, in scaled unknowns."},
    {"last_step", "Length of the last one."},
    {"condition", "Reciprocal condition of the last bordered matrix."},
    {"rank", "Its rank, n_unknown + 1 where it is regular."},
    {"shares", "Shares of the cycle that stick, slip and are open at the returned point, mean of the points with friction; "
               "NaN where it could not be evaluated."},
    {"orientation", "Sign of the determinant of the last bordered matrix, 0 if it is not known."},
    {NULL, NULL}};
static PyStructSequence_Desc corrected_description = {"bdamper._core.Corrected", "Outcome of one Newton corrector.",
                                                      corrected_fields, 9};

static PyStructSequence_Field peak_fields[] = {{"status", "0: converged."},
                                               {"iterations", NULL},
                                               {"residual", "Largest scaled residual at the returned point."},
                                               {"slope", "Derivative of ln(amplitude) along the curve there."},
                                               {"curvature", "Its derivative, as the last secant gives it."},
                                               {"rank", "Rank of the last bordered matrix."},
                                               {"shares", "As those of a corrector."},
                                               {NULL, NULL}};
static PyStructSequence_Desc peak_description = {"bdamper._core.Peak", "Outcome of one search of a peak.", peak_fields, 7};

static PyTypeObject *add_result(PyObject *module, PyStructSequence_Desc *description) {
    PyTypeObject *type = PyStructSequence_NewType(description);
    if (!type || PyModule_AddType(module, type) == 0) return type;
    Py_DECREF(type);
    return NULL;
}

int core_add_results(PyObject *module, core_state *state) {
    state->counts = add_result(module, &counts_description);
    state->corrected = add_result(module, &corrected_description);
    state->peak = add_result(module, &peak_description);
    return state->counts && state->corrected && state->peak ? 0 : -1;
}

/* A struct sequence from a tuple (taken over) of its fields. */
static PyObject *named(PyTypeObject *type, PyObject *tuple) {
    PyObject *result = tuple ? PyStructSequence_New(type) : NULL;
    for (Py_ssize_t i = 0; result && i < PyTuple_GET_SIZE(tuple); ++i)
        PyStructSequence_SetItem(result, i, Py_NewRef(PyTuple_GET_ITEM(tuple, i)));
    Py_XDECREF(tuple);
    return result;
}

/* Stick, slip and open, averaged over the points with friction at the evaluation that the caller has just made. */
static void mean_shares(const bd_hbm *hbm, double *mean) {
    int n = 0;
    mean[0] = mean[1] = mean[2] = 0.0;
    for (int p = 0; p < hbm->n_point; ++p) {
        const bd_law law = hbm->element[p].law;
        if (law == BD_LAW_NORMAL || (hbm->element[p].mu == 0.0 && law != BD_LAW_BONDED)) continue;
        const bd_status_share s = hbm->share[p];
        mean[0] += 0.5 * (s.stick[0] + s.stick[1]);
        mean[1] += 0.5 * (s.slip[0] + s.slip[1]);
        mean[2] += s.open;
        ++n;
    }
    for (int i = 0; n > 0 && i < 3; ++i) mean[i] /= n;
}

/* ---- methods ---- */

static PyObject *System_evaluate(SystemObject *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"u", "omega", "r", "J", "r_omega", NULL};
    PyObject *u_object, *r_object, *J_object = Py_None, *d_object = Py_None;
    double omega;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OdO|OO:evaluate", names, &u_object, &omega, &r_object, &J_object,
                                     &d_object))
        return NULL;
    core_arguments arguments = {0};
    const npy_intp n = self->hbm.n_unknown, square[2] = {n, n};
    double *u, *r, *J = NULL, *d = NULL;
    if (!(u = core_vector(&arguments, u_object, "u", n, BD_INPUT))) return NULL;
    if (!(r = core_vector(&arguments, r_object, "r", n, BD_OUTPUT))) return NULL;
    if (J_object != Py_None && !(J = core_doubles(&arguments, J_object, "J", 2, square, BD_OUTPUT))) return NULL;
    if (d_object != Py_None && !(d = core_vector(&arguments, d_object, "r_omega", n, BD_OUTPUT))) return NULL;
    bd_status status;
    Py_BEGIN_ALLOW_THREADS;
    const double started = begin_work(self);
    status = bd_hbm_evaluate(&self->hbm, u, omega, r, J, d);
    end_work(self, started);
    Py_END_ALLOW_THREADS;
    return PyLong_FromLong(status);
}

static int check_iterations(const bd_newton_options *options) {
    if (options->max_iterations < 0) {
        PyErr_Format(PyExc_ValueError, "max_iterations: expected at least 0, found %d", options->max_iterations);
        return 0;
    }
    return core_check_number(options->tolerance, "tolerance", BD_POSITIVE) &&
           core_check_number(options->rank_tolerance, "rank_tolerance", BD_NON_NEGATIVE) &&
           core_check_number(options->reach, "reach", BD_NON_NEGATIVE);
}

/* The excitation as parameter: ramp and omega together, and a support only beside them. */
static int read_ramp(core_arguments *arguments, PyObject *ramp, PyObject *omega, PyObject *support, npy_intp n,
                     bd_newton_options *options) {
    const npy_intp square[2] = {n, n};
    if (ramp == Py_None && (omega != Py_None || support != Py_None)) {
        PyErr_Format(PyExc_ValueError, "%s: expected beside ramp only, without which it has no effect",
                     support != Py_None ? "support" : "omega");
        return 0;
    }
    if (ramp == Py_None) return 1;
    if (!(options->ramp = core_numbers(arguments, ramp, "ramp", 1, &n, BD_FINITE))) return 0;
    if (omega == Py_None) {
        PyErr_SetString(PyExc_ValueError, "omega: expected a number beside ramp, found None");
        return 0;
    }
    options->omega = PyFloat_AsDouble(omega);
    if (options->omega == -1.0 && PyErr_Occurred()) return 0;
    if (support == Py_None) return 1;
    return (options->support = core_numbers(arguments, support, "support", 2, square, BD_FINITE)) != NULL;
}

static PyObject *System_correct(SystemObject *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"y",         "normal",         "scale",       "row_scale",  "tangent",
                            "tolerance", "max_iterations", "line_search", "least_norm", "rank_tolerance",
                            "ramp",      "omega",          "support",     "reach",      NULL};
    PyObject *object[5], *ramp = Py_None, *omega = Py_None, *support = Py_None;
    bd_newton_options options = {.least_norm = 1, .rank_tolerance = 1e-14};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOdi|ppdOOOd:correct", names, &object[0], &object[1], &object[2],
                                     &object[3], &object[4], &options.tolerance, &options.max_iterations,
                                     &options.line_search, &options.least_norm, &options.rank_tolerance, &ramp, &omega,
                                     &support, &options.reach))
        return NULL;
    core_arguments arguments = {0};
    const npy_intp n = self->hbm.n_unknown, n1 = n + 1;
    double *y, *normal, *scale, *row_scale, *tangent;
    if (!(y = core_vector(&arguments, object[0], "y", n1, BD_OUTPUT))) return NULL;
    if (!(normal = core_numbers(&arguments, object[1], "normal", 1, &n1, BD_FINITE))) return NULL;
    if (!(scale = core_numbers(&arguments, object[2], "scale", 1, &n1, BD_POSITIVE))) return NULL;
    if (!(row_scale = core_numbers(&arguments, object[3], "row_scale", 1, &n, BD_POSITIVE))) return NULL;
    if (!(tangent = core_vector(&arguments, object[4], "tangent", n1, BD_OUTPUT))) return NULL;
    if (!check_iterations(&options) || !read_ramp(&arguments, ramp, omega, support, n, &options)) return NULL;
    bd_newton_report report;
    bd_status status;
    double mean[3];
    Py_BEGIN_ALLOW_THREADS;
    const double started = begin_work(self);
    status = bd_newton_correct(&self->hbm, &self->newton, &options, y, normal, scale, row_scale, tangent, &report);
    mean_shares(&self->hbm, mean);
    end_work(self, started);
    Py_END_ALLOW_THREADS;
    const core_state *state = PyType_GetModuleState(Py_TYPE(self));
    return named(state->corrected, Py_BuildValue("iiddddi(ddd)i", (int)status, report.iterations, report.residual,
                                                 report.first_step, report.last_step, report.condition, report.rank,
                                                 mean[0], mean[1], mean[2], report.orientation));
}

static int check_peak(const bd_newton_peak_options *peak) {
    return core_check_number(peak->curvature, "curvature", BD_NEGATIVE) &&
           core_check_number(peak->tolerance, "place_tolerance", BD_POSITIVE) &&
           core_check_number(peak->max_step, "max_step", BD_POSITIVE);
}

static PyObject *System_peak(SystemObject *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"y",         "tangent",        "scale",     "row_scale",       "re",       "im",
                            "tolerance", "max_iterations", "curvature", "place_tolerance", "max_step", NULL};
    PyObject *object[6];
    bd_newton_options options = {.least_norm = 1, .rank_tolerance = 1e-14};
    bd_newton_peak_options peak = {0};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOOdiddd:peak", names, &object[0], &object[1], &object[2],
                                     &object[3], &object[4], &object[5], &options.tolerance, &options.max_iterations,
                                     &peak.curvature, &peak.tolerance, &peak.max_step))
        return NULL;
    core_arguments arguments = {0};
    const npy_intp n = self->hbm.n_unknown, n1 = n + 1;
    double *y, *tangent, *scale, *row_scale;
    if (!(y = core_vector(&arguments, object[0], "y", n1, BD_OUTPUT))) return NULL;
    if (!(tangent = core_vector(&arguments, object[1], "tangent", n1, BD_OUTPUT))) return NULL;
    if (!core_check_numbers(tangent, n1, "tangent", BD_FINITE)) return NULL;
    if (!(scale = core_numbers(&arguments, object[2], "scale", 1, &n1, BD_POSITIVE))) return NULL;
    if (!(row_scale = core_numbers(&arguments, object[3], "row_scale", 1, &n, BD_POSITIVE))) return NULL;
    if (!(peak.re = core_numbers(&arguments, object[4], "re", 1, &n, BD_FINITE))) return NULL;
    if (!(peak.im = core_numbers(&arguments, object[5], "im", 1, &n, BD_FINITE))) return NULL;
    if (!check_iterations(&options) || !check_peak(&peak)) return NULL;
    bd_newton_report report;
    bd_status status;
    double mean[3];
    Py_BEGIN_ALLOW_THREADS;
    const double started = begin_work(self);
    status = bd_newton_peak(&self->hbm, &self->newton, &options, &peak, y, tangent, scale, row_scale, &report);
    mean_shares(&self->hbm, mean);
    end_work(self, started);
    Py_END_ALLOW_THREADS;
    const core_state *state = PyType_GetModuleState(Py_TYPE(self));
    return named(state->peak, Py_BuildValue("iidddi(ddd)", (int)status, report.iterations, report.residual, peak.slope,
                                            peak.curvature, report.rank, mean[0], mean[1], mean[2]));
}

static void copy_shares(const bd_hbm *hbm, double *share) {
    for (int p = 0; p < hbm->n_point; ++p) {
        const bd_status_share s = hbm->share[p];
        const double row[5] = {s.stick[0], s.slip[0], s.stick[1], s.slip[1], s.open};
        memcpy(share + 5 * (size_t)p, row, sizeof row);
    }
}

/* Motion, force and state shares of all points at u. */
static PyObject *System_contact(SystemObject *self, PyObject *args) {
    PyObject *object[4];
    double omega = 0.0;
    if (!PyArg_ParseTuple(args, "OOOO|d:contact", &object[0], &object[1], &object[2], &object[3], &omega)) return NULL;
    core_arguments arguments = {0};
    const npy_intp n = self->hbm.n_unknown, n_point = self->hbm.n_point;
    const npy_intp full[3] = {n_point, 3, self->hbm.n_coef}, by5[2] = {n_point, 5};
    double *u, *X, *F, *share;
    if (!(u = core_vector(&arguments, object[0], "u", n, BD_INPUT))) return NULL;
    if (!(X = core_doubles(&arguments, object[1], "X", 3, full, BD_OUTPUT))) return NULL;
    if (!(F = core_doubles(&arguments, object[2], "F", 3, full, BD_OUTPUT))) return NULL;
    if (!(share = core_doubles(&arguments, object[3], "share", 2, by5, BD_OUTPUT))) return NULL;
    double *r = PyMem_Malloc(sizeof(double) * (size_t)n);
    if (!r) return PyErr_NoMemory();
    bd_status status;
    Py_BEGIN_ALLOW_THREADS;
    const double started = begin_work(self);
    status = bd_hbm_evaluate(&self->hbm, u, omega, r, NULL, NULL);
    const size_t size = sizeof(double) * (size_t)(3 * n_point * self->hbm.n_coef);
    memcpy(X, self->hbm.X, size);
    memcpy(F, self->hbm.F, size);
    copy_shares(&self->hbm, share);
    end_work(self, started);
    Py_END_ALLOW_THREADS;
    PyMem_Free(r);
    return PyLong_FromLong(status);
}

static PyObject *System_get_cost(SystemObject *self, void *closure) {
    (void)closure;
    bd_cost c;
    Py_BEGIN_ALLOW_THREADS;
    PyThread_acquire_lock(self->lock, WAIT_LOCK);
    c = self->hbm.cost;
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS;
    const core_state *state = PyType_GetModuleState(Py_TYPE(self));
    return named(state->counts, Py_BuildValue("ddddllll", c.contact, c.assembly, c.algebra, c.processor, c.n_evaluation,
                                              c.n_jacobian, c.n_factorisation, c.n_least_norm));
}

static PyObject *System_get_n_unknown(SystemObject *self, void *closure) {
    (void)closure;
    return PyLong_FromLong(self->hbm.n_unknown);
}

static PyMethodDef System_methods[] = {
    {"evaluate", (PyCFunction)(void (*)(void))System_evaluate, METH_VARARGS | METH_KEYWORDS,
     "evaluate(u, omega, r, J=None, r_omega=None) -> int\n\nFill residual, Jacobian and frequency derivative; "
     "return the status."},
    {"correct", (PyCFunction)(void (*)(void))System_correct, METH_VARARGS | METH_KEYWORDS,
     "correct(y, normal, scale, row_scale, tangent, tolerance, max_iterations, line_search=False, least_norm=True, "
     "rank_tolerance=1e-14, ramp=None, omega=None, support=None, reach=0.0) -> Corrected\n\n"
     "Newton corrector of one continuation step; y and tangent are changed in place.  The last entry of y is omega, or, "
     "with ramp (n_unknown), a factor on that part of the excitation at the given omega, which also fades out the linear "
     "force support (n_unknown, n_unknown).  A Newton step longer than reach ends the correction, if that is not 0."},
    {"peak", (PyCFunction)(void (*)(void))System_peak, METH_VARARGS | METH_KEYWORDS,
     "peak(y, tangent, scale, row_scale, re, im, tolerance, max_iterations, curvature, place_tolerance, max_step) -> "
     "Peak\n\n"
     "Peak of the response amplitude re.u + i im.u near a point of the curve; y and tangent are changed in place."},
    {"contact", (PyCFunction)System_contact, METH_VARARGS,
     "contact(u, X, F, share, omega=0.0) -> int\n\nFill motion and force (n_point, 3, n_coef) and the shares of the cycle "
     "(n_point, 5): stick and slip along t1, stick and slip along t2, open; omega matters in a family alone."},
    {NULL, NULL, 0, NULL}};

static PyGetSetDef System_getset[] = {{"cost", (getter)System_get_cost, NULL,
                                       "Counts: seconds and counts of all calls since this System was made.", NULL},
                                      {"n_unknown", (getter)System_get_n_unknown, NULL,
                                       "Number of unknowns without the frequency.", NULL},
                                      {NULL, NULL, NULL, NULL, NULL}};

static PyType_Slot System_slots[] = {{Py_tp_new, System_new},
                                     {Py_tp_dealloc, System_dealloc},
                                     {Py_tp_methods, System_methods},
                                     {Py_tp_getset, System_getset},
                                     {Py_tp_doc,
                                      "Harmonic balance equations of one structure, built once from arrays.\n\n"
                                      "With nodes (a tuple of Systems alike), squares (of their speeds) and order (an "
                                      "engine order) all arrays are polynomials of the squared speed (omega/order)^2 "
                                      "through those of the nodes, and derivatives by omega are along this line."},
                                     {0, NULL}};

PyType_Spec core_system_spec = {.name = "bdamper._core.System",
                                .basicsize = sizeof(SystemObject),
                                .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
                                .slots = System_slots};
