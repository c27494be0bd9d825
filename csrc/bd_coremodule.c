/* bdamper._core: the boundary between Python and C.
 *
 * Bindings parse, check and copy; they hold no mathematics.  Work is done without the GIL, under the lock of the System
 * that owns the workspace.  Arrays must have the dtype, shape and layout asked for: Python converts, C refuses.
 * Failure to converge is a returned status; only wrong arguments and lack of memory are exceptions. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#define NPY_NO_DEPRECATED_API NPY_1_25_API_VERSION
#include <numpy/arrayobject.h>
#include <math.h>
#include <pythread.h>
#include <string.h>

#include "bd_newton.h"

typedef struct {
    bd_lapack lapack;
} core_state;

static struct PyModuleDef core_module;

/* ---- checks ---- */

static int has_shape(PyArrayObject *array, int n_dim, const npy_intp *shape) {
    if (PyArray_NDIM(array) != n_dim) return 0;
    for (int i = 0; i < n_dim; ++i)
        if (PyArray_DIM(array, i) != shape[i]) return 0;
    return 1;
}

static PyObject *shape_text(int n_dim, const npy_intp *shape) {
    PyObject *tuple = PyTuple_New(n_dim);
    if (!tuple) return NULL;
    for (int i = 0; i < n_dim; ++i) {
        PyObject *n = PyLong_FromSsize_t((Py_ssize_t)shape[i]);
        if (!n) {
            Py_DECREF(tuple);
            return NULL;
        }
        PyTuple_SET_ITEM(tuple, i, n);
    }
    PyObject *text = PyObject_Str(tuple);
    Py_DECREF(tuple);
    return text;
}

/* Data of a C-contiguous, aligned array of that type and shape, or NULL with an exception that names the argument. */
static void *array_data(PyObject *object, const char *name, int type, const char *type_name, int n_dim,
                        const npy_intp *shape, int writable) {
    if (!PyArray_Check(object)) {
        PyErr_Format(PyExc_TypeError, "%s: expected a numpy array, found %s", name, Py_TYPE(object)->tp_name);
        return NULL;
    }
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_TYPE(array) != type || !PyArray_ISNOTSWAPPED(array)) {
        PyErr_Format(PyExc_TypeError, "%s: expected dtype %s, found %R", name, type_name, PyArray_DESCR(array));
        return NULL;
    }
    if (!has_shape(array, n_dim, shape)) {
        PyObject *expected = shape_text(n_dim, shape), *found = shape_text(PyArray_NDIM(array), PyArray_DIMS(array));
        if (expected && found) PyErr_Format(PyExc_ValueError, "%s: expected shape %U, found %U", name, expected, found);
        Py_XDECREF(expected);
        Py_XDECREF(found);
        return NULL;
    }
    if (!PyArray_IS_C_CONTIGUOUS(array) || !PyArray_ISALIGNED(array) || (writable && !PyArray_ISWRITEABLE(array))) {
        PyErr_Format(PyExc_ValueError, "%s: expected an aligned C-contiguous%s array", name, writable ? ", writable" : "");
        return NULL;
    }
    return PyArray_DATA(array);
}

static double *doubles(PyObject *object, const char *name, int n_dim, const npy_intp *shape, int writable) {
    return array_data(object, name, NPY_DOUBLE, "float64", n_dim, shape, writable);
}

static double *vector(PyObject *object, const char *name, npy_intp n, int writable) {
    return doubles(object, name, 1, &n, writable);
}

static int all_satisfy(const double *x, npy_intp n, const char *name, int non_negative) {
    for (npy_intp i = 0; i < n; ++i) {
        const int finite = x[i] - x[i] == 0.0;
        if (finite && (!non_negative || x[i] >= 0.0)) continue;
        PyObject *value = PyFloat_FromDouble(x[i]);
        if (value)
            PyErr_Format(PyExc_ValueError, "%s: expected %s numbers, found %R at flat index %zd", name,
                         non_negative ? "finite non-negative" : "finite", value, (Py_ssize_t)i);
        Py_XDECREF(value);
        return 0;
    }
    return 1;
}

