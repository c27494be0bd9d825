/* bdamper._core: one contact point, for tests and teaching; steps of user laws. */
#include "binding/binding.h"

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

/* Copy a block (n_coef, n_coef), the derivative of a force component with respect to a motion
 * component, into the dense tangent J (3, n_coef, 3, n_coef). */
static void copy_block(const double *block, int force, int motion, npy_intp n_coef, double *J) {
    for (npy_intp i = 0; i < n_coef; ++i) {
        double *row = J + ((force * n_coef + i) * 3 + motion) * n_coef;
        for (npy_intp j = 0; j < n_coef; ++j) row[j] = block[i * n_coef + j];
    }
}

/* One point and the arrays of its results. */
typedef struct {
    bd_element element;
    int evaluation, n_time, n_harm;
    npy_intp n_coef;
    double *x, *F, *J;
    bd_point_law *point_law;
} contact_call;

/* Read motion and parameters; F and J are outputs. */
static int read_call(PyObject *args, PyObject *kwargs, contact_call *c) {
    static char *names[] = {"x", "kt",  "kn",         "mu",     "n0",   "w",   "F",
                            "J", "law", "evaluation", "n_time", "load", "own", NULL};
    PyObject *x, *kt_object, *w_object, *F, *J, *point_law = Py_None;
    bd_element *e = &c->element;
    int law = 0;
    e->load = NAN;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOdddOOO|iiidO:evaluate_contact", names, &x,
                                     &kt_object, &e->kn, &e->mu, &e->n0, &w_object, &F, &J, &law,
                                     &c->evaluation, &c->n_time, &e->load, &point_law))
        return 0;
    int good_x = PyArray_Check(x) && PyArray_NDIM((PyArrayObject *)x) == 2;
    if (good_x) {
        const npy_intp n_row = PyArray_DIM((PyArrayObject *)x, 0);
        const npy_intp n_column = PyArray_DIM((PyArrayObject *)x, 1);
        good_x = n_row == 3 && n_column % 2 == 1;
    }
    if (!good_x) {
        PyErr_SetString(PyExc_ValueError, "x: expected a numpy array of shape (3, 2 n_harm + 1)");
        return 0;
    }
    const npy_intp n = PyArray_DIM((PyArrayObject *)x, 1);
    c->n_coef = n;
    if (!core_check_n_harm((n - 1) / 2)) return 0;
    c->n_harm = (int)((n - 1) / 2);

    core_arguments arguments = {0};
    const npy_intp shape[2] = {3, n}, shape_J[4] = {3, n, 3, n}, two = 2;
    const double *kt, *w;
    if (!(c->x = core_numbers(&arguments, x, "x", 2, shape, BD_FINITE))) return 0;
    kt = core_numbers(&arguments, kt_object, "kt", 1, &two,
                      law == BD_LAW_CUBIC ? BD_FINITE : BD_NON_NEGATIVE);
    if (!kt) return 0;
    if (!(w = core_vector(&arguments, w_object, "w", two, BD_INPUT))) return 0;
    if (!(c->F = core_doubles(&arguments, F, "F", 2, shape, BD_OUTPUT))) return 0;
    if (!(c->J = core_doubles(&arguments, J, "J", 4, shape_J, BD_OUTPUT))) return 0;
    if (!core_check_evaluation(c->evaluation, c->n_time, c->n_harm)) return 0;
    if (!core_point_laws(point_law, 1, &c->point_law)) return 0;

    /* the exact evaluation refuses user laws */
    const int is_user_law = law == BD_LAW_USER && c->evaluation != BD_EXACT;
    if (!is_user_law && !core_check_law(law, c->evaluation)) return 0;
    if (!core_check_point_laws(&law, c->point_law, 1)) return 0;
    if (isnan(e->load)) e->load = e->n0;
    if (!core_check_number(e->kn, "kn", BD_NON_NEGATIVE)) return 0;
    if (!core_check_number(e->mu, "mu", BD_NON_NEGATIVE)) return 0;
    if (!core_check_number(e->n0, "n0", BD_FINITE)) return 0;
    if (!core_check_number(e->load, "load", BD_FINITE)) return 0;
    if (!core_check_slider(w, law)) return 0;
    e->point_law = c->point_law;
    e->law = (bd_law)law;
    memcpy(e->kt, kt, sizeof e->kt);
    memcpy(e->w, w, sizeof e->w);
    return 1;
}

/* Force and dense tangent, with memory (9, n_coef, n_coef) for the blocks of the contact laws. */
static void evaluate(const contact_call *c, double *block, bd_status_share *share,
                     bd_evaluator *evaluator) {
    const size_t nn = (size_t)(c->n_coef * c->n_coef);
    bd_response out = {.F = c->F,
                       .dT = {block, block + nn},
                       .dTv = {block + 2 * nn, block + 3 * nn},
                       .dTc = {block + 4 * nn, block + 5 * nn},
                       .dN = block + 6 * nn,
                       .dNt = {block + 7 * nn, block + 8 * nn}};
    bd_contact_evaluate(&c->element, c->x, &out, share, evaluator);
    bd_element_write_blocks(&c->element, c->n_harm, &out);
    memset(c->J, 0, sizeof(double) * 9 * nn);
    for (int d = 0; d < 2; ++d) {
        copy_block(out.dT[d], d, d, c->n_coef, c->J);
        copy_block(out.dTv[d], d, 2, c->n_coef, c->J);
        copy_block(out.dTc[d], d, 1 - d, c->n_coef, c->J);
        copy_block(out.dNt[d], 2, d, c->n_coef, c->J);
    }
    copy_block(out.dN, 2, 2, c->n_coef, c->J);
}

