/* bdamper._core: one contact point, for tests and teaching; many points at once, for the wheel. */
#include "bd_core.h"

#include <math.h>
#include <string.h>

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

/* Spreads a block of the point into the dense (3, n_coef, 3, n_coef) tangent. */
static void spread(const double *block, int row, int column, npy_intp n_coef, double *J) {
    for (npy_intp i = 0; i < n_coef; ++i)
        for (npy_intp j = 0; j < n_coef; ++j) J[((row * n_coef + i) * 3 + column) * n_coef + j] = block[i * n_coef + j];
}

/* One point and where its results go. */
typedef struct {
    bd_element element;
    int evaluation, n_time, n_harm;
    npy_intp n_coef;
    double *x, *F, *J;
} contact_call;

/* Motion and parameters; F and J are to be written. */
static int read_call(PyObject *args, PyObject *kwargs, contact_call *c) {
    static char *names[] = {"x", "kt", "kn", "mu", "n0", "w", "F", "J", "law", "evaluation", "n_time", "load", NULL};
    PyObject *x, *kt_object, *w_object, *F, *J;
    bd_element *e = &c->element;
    int law = 0;
    e->load = NAN;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOdddOOO|iiid:evaluate_contact", names, &x, &kt_object, &e->kn, &e->mu,
                                     &e->n0, &w_object, &F, &J, &law, &c->evaluation, &c->n_time, &e->load))
        return 0;
    if (!PyArray_Check(x) || PyArray_NDIM((PyArrayObject *)x) != 2 || PyArray_DIM((PyArrayObject *)x, 0) != 3 ||
        PyArray_DIM((PyArrayObject *)x, 1) % 2 != 1) {
        PyErr_SetString(PyExc_ValueError, "x: expected a numpy array of shape (3, 2 n_harm + 1)");
        return 0;
    }
    core_arguments arguments = {0};
    const npy_intp n = c->n_coef = PyArray_DIM((PyArrayObject *)x, 1), shape[2] = {3, n}, shape_J[4] = {3, n, 3, n},
                   two = 2;
    if (!core_check_n_harm((n - 1) / 2)) return 0;
    c->n_harm = (int)((n - 1) / 2);
    const double *kt, *w;
    if (!(c->x = core_numbers(&arguments, x, "x", 2, shape, BD_FINITE))) return 0;
    if (!(kt = core_numbers(&arguments, kt_object, "kt", 1, &two, law == BD_LAW_CUBIC ? BD_FINITE : BD_NON_NEGATIVE)))
        return 0;
    if (!(w = core_vector(&arguments, w_object, "w", two, BD_INPUT))) return 0;
    if (!(c->F = core_doubles(&arguments, F, "F", 2, shape, BD_OUTPUT))) return 0;
    if (!(c->J = core_doubles(&arguments, J, "J", 4, shape_J, BD_OUTPUT))) return 0;
    if (!core_check_evaluation(c->evaluation, c->n_time, c->n_harm) || !core_check_law(law, c->evaluation)) return 0;
    if (isnan(e->load)) e->load = e->n0;
    if (!core_check_number(e->kn, "kn", BD_NON_NEGATIVE) || !core_check_number(e->mu, "mu", BD_NON_NEGATIVE) ||
        !core_check_number(e->n0, "n0", BD_FINITE) || !core_check_number(e->load, "load", BD_FINITE) ||
        !core_check_slider(w, law))
        return 0;
    e->law = (bd_law)law;
    memcpy(e->kt, kt, sizeof e->kt);
    memcpy(e->w, w, sizeof e->w);
    return 1;
}

/* Force and dense tangent, with room (7, n_coef, n_coef) for the blocks that the contact laws write. */
static void evaluate(const contact_call *c, double *block, bd_status_share *share, bd_evaluator *evaluator) {
    const size_t nn = (size_t)(c->n_coef * c->n_coef);
    bd_response out = {.F = c->F,
                       .dT = {block, block + nn},
                       .dTv = {block + 2 * nn, block + 3 * nn},
                       .dTc = {block + 4 * nn, block + 5 * nn},
                       .dN = block + 6 * nn};
    bd_contact_evaluate(&c->element, c->x, &out, share, evaluator);
    bd_element_write_blocks(&c->element, c->n_harm, &out);
    memset(c->J, 0, sizeof(double) * 9 * nn);
    for (int d = 0; d < 2; ++d) {
        spread(out.dT[d], d, d, c->n_coef, c->J);
        spread(out.dTv[d], d, 2, c->n_coef, c->J);
        spread(out.dTc[d], d, 1 - d, c->n_coef, c->J);
    }
    spread(out.dN, 2, 2, c->n_coef, c->J);
}