static int check_evaluation(int evaluation, int n_time, int n_harm) {
    if (evaluation < BD_EXACT || evaluation > BD_SAMPLED_PLAIN) {
        PyErr_Format(PyExc_ValueError, "evaluation: expected 0 (exact), 1 (sampled) or 2 (plain), found %d", evaluation);
        return 0;
    }
    if (evaluation != BD_EXACT && (n_time < 4 * n_harm + 4 || n_time > 1 << 20)) {
        PyErr_Format(PyExc_ValueError, "n_time: expected %d to %d samples for %d harmonics, found %d", 4 * n_harm + 4,
                     1 << 20, n_harm, n_time);
        return 0;
    }
    return 1;
}

static int check_n_harm(npy_intp n_harm) {
    if (n_harm >= 1 && n_harm <= BD_MAX_HARM) return 1;
    PyErr_Format(PyExc_ValueError, "number of harmonics: expected 1 to %d, found %zd", BD_MAX_HARM, (Py_ssize_t)n_harm);
    return 0;
}

static int check_law(int law, int evaluation) {
    if (bd_evaluation_serves((bd_evaluation)evaluation, (bd_law)law)) return 1;
    PyErr_Format(PyExc_ValueError,
                 "law: the coupled laws (%d, %d) have no exact evaluation; expected evaluation 1 or 2 "
                 "with them, found 0",
                 BD_LAW_COUPLED, BD_LAW_COUPLED_CONSTANT);
    return 0;
}

/* An infinite slider asks for an end of the interval of residual tractions, which only the 1-D laws have. */
static int check_slider(const double *w, int law) {
    const int one_d = law == BD_LAW_SEPARABLE || law == BD_LAW_CONSTANT;
    for (int d = 0; d < 2; ++d) {
        const int finite = w[d] - w[d] == 0.0;
        if (finite || (one_d && w[d] == w[d])) continue;
        PyObject *value = PyFloat_FromDouble(w[d]);
        if (value) PyErr_Format(PyExc_ValueError, "w: expected finite numbers under law %d, found %R", law, value);
        Py_XDECREF(value);
        return 0;
    }
    return 1;
}

/* ---- System ---- */

typedef struct {
    PyObject_HEAD bd_hbm hbm;
    bd_newton_work newton;
    PyThread_type_lock lock;
} SystemObject;

static void lock_without_gil(SystemObject *self) { PyThread_acquire_lock(self->lock, WAIT_LOCK); }

static void System_dealloc(SystemObject *self) {
    PyTypeObject *type = Py_TYPE(self);
    if (self->hbm.n_mode) bd_hbm_destroy(&self->hbm);
    bd_newton_destroy(&self->newton);
    if (self->lock) PyThread_free_lock(self->lock);
    type->tp_free((PyObject *)self);
    Py_DECREF(type);
}

static int raise_status(bd_status status) {
    if (status == BD_NO_MEMORY) PyErr_NoMemory();
    if (status == BD_BAD_ARGUMENT) PyErr_SetString(PyExc_ValueError, "the core refused the arguments");
    return status == BD_OK;
}

static int read_points(PyObject *const *object, bd_hbm_input *in, npy_intp n_point) {
    npy_intp by2[2] = {n_point, 2}, by3[2] = {n_point, 3};
    if (!(in->kt = doubles(object[0], "kt", 2, by2, 0)) || !all_satisfy(in->kt, 2 * n_point, "kt", 1)) return 0;
    if (!(in->kn = vector(object[1], "kn", n_point, 0)) || !all_satisfy(in->kn, n_point, "kn", 1)) return 0;
    if (!(in->mu = vector(object[2], "mu", n_point, 0)) || !all_satisfy(in->mu, n_point, "mu", 1)) return 0;
    if (!(in->n0 = vector(object[3], "n0", n_point, 0)) || !all_satisfy(in->n0, n_point, "n0", 0)) return 0;
    if (!(in->w = doubles(object[4], "w", 2, by2, 0))) return 0;
    if (!(in->law = array_data(object[5], "law", NPY_INT, "intc", 1, &n_point, 0))) return 0;
    for (npy_intp p = 0; p < n_point; ++p)
        if (in->law[p] < 0 || in->law[p] >= BD_N_LAW) {
            PyErr_Format(PyExc_ValueError, "law: expected 0 to %d, found %d at point %zd", BD_N_LAW - 1, in->law[p],
                         (Py_ssize_t)p);
            return 0;
        }
    for (npy_intp p = 0; p < n_point; ++p)
        if (!check_law(in->law[p], in->evaluation) || !check_slider(in->w + 2 * p, in->law[p])) return 0;
    if (object[7] != Py_None &&
        (!(in->load = vector(object[7], "load", n_point, 0)) || !all_satisfy(in->load, n_point, "load", 0)))
        return 0;
    return (in->shift = doubles(object[6], "shift", 2, by3, 0)) && all_satisfy(in->shift, 3 * n_point, "shift", 0);
}