PyObject *core_evaluate_contact(PyObject *module, PyObject *args, PyObject *kwargs) {
    (void)module;
    contact_call call = {0};
    bd_evaluator evaluator;
    bd_status_share share;
    PyObject *result = NULL;
    double *block = NULL;
    memset(&evaluator, 0, sizeof evaluator);
    if (!core_check_kernel() || !read_call(args, kwargs, &call)) goto done;
    if (!core_check_status(bd_evaluator_create(&evaluator, (bd_evaluation)call.evaluation,
                                               call.n_harm, call.n_time)) ||
        !core_check_status(bd_evaluator_add_laws(&evaluator, 1, call.point_law)))
        goto done;
    block = PyMem_Malloc(sizeof(double) * 9 * (size_t)(call.n_coef * call.n_coef));
    if (!block) {
        PyErr_NoMemory();
        goto done;
    }
    evaluate(&call, block, &share, &evaluator);
    PyObject *first = segment_list(&evaluator, 0), *second = segment_list(&evaluator, 1);
    if (first && second)
        result = Py_BuildValue("(ddddd)(OO)", share.stick[0], share.slip[0], share.stick[1],
                               share.slip[1], share.open, first, second);
    Py_XDECREF(first);
    Py_XDECREF(second);
done:
    PyMem_Free(block);
    PyMem_Free(call.point_law);
    bd_evaluator_destroy(&evaluator);
    return result;
}

PyObject *core_check_laws(PyObject *module, PyObject *laws) {
    (void)module;
    bd_point_law *point_law;
    if (!PyTuple_Check(laws)) {
        PyErr_SetString(PyExc_TypeError, "own: expected a tuple of laws");
        return NULL;
    }
    if (!core_point_laws(laws, PyTuple_GET_SIZE(laws), &point_law)) return NULL;
    PyMem_Free(point_law);
    return Py_NewRef(Py_None);
}

/* Largest number of states of the laws. */
static int most_states(const bd_point_law *law, npy_intp n) {
    int most = 0;
    for (npy_intp p = 0; p < n; ++p)
        if (law[p].function && law[p].n_state > most) most = law[p].n_state;
    return most;
}

PyObject *core_step_laws(PyObject *module, PyObject *args) {
    (void)module;
    PyObject *own_object, *x_object, *from_object, *to_object, *F_object, *D_object;
    if (!PyArg_ParseTuple(args, "OOOOOO:step_laws", &own_object, &x_object, &from_object,
                          &to_object, &F_object, &D_object))
        return NULL;
    if (!PyArray_Check(from_object) || PyArray_NDIM((PyArrayObject *)from_object) != 2) {
        PyErr_SetString(PyExc_TypeError, "memory: expected a numpy array of two dimensions");
        return NULL;
    }
    core_arguments arguments = {0};
    const npy_intp n = PyArray_DIM((PyArrayObject *)from_object, 0);
    const npy_intp width = PyArray_DIM((PyArrayObject *)from_object, 1);
    const npy_intp by_x[2] = {n, 3}, by_memory[2] = {n, width}, by_D[3] = {n, 3, 3};
    double *x, *from, *to, *F, *D, *work = NULL;
    bd_point_law *law = NULL;
    if (!(x = core_numbers(&arguments, x_object, "x", 2, by_x, BD_FINITE))) return NULL;
    if (!(from = core_numbers(&arguments, from_object, "memory", 2, by_memory, BD_FINITE)))
        return NULL;
    if (!(to = core_doubles(&arguments, to_object, "after", 2, by_memory, BD_OUTPUT))) return NULL;
    if (!(F = core_doubles(&arguments, F_object, "F", 2, by_x, BD_OUTPUT))) return NULL;
    if (!(D = core_doubles(&arguments, D_object, "D", 3, by_D, BD_OUTPUT))) return NULL;
    if (!core_point_laws(own_object, n, &law)) return NULL;

    const int n_state = law ? most_states(law, n) : 0;
    if (n_state + 3 > width) {
        PyErr_Format(PyExc_ValueError, "memory: expected %d columns, found %zd", n_state + 3,
                     (Py_ssize_t)width);
    } else {
        work = PyMem_Malloc(sizeof(double) * bd_point_law_work_size(n_state));
        if (!work) PyErr_NoMemory();
    }
    for (npy_intp p = 0; work && law && p < n; ++p) {
        if (!law[p].function) continue;
        bd_point_law_derivatives derivatives = bd_point_law_derivatives_in(work, law[p].n_state);
        bd_point_law_step(law + p, x + 3 * p, from + width * p, to + width * p, F + 3 * p,
                          &derivatives);
        bd_point_law_tangent(law + p, &derivatives, D + 9 * p);
    }
    const int is_done = work != NULL;
    PyMem_Free(work);
    PyMem_Free(law);
    return is_done ? Py_NewRef(Py_None) : NULL;
}

/* ---- shipped laws ---- */

#define SIGNATURE                                                                                  \
    "void (double *, double *, double *, double *, double *, double *, double *, double *, "       \
    "double *, double *, void *)"

int core_add_laws(PyObject *module) {
    const struct {
        const char *name;
        bd_user_law function;
    } law[] = {{"jenkins", bd_law_jenkins}, {"bouc_wen", bd_law_bouc_wen}};
    for (size_t i = 0; i < sizeof law / sizeof *law; ++i) {
        void *pointer;
        memcpy(&pointer, &law[i].function, sizeof pointer);
        PyObject *capsule = PyCapsule_New(pointer, SIGNATURE, NULL);
        const int failed = capsule ? PyModule_AddObjectRef(module, law[i].name, capsule) : -1;
        Py_XDECREF(capsule);
        if (failed) return -1;
    }
    return 0;
}