PyObject *core_evaluate_contact(PyObject *module, PyObject *args, PyObject *kwargs) {
    (void)module;
    contact_call call = {0};
    bd_evaluator evaluator;
    bd_status_share share;
    PyObject *result = NULL;
    if (!core_check_kernel() || !read_call(args, kwargs, &call)) return NULL;
    if (!core_check_status(bd_evaluator_create(&evaluator, (bd_evaluation)call.evaluation, call.n_harm, call.n_time)))
        return NULL;
    double *block = PyMem_Malloc(sizeof(double) * 7 * (size_t)(call.n_coef * call.n_coef));
    if (!block) {
        PyErr_NoMemory();
        goto done;
    }
    evaluate(&call, block, &share, &evaluator);
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

/* ---- many points ---- */

/* Elements and motions of n_point points, and where their results go; T is NULL where no tangent is asked for. */
typedef struct {
    npy_intp n_point, n_coef;
    int evaluation, n_time;
    bd_element *element;
    const double *x;
    double *F, *T, *share;
} points_call;

static void fill_elements(points_call *c, const double *kt, const double *kn, const double *mu, const double *n0,
                          const double *w, const double *load, const int *law) {
    for (npy_intp p = 0; p < c->n_point; ++p)
        c->element[p] = (bd_element){.law = (bd_law)law[p],
                                     .kt = {kt[2 * p], kt[2 * p + 1]},
                                     .kn = kn[p],
                                     .mu = mu[p],
                                     .n0 = n0[p],
                                     .w = {w[2 * p], w[2 * p + 1]},
                                     .load = load[p]};
}

static void evaluate_group(const points_call *c, npy_intp first, int n, bd_evaluator *evaluator) {
    const size_t n_coef = (size_t)c->n_coef, nn = n_coef * n_coef, at = (size_t)first;
    bd_response out[BD_LANES];
    bd_status_share share[BD_LANES];
    for (int i = 0; i < n; ++i) {
        out[i] = (bd_response){.F = c->F + 3 * n_coef * (at + (size_t)i)};
        if (!c->T) continue;
        double *block = c->T + 7 * nn * (at + (size_t)i);
        for (int d = 0; d < 2; ++d) {
            out[i].dT[d] = block + (size_t)d * nn;
            out[i].dTv[d] = block + (size_t)(2 + d) * nn;
            out[i].dTc[d] = block + (size_t)(4 + d) * nn;
        }
        out[i].dN = block + 6 * nn;
    }
    bd_contact_evaluate_many(n, c->element + first, c->x + 3 * n_coef * at, out, share, evaluator);
    for (int i = 0; i < n; ++i) {
        if (c->T) bd_element_write_blocks(c->element + first + i, (int)(n_coef / 2), out + i);
        const bd_status_share s = share[i];
        const double found[5] = {s.stick[0], s.slip[0], s.stick[1], s.slip[1], s.open};
        memcpy(c->share + 5 * (at + (size_t)i), found, sizeof found);
    }
}

static bd_status evaluate_points(const points_call *c) {
    bd_evaluator evaluator;
    const bd_status status = bd_evaluator_create(&evaluator, (bd_evaluation)c->evaluation, (int)(c->n_coef / 2), c->n_time);
    if (status != BD_OK) return status;
    for (npy_intp first = 0; first < c->n_point; first += BD_LANES) {
        const npy_intp left = c->n_point - first;
        evaluate_group(c, first, left < BD_LANES ? (int)left : BD_LANES, &evaluator);
    }
    bd_evaluator_destroy(&evaluator);
    return BD_OK;
}

/* The arguments of evaluate_points(), in their order. */
typedef struct {
    PyObject *x, *kt, *kn, *mu, *n0, *w, *load, *law, *F, *T, *share;
} points_objects;

/* Checks and reads all arrays; the elements are the caller's to free. */
static int read_points(const points_objects *o, points_call *c) {
    if (!PyArray_Check(o->x) || PyArray_NDIM((PyArrayObject *)o->x) != 3 ||
        PyArray_DIM((PyArrayObject *)o->x, 2) % 2 != 1) {
        PyErr_SetString(PyExc_ValueError, "x: expected a numpy array of shape (n_points, 3, 2 n_harm + 1)");
        return 0;
    }
    core_arguments arguments = {0};
    const npy_intp n = c->n_point = PyArray_DIM((PyArrayObject *)o->x, 0), m = PyArray_DIM((PyArrayObject *)o->x, 2);
    const npy_intp motion[3] = {n, 3, m}, pair[2] = {n, 2}, tangent[4] = {n, 7, m, m}, shares[2] = {n, 5};
    c->n_coef = m;
    if (!core_check_n_harm((m - 1) / 2) || !core_check_evaluation(c->evaluation, c->n_time, (int)((m - 1) / 2))) return 0;
    const double *kt, *kn, *mu, *n0, *w, *load;
    const int *law;
    if (!(c->x = core_numbers(&arguments, o->x, "x", 3, motion, BD_FINITE))) return 0;
    if (!(kt = core_numbers(&arguments, o->kt, "kt", 2, pair, BD_FINITE))) return 0;
    if (!(kn = core_numbers(&arguments, o->kn, "kn", 1, &n, BD_NON_NEGATIVE))) return 0;
    if (!(mu = core_numbers(&arguments, o->mu, "mu", 1, &n, BD_NON_NEGATIVE))) return 0;
    if (!(n0 = core_numbers(&arguments, o->n0, "n0", 1, &n, BD_FINITE))) return 0;
    if (!(w = core_doubles(&arguments, o->w, "w", 2, pair, BD_INPUT))) return 0;
    if (!(load = core_numbers(&arguments, o->load, "load", 1, &n, BD_FINITE))) return 0;
    if (!(law = core_array(&arguments, o->law, "law", NPY_INT, "intc", 1, &n, BD_INPUT))) return 0;
    if (!(c->F = core_doubles(&arguments, o->F, "F", 3, motion, BD_OUTPUT))) return 0;
    if (!(c->share = core_doubles(&arguments, o->share, "share", 2, shares, BD_OUTPUT))) return 0;
    if (o->T != Py_None && !(c->T = core_doubles(&arguments, o->T, "T", 4, tangent, BD_OUTPUT))) return 0;
    for (npy_intp p = 0; p < n; ++p)
        if (!core_check_law(law[p], c->evaluation) || !core_check_slider(w + 2 * p, law[p])) return 0;
    if (!(c->element = PyMem_Malloc(sizeof(bd_element) * ((size_t)n + 1)))) {
        PyErr_NoMemory();
        return 0;
    }
    fill_elements(c, kt, kn, mu, n0, w, load, law);
    return 1;
}

PyObject *core_evaluate_points(PyObject *module, PyObject *args, PyObject *kwargs) {
    (void)module;
    static char *names[] = {"x",   "kt", "kn",    "mu", "n0",         "w",      "load",
                            "law", "F",  "share", "T",  "evaluation", "n_time", NULL};
    points_objects o = {.T = Py_None};
    points_call call = {0};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOOOOOO|Oii:evaluate_points", names, &o.x, &o.kt, &o.kn, &o.mu,
                                     &o.n0, &o.w, &o.load, &o.law, &o.F, &o.share, &o.T, &call.evaluation, &call.n_time))
        return NULL;
    if (!core_check_kernel() || !read_points(&o, &call)) return NULL;
    bd_status status;
    Py_BEGIN_ALLOW_THREADS;
    status = evaluate_points(&call);
    Py_END_ALLOW_THREADS;
    PyMem_Free(call.element);
    return core_check_status(status) ? Py_NewRef(Py_None) : NULL;
}