static PyObject *System_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"n_mode", "stiffness", "mass",  "damping", "G",          "kt",     "kn",   "mu", "n0",
                            "w",      "law",       "shift", "force",   "evaluation", "n_time", "load", NULL};
    PyObject *n_mode, *stiffness, *mass, *damping, *G, *force, *point[8];
    point[7] = Py_None;
    bd_hbm_input in = {0};
    int evaluation = BD_EXACT;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOOOOOOOOO|iiO:System", names, &n_mode, &stiffness, &mass, &damping,
                                     &G, &point[0], &point[1], &point[2], &point[3], &point[4], &point[5], &point[6],
                                     &force, &evaluation, &in.n_time, &point[7]))
        return NULL;
    if (!PyArray_Check(n_mode) || PyArray_NDIM((PyArrayObject *)n_mode) != 1) {
        PyErr_SetString(PyExc_TypeError, "n_mode: expected a one-dimensional numpy array");
        return NULL;
    }
    const npy_intp n_group = PyArray_DIM((PyArrayObject *)n_mode, 0);
    if (!check_n_harm(n_group - 1) || !(in.n_mode = array_data(n_mode, "n_mode", NPY_INT, "intc", 1, &n_group, 0)))
        return NULL;
    in.n_harm = (int)(n_group - 1);
    npy_intp n_modes = 0, n_unknown = 0;
    for (npy_intp l = 0; l < n_group; ++l) {
        if (in.n_mode[l] < 0 || in.n_mode[l] > 100000) {
            PyErr_Format(PyExc_ValueError, "n_mode: expected 0 to 100000 modes, found %d", in.n_mode[l]);
            return NULL;
        }
        n_modes += in.n_mode[l];
        n_unknown += (l == 0 ? 1 : 2) * in.n_mode[l];
    }
    if (!PyArray_Check(point[1]) || PyArray_NDIM((PyArrayObject *)point[1]) != 1) {
        PyErr_SetString(PyExc_TypeError, "kn: expected a one-dimensional numpy array");
        return NULL;
    }
    const npy_intp n_point = PyArray_DIM((PyArrayObject *)point[1], 0), n_G = 3 * n_point * n_modes;
    in.n_point = (int)n_point;
    in.evaluation = (bd_evaluation)evaluation;
    if (n_unknown < 1 || n_unknown > 30000 || n_point > 10000000) {
        PyErr_Format(PyExc_ValueError, "expected 1 to 30000 unknowns and at most 10000000 points, found %zd and %zd",
                     (Py_ssize_t)n_unknown, (Py_ssize_t)n_point);
        return NULL;
    }
    if (!check_evaluation(evaluation, in.n_time, in.n_harm)) return NULL;
    if (!(in.stiffness = vector(stiffness, "stiffness", n_modes, 0)) ||
        !all_satisfy(in.stiffness, n_modes, "stiffness", 1) || !(in.mass = vector(mass, "mass", n_modes, 0)) ||
        !all_satisfy(in.mass, n_modes, "mass", 1) || !(in.damping = vector(damping, "damping", n_modes, 0)) ||
        !all_satisfy(in.damping, n_modes, "damping", 1) || !(in.force = vector(force, "force", n_unknown, 0)) ||
        !all_satisfy(in.force, n_unknown, "force", 0) ||
        !(in.G = array_data(G, "G", NPY_CDOUBLE, "complex128", 1, &n_G, 0)) || !all_satisfy(in.G, 2 * n_G, "G", 0) ||
        !read_points(point, &in, n_point))
        return NULL;

    core_state *state = PyType_GetModuleState(type);
    SystemObject *self = (SystemObject *)type->tp_alloc(type, 0);
    if (!self) return NULL;
    self->lock = PyThread_allocate_lock();
    if (!self->lock || !raise_status(bd_hbm_create(&self->hbm, &in)) ||
        !raise_status(bd_newton_create(&self->newton, self->hbm.n_unknown, &state->lapack))) {
        if (!PyErr_Occurred()) PyErr_NoMemory();
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

static PyObject *System_evaluate(SystemObject *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"u", "omega", "r", "J", "r_omega", NULL};
    PyObject *u_object, *r_object, *J_object = Py_None, *d_object = Py_None;
    double omega;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OdO|OO:evaluate", names, &u_object, &omega, &r_object, &J_object,
                                     &d_object))
        return NULL;
    const npy_intp n = self->hbm.n_unknown, square[2] = {n, n};
    double *u = vector(u_object, "u", n, 0), *r = u ? vector(r_object, "r", n, 1) : NULL, *J = NULL, *d = NULL;
    if (!r) return NULL;
    if (J_object != Py_None && !(J = doubles(J_object, "J", 2, square, 1))) return NULL;
    if (d_object != Py_None && !(d = vector(d_object, "r_omega", n, 1))) return NULL;
    bd_status status;
    Py_BEGIN_ALLOW_THREADS lock_without_gil(self);
    status = bd_hbm_evaluate(&self->hbm, u, omega, r, J, d);
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS return PyLong_FromLong(status);
}

/* Stick, slip and open, averaged over the points with friction at the latest evaluation. */
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

static PyObject *System_correct(SystemObject *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"y",         "normal",         "scale",       "row_scale",  "tangent",
                            "tolerance", "max_iterations", "line_search", "least_norm", "rank_tolerance",
                            "ramp",      "omega",          "support",     NULL};
    PyObject *object[5], *ramp = Py_None, *support = Py_None;
    bd_newton_options options = {.least_norm = 1, .rank_tolerance = 1e-14};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOdi|ppdOdO:correct", names, &object[0], &object[1], &object[2],
                                     &object[3], &object[4], &options.tolerance, &options.max_iterations,
                                     &options.line_search, &options.least_norm, &options.rank_tolerance, &ramp,
                                     &options.omega, &support))
        return NULL;
    const npy_intp n = self->hbm.n_unknown, square[2] = {n, n};
    double *y = vector(object[0], "y", n + 1, 1);
    double *normal = y ? vector(object[1], "normal", n + 1, 0) : NULL;
    double *scale = normal ? vector(object[2], "scale", n + 1, 0) : NULL;
    double *row_scale = scale ? vector(object[3], "row_scale", n, 0) : NULL;
    double *tangent = row_scale ? vector(object[4], "tangent", n + 1, 1) : NULL;
    if (!tangent || (ramp != Py_None && !(options.ramp = vector(ramp, "ramp", n, 0)))) return NULL;
    if (support != Py_None && !(options.support = doubles(support, "support", 2, square, 0))) return NULL;
    bd_newton_report report;
    bd_status status;
    double mean[3];
    Py_BEGIN_ALLOW_THREADS lock_without_gil(self);
    status = bd_newton_correct(&self->hbm, &self->newton, &options, y, normal, scale, row_scale, tangent, &report);
    mean_shares(&self->hbm, mean);
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS return Py_BuildValue("iiddddi(ddd)i", (int)status, report.iterations, report.residual,
                                              report.first_step, report.last_step, report.condition, report.rank, mean[0],
                                              mean[1], mean[2], report.orientation);
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
    const npy_intp n = self->hbm.n_unknown;
    double *y = vector(object[0], "y", n + 1, 1);
    double *tangent = y ? vector(object[1], "tangent", n + 1, 1) : NULL;
    double *scale = tangent ? vector(object[2], "scale", n + 1, 0) : NULL;
    double *row_scale = scale ? vector(object[3], "row_scale", n, 0) : NULL;
    double *re = row_scale ? vector(object[4], "re", n, 0) : NULL;
    double *im = re ? vector(object[5], "im", n, 0) : NULL;
    if (!im) return NULL;
    peak.re = re, peak.im = im;
    bd_newton_report report;
    bd_status status;
    double mean[3];
    Py_BEGIN_ALLOW_THREADS lock_without_gil(self);
    status = bd_newton_peak(&self->hbm, &self->newton, &options, &peak, y, tangent, scale, row_scale, &report);
    mean_shares(&self->hbm, mean);
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS return Py_BuildValue("iidddi(ddd)", (int)status, report.iterations, report.residual, peak.slope,
                                              peak.curvature, report.rank, mean[0], mean[1], mean[2]);
}

static void copy_shares(const bd_hbm *hbm, double *share) {
    for (int p = 0; p < hbm->n_point; ++p) {
        const bd_status_share s = hbm->share[p];
        const double row[5] = {s.stick[0], s.slip[0], s.stick[1], s.slip[1], s.open};
        memcpy(share + 5 * (size_t)p, row, sizeof row);
    }
}

/* State shares of the latest evaluation. */
static PyObject *System_shares(SystemObject *self, PyObject *object) {
    const npy_intp by5[2] = {self->hbm.n_point, 5};
    double *share = doubles(object, "share", 2, by5, 1);
    if (!share) return NULL;
    Py_BEGIN_ALLOW_THREADS lock_without_gil(self);
    copy_shares(&self->hbm, share);
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS Py_RETURN_NONE;
}

/* Motion, force and state shares of all points at u. */
static PyObject *System_contact(SystemObject *self, PyObject *args) {
    PyObject *object[4];
    if (!PyArg_ParseTuple(args, "OOOO:contact", &object[0], &object[1], &object[2], &object[3])) return NULL;
    const npy_intp n = self->hbm.n_unknown, n_point = self->hbm.n_point;
    const npy_intp full[3] = {n_point, 3, self->hbm.n_coef}, by5[2] = {n_point, 5};
    double *u = vector(object[0], "u", n, 0);
    double *X = u ? doubles(object[1], "X", 3, full, 1) : NULL;
    double *F = X ? doubles(object[2], "F", 3, full, 1) : NULL;
    double *share = F ? doubles(object[3], "share", 2, by5, 1) : NULL;
    if (!share) return NULL;
    double *r = PyMem_Malloc(sizeof(double) * (size_t)n);
    if (!r) return PyErr_NoMemory();
    bd_status status;
    Py_BEGIN_ALLOW_THREADS lock_without_gil(self);
    status = bd_hbm_evaluate(&self->hbm, u, 0.0, r, NULL, NULL);
    const size_t size = sizeof(double) * (size_t)(3 * n_point * self->hbm.n_coef);
    memcpy(X, self->hbm.X, size);
    memcpy(F, self->hbm.F, size);
    copy_shares(&self->hbm, share);
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS PyMem_Free(r);
    return PyLong_FromLong(status);
}

static PyObject *System_get_cost(SystemObject *self, void *closure) {
    (void)closure;
    bd_cost c;
    Py_BEGIN_ALLOW_THREADS lock_without_gil(self);
    c = self->hbm.cost;
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS return Py_BuildValue("dddllll", c.contact, c.assembly, c.algebra, c.n_evaluation, c.n_jacobian,
                                              c.n_factorisation, c.n_least_norm);
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
     "rank_tolerance=1e-14, ramp=None, omega=0.0, support=None)\n-> (status, iterations, residual, first_step, last_step, "
     "condition, "
     "rank, (stick, slip, open), orientation)\n\n"
     "Newton corrector of one continuation step; y and tangent are changed in place.  The last entry of y is omega, or, "
     "with ramp (n_unknown), a factor on that part of the excitation at the given omega, which also fades out the linear "
     "force support (n_unknown, n_unknown)."},
    {"peak", (PyCFunction)(void (*)(void))System_peak, METH_VARARGS | METH_KEYWORDS,
     "peak(y, tangent, scale, row_scale, re, im, tolerance, max_iterations, curvature, place_tolerance, max_step)\n"
     "-> (status, iterations, residual, slope, curvature, rank, (stick, slip, open))\n\n"
     "Peak of the response amplitude re.u + i im.u near a point of the curve; y and tangent are changed in place."},
    {"shares", (PyCFunction)System_shares, METH_O,
     "shares(share)\n\nFill the shares of the cycle (n_point, 5) of the latest evaluation."},
    {"contact", (PyCFunction)System_contact, METH_VARARGS,
     "contact(u, X, F, share) -> int\n\nFill motion and force (n_point, 3, n_coef) and the shares of the cycle "
     "(n_point, 5): stick and slip along t1, stick and slip along t2, open."},
    {NULL, NULL, 0, NULL}};

static PyGetSetDef System_getset[] = {{"cost", (getter)System_get_cost, NULL,
                                       "Seconds in contact, assembly and algebra; evaluations, Jacobians, factorisations.",
                                       NULL},
                                      {"n_unknown", (getter)System_get_n_unknown, NULL,
                                       "Number of unknowns without the frequency.", NULL},
                                      {NULL, NULL, NULL, NULL, NULL}};

static PyType_Slot System_slots[] = {{Py_tp_new, System_new},
                                     {Py_tp_dealloc, System_dealloc},
                                     {Py_tp_methods, System_methods},
                                     {Py_tp_getset, System_getset},
                                     {Py_tp_doc, "Harmonic balance equations of one structure, built once from arrays."},
                                     {0, NULL}};

static PyType_Spec System_spec = {.name = "bdamper._core.System",
                                  .basicsize = sizeof(SystemObject),
                                  .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
                                  .slots = System_slots};

/* ---- one contact point ---- */

static PyObject *segment_list(const bd_evaluator *evaluator, int d) {
    const bd_segment *segment;
    const int n = bd_contact_segments(evaluator, d, &segment);
    PyObject *list = PyList_New(n);
    for (int i = 0; list && i < n; ++i) {
        PyObject *item = Py_BuildValue("ddi", segment[i].start, segment[i].end, segment[i].state);
        if (!item)
            Py_CLEAR(list);
        else
            PyList_SET_ITEM(list, i, item);
    }
    return list;
}

/* Spreads the blocks of one point into the dense (3, n_coef, 3, n_coef) tangent. */
static void spread(const double *block, int row, int column, npy_intp n_coef, double *J) {
    for (npy_intp i = 0; i < n_coef; ++i)
        for (npy_intp j = 0; j < n_coef; ++j) J[((row * n_coef + i) * 3 + column) * n_coef + j] = block[i * n_coef + j];
}

static PyObject *evaluate_contact(PyObject *module, PyObject *args, PyObject *kwargs) {
    (void)module;
    static char *names[] = {"x", "kt", "kn", "mu", "n0", "w", "F", "J", "law", "evaluation", "n_time", "load", NULL};
    PyObject *x_object, *kt_object, *w_object, *F_object, *J_object;
    bd_element element = {0};
    int law = 0, evaluation = 0, n_time = 0;
    element.load = NAN;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOdddOOO|iiid:evaluate_contact", names, &x_object, &kt_object,
                                     &element.kn, &element.mu, &element.n0, &w_object, &F_object, &J_object, &law,
                                     &evaluation, &n_time, &element.load))
        return NULL;
    if (!PyArray_Check(x_object) || PyArray_NDIM((PyArrayObject *)x_object) != 2 ||
        PyArray_DIM((PyArrayObject *)x_object, 0) != 3 || PyArray_DIM((PyArrayObject *)x_object, 1) % 2 != 1) {
        PyErr_SetString(PyExc_ValueError, "x: expected a numpy array of shape (3, 2 n_harm + 1)");
        return NULL;
    }
    const npy_intp n_coef = PyArray_DIM((PyArrayObject *)x_object, 1);
    const npy_intp shape[2] = {3, n_coef}, shape_J[4] = {3, n_coef, 3, n_coef};
    if (!check_n_harm((n_coef - 1) / 2)) return NULL;
    const int n_harm = (int)((n_coef - 1) / 2);
    double *x = doubles(x_object, "x", 2, shape, 0), *kt = x ? vector(kt_object, "kt", 2, 0) : NULL;
    double *w = kt ? vector(w_object, "w", 2, 0) : NULL, *F = w ? doubles(F_object, "F", 2, shape, 1) : NULL;
    double *J = F ? doubles(J_object, "J", 4, shape_J, 1) : NULL;
    if (!J || !check_evaluation(evaluation, n_time, n_harm) || !all_satisfy(x, 3 * n_coef, "x", 0) ||
        !all_satisfy(kt, 2, "kt", 1) || !all_satisfy(&element.kn, 1, "kn", 1) || !all_satisfy(&element.mu, 1, "mu", 1) ||
        !all_satisfy(&element.n0, 1, "n0", 0))
        return NULL;
    if (law < 0 || law >= BD_N_LAW) {
        PyErr_Format(PyExc_ValueError, "law: expected 0 to %d, found %d", BD_N_LAW - 1, law);
        return NULL;
    }
    if (!check_law(law, evaluation) || !check_slider(w, law)) return NULL;
    if (element.load != element.load) element.load = element.n0;
    if (!all_satisfy(&element.load, 1, "load", 0)) return NULL;
    element.law = (bd_law)law;
    memcpy(element.kt, kt, sizeof element.kt);
    memcpy(element.w, w, sizeof element.w);
    bd_evaluator evaluator;
    if (!raise_status(bd_evaluator_create(&evaluator, (bd_evaluation)evaluation, n_harm, n_time))) return NULL;
    const size_t nn = (size_t)(n_coef * n_coef);
    double *block = PyMem_Malloc(sizeof(double) * 7 * nn);
    PyObject *result = NULL;
    if (!block) {
        PyErr_NoMemory();
        goto done;
    }
    bd_response out = {.F = F,
                       .dT = {block, block + nn},
                       .dTv = {block + 2 * nn, block + 3 * nn},
                       .dTc = {block + 4 * nn, block + 5 * nn},
                       .dN = block + 6 * nn};
    bd_status_share share;
    bd_contact_evaluate(&element, x, &out, &share, &evaluator);
    bd_element_write_blocks(&element, n_harm, &out);
    memset(J, 0, sizeof(double) * 9 * nn);
    for (int d = 0; d < 2; ++d) {
        spread(out.dT[d], d, d, n_coef, J);
        spread(out.dTv[d], d, 2, n_coef, J);
        spread(out.dTc[d], d, 1 - d, n_coef, J);
    }
    spread(out.dN, 2, 2, n_coef, J);
    PyObject *first = segment_list(&evaluator, 0), *second = segment_list(&evaluator, 1);
    if (first && second)
        result = Py_BuildValue("(ddddd)(OO)", share.stick[0], share.slip[0], share.stick[1], share.slip[1], share.open,
                               first, second);
    Py_XDECREF(first);
    Py_XDECREF(second);
done:
    PyMem_Free(block);
    bd_evaluator_destroy(&evaluator);
    return result;
}

static PyMethodDef core_methods[] = {
    {"evaluate_contact", (PyCFunction)(void (*)(void))evaluate_contact, METH_VARARGS | METH_KEYWORDS,
     "evaluate_contact(x, kt, kn, mu, n0, w, F, J, law=0, evaluation=0, n_time=0, load=n0) -> (shares, segments)\n\n"
     "One contact point: fill force (3, n_coef) and tangent (3, n_coef, 3, n_coef); return the shares of the cycle and "
     "for each direction a list of (start, end, state)."},
    {NULL, NULL, 0, NULL}};

/* ---- LAPACK ---- */

#ifdef BD_SYSTEM_LAPACK
static int find_lapack(bd_lapack *lapack) {
    *lapack = bd_lapack_system();
    return 0;
}
#else
/* One function of a SciPy Cython module.  The name of the capsule is the C signature: it must be the expected count of
 * pointers with int integers, else the call would corrupt memory. */
static int find_function(PyObject *capi, const char *name, const char *pattern, void *target) {
    PyObject *capsule = PyDict_GetItemString(capi, name);
    const char *signature = capsule ? PyCapsule_GetName(capsule) : NULL;
    if (!signature) {
        PyErr_Format(PyExc_ImportError, "bdamper needs %s from scipy.linalg, which this SciPy does not offer", name);
        return -1;
    }
    char kinds[32];
    size_t n = 0;
    const char *p = strchr(signature, '(');
    while (p && *p && *p != ')' && n + 1 < sizeof kinds) { /* one letter for each argument: c, i, d or ? */
        ++p;
        while (*p == ' ') ++p;
        const size_t span = strcspn(p, ",)");
        if (strncmp(p, "char *", 6) == 0)
            kinds[n++] = 'c';
        else if (strncmp(p, "int *", 5) == 0)
            kinds[n++] = 'i';
        else if (strncmp(p, "double *", 8) == 0)
            kinds[n++] = 'd';
        else if (strncmp(p, "__pyx_t_5scipy_6linalg_", 23) == 0 && span > 4 && strncmp(p + span - 4, "_d *", 4) == 0)
            kinds[n++] = 'd';
        else
            kinds[n++] = '?';
        p += span;
    }
    kinds[n] = '\0';
    if (strncmp(signature, "void (", 6) != 0 || strcmp(kinds, pattern) != 0) {
        PyErr_Format(PyExc_ImportError,
                     "bdamper: %s of this SciPy has the signature '%s', expected arguments '%s' "
                     "(c: char*, i: int*, d: double*); build with -Dlapack=system instead",
                     name, signature, pattern);
        return -1;
    }
    void *pointer = PyCapsule_GetPointer(capsule, signature);
    if (!pointer) return -1;
    memcpy(target, &pointer, sizeof pointer);
    return 0;
}

static int find_lapack(bd_lapack *lapack) {
    int failed = -1;
    PyObject *lapack_module = PyImport_ImportModule("scipy.linalg.cython_lapack");
    PyObject *api = lapack_module ? PyObject_GetAttrString(lapack_module, "__pyx_capi__") : NULL;
    if (api)
        failed = find_function(api, "dgetrf", "iidiii", &lapack->dgetrf) ||
                         find_function(api, "dgetrs", "ciidiidii", &lapack->dgetrs) ||
                         find_function(api, "dgecon", "cididddii", &lapack->dgecon) ||
                         find_function(api, "dgelsy", "iiididiididii", &lapack->dgelsy)
                     ? -1
                     : 0;
    Py_XDECREF(api);
    Py_XDECREF(lapack_module);
    return failed;
}
#endif

static int core_exec(PyObject *module) {
    core_state *state = PyModule_GetState(module);
    if (PyArray_ImportNumPyAPI() < 0 || find_lapack(&state->lapack) < 0) return -1;
    PyObject *type = PyType_FromModuleAndSpec(module, &System_spec, NULL);
    if (!type) return -1;
    const int failed = PyModule_AddType(module, (PyTypeObject *)type);
    Py_DECREF(type);
    return failed;
}

static PyModuleDef_Slot core_slots[] = {{Py_mod_exec, core_exec},
#ifdef Py_MOD_GIL_NOT_USED
                                        {Py_mod_gil, Py_MOD_GIL_NOT_USED},
#endif
                                        {0, NULL}};

static struct PyModuleDef core_module = {PyModuleDef_HEAD_INIT,
                                         .m_name = "bdamper._core",
                                         .m_doc = "C core of bdamper: contact elements and harmonic balance.",
                                         .m_size = sizeof(core_state),
                                         .m_methods = core_methods,
                                         .m_slots = core_slots};

PyMODINIT_FUNC PyInit__core(void) { return PyModuleDef_Init(&core_module); }
