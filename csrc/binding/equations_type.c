/* Python methods of all types of equations: evaluate, solve, contact, cost.
 *
 * Computation runs without the GIL, under the lock of the object that owns the workspace.
 * Results are copied before the lock is released, so they do not depend on the order of
 * calls. Lack of convergence is a returned status. Exceptions are raised for wrong arguments
 * and lack of memory only. */
#include "util/clock.h"
#include "binding/binding.h"

#include <math.h>
#include <string.h>

/* ---- object, lock and clock ---- */

core_equations *core_equations_new(PyTypeObject *type, core_equations *inner) {
    core_equations *self = (core_equations *)type->tp_alloc(type, 0);
    if (!self) return NULL;
    self->inner = (core_equations *)Py_XNewRef((PyObject *)inner);
    self->lock = inner ? inner->lock : PyThread_allocate_lock();
    if (self->lock) return self;
    PyErr_NoMemory();
    Py_DECREF(self);
    return NULL;
}

void core_equations_dealloc(PyObject *object) {
    core_equations *self = (core_equations *)object;
    PyTypeObject *type = Py_TYPE(self);
    bd_equations_destroy(self->equations);
    if (self->lock && !self->inner) PyThread_free_lock(self->lock);
    Py_XDECREF((PyObject *)self->inner);
    Py_XDECREF(self->point_law);
    type->tp_free(object);
    Py_DECREF(type);
}

/* Processor clock and cost at the start of a computation. */
typedef struct {
    double processor;
    bd_cost cost;
} clocks;

/* Start a computation, without the GIL. */
static clocks begin_work(core_equations *self) {
    PyThread_acquire_lock(self->lock, WAIT_LOCK);
    return (clocks){bd_processor_seconds(), *self->equations->cost};
}

/* End a computation. The wall clock measures the parts, since a reading of the processor
 * clock takes longer than many of them. It also measures the time in which the thread waits.
 * The processor time of the call is therefore divided in proportion to the parts; waiting
 * between them has no effect. */
static void end_work(core_equations *self, clocks started) {
    bd_cost *now = self->equations->cost;
    const bd_cost before = started.cost;
    const double processor = bd_processor_seconds() - started.processor;
    const double contact = now->contact - before.contact,
                 assembly = now->assembly - before.assembly;
    const double algebra = now->algebra - before.algebra, parts = contact + assembly + algebra;

    /* a call without measured parts copies results or solves nothing */
    const double factor = parts > 0.0 ? processor / parts : 0.0;
    now->contact = before.contact + factor * contact;
    now->assembly = before.assembly + (parts > 0.0 ? factor * assembly : processor);
    now->algebra = before.algebra + factor * algebra;
    now->processor += processor;
    PyThread_release_lock(self->lock);
}

/* ---- named results ---- */

static PyStructSequence_Field counts_fields[] = {
    {"contact", "Processor seconds for contact forces."},
    {"assembly", "Processor seconds for modal sums and products."},
    {"algebra", "Processor seconds for linear algebra."},
    {"processor", "Processor seconds of all calls."},
    {"evaluations", "Number of residuals, with or without Jacobian."},
    {"jacobians", "Number of Jacobians."},
    {"factorisations", "Number of factorisations of the bordered matrix."},
    {"least_norm", "Number of least-norm solutions."},
    {"condensed", "Number of factorisations condensed to the motion at the contact points."},
    {NULL, NULL}};
static PyStructSequence_Desc counts_description = {"bdamper._core.Counts",
                                                   "Cost of equations since their creation.",
                                                   counts_fields, 9};

static PyStructSequence_Field solved_fields[] = {
    {"status", "0: converged."},
    {"iterations", NULL},
    {"residual", "Largest scaled residual at the returned point."},
    {"first_step", "Length of the first Newton step, in scaled unknowns."},
    {"last_step", "Length of the last Newton step, in scaled unknowns."},
    {"condition", "Estimate of the reciprocal condition of the last bordered matrix."},
    {"rank", "Rank of this matrix, n_unknown + 1 if it is regular."},
    {"orientation", "Sign of its determinant, 0 if unknown."},
    {"slope", "Quantity that vanishes at a stationary point, at the returned point."},
    {"curvature", "Derivative of this quantity along the curve, from the last secant."},
    {"shares", "Mean shares of the cycle in stick, slip and separation of the points with friction "
               "at the returned "
               "point; NaN without an evaluation."},
    {NULL, NULL}};
static PyStructSequence_Desc solved_description = {"bdamper._core.Solved",
                                                   "Outcome of one run of Newton's method.",
                                                   solved_fields, 11};

static PyTypeObject *add_result(PyObject *module, PyStructSequence_Desc *description) {
    PyTypeObject *type = PyStructSequence_NewType(description);
    if (!type || PyModule_AddType(module, type) == 0) return type;
    Py_DECREF(type);
    return NULL;
}

int core_add_results(PyObject *module, core_state *state) {
    state->counts = add_result(module, &counts_description);
    state->solved = add_result(module, &solved_description);
    return state->counts && state->solved ? 0 : -1;
}

/* Make a struct sequence from a tuple of its fields; takes over the tuple. */
static PyObject *named(PyTypeObject *type, PyObject *tuple) {
    PyObject *result = tuple ? PyStructSequence_New(type) : NULL;
    for (Py_ssize_t i = 0; result && i < PyTuple_GET_SIZE(tuple); ++i)
        PyStructSequence_SetItem(result, i, Py_NewRef(PyTuple_GET_ITEM(tuple, i)));
    Py_XDECREF(tuple);
    return result;
}

/* Contact points at the latest evaluation. */
typedef struct {
    int n_point, n_coef;
    const bd_element *element;
    const bd_status_share *share;
    const double *X, *F;
} points;

/* Contact points, motions and forces of the latest evaluation: those of all sectors of a disk, or of
 * one sector. */
static points points_of(const core_equations *self) {
    const bd_hbm *sector = self->hbm;
    const bd_wheel *wheel = self->wheel;
    if (wheel)
        return (points){.n_point = wheel->input.n_sector * wheel->input.n_point,
                        .n_coef = wheel->n_coef,
                        .element = wheel->element,
                        .share = wheel->share,
                        .X = wheel->X,
                        .F = wheel->F};
    return (points){.n_point = sector->n_point,
                    .n_coef = sector->n_coef,
                    .element = sector->element,
                    .share = sector->share,
                    .X = sector->X,
                    .F = sector->F};
}

/* Mean stick, slip and open shares of the points with friction at the latest
 * evaluation; NaN if it failed. */
static void mean_shares(const core_equations *self, double *mean) {
    const points at = points_of(self);
    int n_friction = 0; /* points with friction; a bonded point counts, because it sticks */
    mean[0] = mean[1] = mean[2] = self->equations->stage == BD_EMPTY ? NAN : 0.0;
    for (int p = 0; p < at.n_point; ++p) {
        const bd_law law = at.element[p].law;
        const int has_friction = at.element[p].mu != 0.0 || law == BD_LAW_BONDED;
        if (law == BD_LAW_NORMAL || !has_friction) continue;
        /* mean over both tangential directions */
        const bd_status_share share = at.share[p];
        mean[0] += 0.5 * (share.stick[0] + share.stick[1]);
        mean[1] += 0.5 * (share.slip[0] + share.slip[1]);
        mean[2] += share.open;
        ++n_friction;
    }
    for (int i = 0; n_friction > 0 && i < 3; ++i) mean[i] /= n_friction;
}

/* ---- methods ---- */

/* Fill J (n, n) with products with unit vectors, for equations without a stored J. */
static bd_status fill_jacobian(bd_equations *e, double *J) {
    const size_t n = (size_t)e->n;
    double *unit = e->scratch, *column = unit + n + 1;
    bd_status status = BD_OK;
    memset(unit, 0, sizeof(double) * n);
    for (size_t j = 0; j < n && status == BD_OK; ++j) {
        unit[j] = 1.0;
        status = bd_product(e, 0, unit, column);
        unit[j] = 0.0;
        for (size_t i = 0; i < n; ++i) J[i * n + j] = column[i];
    }
    return status;
}

/* evaluate(y, r, J=None, C=None) -> status: residual r (n) at y (n + 1), the unknowns and the
 * parameter, and on request its derivatives J (n, n) and C (n). Outputs are written only if the
 * status is BD_OK. */
static PyObject *evaluate(core_equations *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"y", "r", "J", "C", NULL};
    PyObject *y_object, *r_object, *J_object = Py_None, *C_object = Py_None;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OO|OO:evaluate", names, &y_object, &r_object,
                                     &J_object, &C_object))
        return NULL;
    core_arguments arguments = {0};
    bd_equations *e = self->equations;
    const npy_intp n = e->n, n1 = n + 1, square[2] = {n, n};
    double *y, *r, *J = NULL, *C = NULL;
    if (!(y = core_vector(&arguments, y_object, "y", n1, BD_INPUT))) return NULL;
    if (!(r = core_vector(&arguments, r_object, "r", n, BD_OUTPUT))) return NULL;
    if (J_object != Py_None && !(J = core_doubles(&arguments, J_object, "J", 2, square, BD_OUTPUT)))
        return NULL;
    if (C_object != Py_None && !(C = core_vector(&arguments, C_object, "C", n, BD_OUTPUT)))
        return NULL;
    bd_status status;
    Py_BEGIN_ALLOW_THREADS;
    const clocks started = begin_work(self);
    status = bd_evaluate(e, y, J || C);
    if (status == BD_OK) {
        memcpy(r, e->r, sizeof(double) * (size_t)n);
        if (J && e->J) memcpy(J, e->J, sizeof(double) * (size_t)(n * n));
        if (J && !e->J) status = fill_jacobian(e, J);
        if (C) memcpy(C, e->C, sizeof(double) * (size_t)n);
    }
    end_work(self, started);
    Py_END_ALLOW_THREADS;
    return PyLong_FromLong(status);
}

/* Read the condition: a row makes it linear, re and im a peak, none of them a fold. */
static int read_condition(core_arguments *arguments, PyObject *row, PyObject *re, PyObject *im,
                          const double *tangent, npy_intp n, bd_condition *condition) {
    const npy_intp n1 = n + 1;
    const int has_row = row != Py_None, has_re = re != Py_None, has_im = im != Py_None;
    if (has_re != has_im || (has_row && has_re)) {
        PyErr_SetString(PyExc_ValueError,
                        "row, re, im: expected row alone, re and im, or none of them");
        return 0;
    }
    if (has_row) {
        condition->kind = BD_LINEAR;
        condition->row = core_numbers(arguments, row, "row", 1, &n1, BD_FINITE);
        return condition->row != NULL;
    }
    condition->kind = BD_STATIONARY;
    if (has_re) {
        condition->re = core_numbers(arguments, re, "re", 1, &n, BD_FINITE);
        if (!condition->re) return 0;
        condition->im = core_numbers(arguments, im, "im", 1, &n, BD_FINITE);
        if (!condition->im) return 0;
    }
    /* the slope of the amplitude decreases through a peak */
    const core_range sign = condition->re ? BD_NEGATIVE : BD_FINITE;
    if (!core_check_numbers(tangent, n1, "tangent", BD_FINITE)) return 0;
    if (!core_check_number(condition->curvature, "curvature", sign)) return 0;
    if (!core_check_number(condition->tolerance, "place_tolerance", BD_POSITIVE)) return 0;
    return core_check_number(condition->max_step, "max_step", BD_POSITIVE);
}

/* Return whether the options of the solver are in their ranges; otherwise raise an exception with
 * their names in Python. */
static int check_options(const bd_solver_options *options) {
    if (options->max_iterations < 0) {
        PyErr_Format(PyExc_ValueError, "max_iterations: expected at least 0, found %d",
                     options->max_iterations);
        return 0;
    }
    if (options->line_search < 0 || options->line_search > 2) {
        PyErr_Format(PyExc_ValueError, "line_search: expected 0, 1 or 2, found %d",
                     options->line_search);
        return 0;
    }
    if (!core_check_number(options->step_tolerance, "loose", BD_NON_NEGATIVE)) return 0;
    if (!core_check_number(options->accepted_residual, "rough", BD_NON_NEGATIVE)) return 0;
    if (!core_check_number(options->tolerance, "tolerance", BD_POSITIVE)) return 0;
    return core_check_number(options->max_newton_step, "reach", BD_NON_NEGATIVE);
}

/* solve(y, tangent, scale, ...): Newton's method in one call without the GIL. The point y and the
 * tangent (n + 1 each) are overwritten; the result is a named tuple with status and counts. */
static PyObject *solve(core_equations *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {
        "y",        "tangent", "scale", "tolerance", "max_iterations", "line_search",
        "reach",    "row",     "re",    "im",        "curvature",      "place_tolerance",
        "max_step", "loose",   "rough", NULL};
    PyObject *y_object, *tangent_object, *scale_object;
    PyObject *row = Py_None, *re = Py_None, *im = Py_None;
    bd_solver_options options = {0};
    bd_condition condition = {0};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOdi|idOOOddddd:solve", names, &y_object,
                                     &tangent_object, &scale_object, &options.tolerance,
                                     &options.max_iterations, &options.line_search,
                                     &options.max_newton_step, &row, &re, &im, &condition.curvature,
                                     &condition.tolerance, &condition.max_step,
                                     &options.step_tolerance, &options.accepted_residual))
        return NULL;
    core_arguments arguments = {0};
    const npy_intp n = self->equations->n, n1 = n + 1;
    double *y, *tangent, *scale;
    y = core_vector(&arguments, y_object, "y", n1, BD_OUTPUT);
    if (!y) return NULL;
    tangent = core_vector(&arguments, tangent_object, "tangent", n1, BD_OUTPUT);
    if (!tangent) return NULL;
    scale = core_numbers(&arguments, scale_object, "scale", 1, &n1, BD_POSITIVE);
    if (!scale) return NULL;
    if (!check_options(&options) ||
        !read_condition(&arguments, row, re, im, tangent, n, &condition))
        return NULL;
    bd_solver_report report;
    bd_status status;
    double mean[3]; /* stick, slip, open */
    Py_BEGIN_ALLOW_THREADS;
    const clocks started = begin_work(self);
    status = bd_solve(self->equations, &condition, &options, scale, y, tangent, &report);
    mean_shares(self, mean);
    end_work(self, started);
    Py_END_ALLOW_THREADS;
    const core_state *state = PyType_GetModuleState(Py_TYPE(self));
    const bd_factored *factored = &report.factored;
    /* the order of solved_fields */
    PyObject *values = Py_BuildValue("iiddddiidd(ddd)", (int)status, report.iterations,
                                     report.residual, report.first_step, report.last_step,
                                     factored->condition, factored->rank, factored->orientation,
                                     report.slope, report.curvature, mean[0], mean[1], mean[2]);
    return named(state->solved, values);
}

/* Solve B x = b or B^T x = b in place for m right-hand sides b (m, n + 1), where B is the Jacobian
 * [J C] at y with the row below it, in scaled unknowns. */
static PyObject *bordered(core_equations *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"y", "row", "scale", "b", "transposed", NULL};
    PyObject *y_object, *row_object, *scale_object, *b_object;
    int transposed = 0;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOO|p:bordered", names, &y_object, &row_object,
                                     &scale_object, &b_object, &transposed))
        return NULL;
    core_arguments arguments = {0};
    const npy_intp n1 = self->equations->n + 1;
    double *y, *row, *scale, *b;
    y = core_vector(&arguments, y_object, "y", n1, BD_INPUT);
    if (!y) return NULL;
    row = core_numbers(&arguments, row_object, "row", 1, &n1, BD_FINITE);
    if (!row) return NULL;
    scale = core_numbers(&arguments, scale_object, "scale", 1, &n1, BD_POSITIVE);
    if (!scale) return NULL;
    if (!PyArray_Check(b_object) || PyArray_NDIM((PyArrayObject *)b_object) != 2) {
        PyErr_SetString(PyExc_TypeError, "b: expected a two-dimensional numpy array");
        return NULL;
    }
    const npy_intp n_side = PyArray_DIM((PyArrayObject *)b_object, 0), shape[2] = {n_side, n1};
    b = core_doubles(&arguments, b_object, "b", 2, shape, BD_OUTPUT);
    if (!b) return NULL;
    bd_status status;
    bd_factored factored;
    Py_BEGIN_ALLOW_THREADS;
    const clocks started = begin_work(self);
    bd_equations *e = self->equations;
    status = bd_evaluate(e, y, 1);
    if (status == BD_OK) status = bd_factor(e, &(bd_border){.row = row, .scale = scale});
    for (npy_intp i = 0; status == BD_OK && i < n_side; ++i) {
        double *side = b + i * n1;
        status = transposed ? bd_solve_transposed(e, side) : bd_solve_linear(e, 0.0, side);
    }
    factored = e->factored;
    end_work(self, started);
    Py_END_ALLOW_THREADS;
    return Py_BuildValue("idii", (int)status, factored.condition, factored.rank,
                         factored.orientation);
}

/* Gradient of phi, the quantity that vanishes at a peak (with re and im) or at a fold. */
static PyObject *gradient(core_equations *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"y", "tangent", "scale", "row", "nu", "step", "re", "im", NULL};
    PyObject *y_object, *tangent_object, *scale_object, *row_object, *nu_object;
    PyObject *re = Py_None, *im = Py_None;
    double step;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOd|OO:gradient", names, &y_object,
                                     &tangent_object, &scale_object, &row_object, &nu_object, &step,
                                     &re, &im))
        return NULL;
    core_arguments arguments = {0};
    /* read_condition checks these numbers, which only a search for the point needs */
    bd_condition condition = {.curvature = -1.0, .tolerance = 1.0, .max_step = 1.0};
    const npy_intp n = self->equations->n, n1 = n + 1;
    double *y, *tangent, *scale, *row, *nu;
    y = core_vector(&arguments, y_object, "y", n1, BD_INPUT);
    if (!y) return NULL;
    tangent = core_vector(&arguments, tangent_object, "tangent", n1, BD_INPUT);
    if (!tangent) return NULL;
    scale = core_numbers(&arguments, scale_object, "scale", 1, &n1, BD_POSITIVE);
    if (!scale) return NULL;
    row = core_vector(&arguments, row_object, "row", n1, BD_OUTPUT);
    if (!row) return NULL;
    nu = core_vector(&arguments, nu_object, "nu", n, BD_OUTPUT);
    if (!nu) return NULL;
    if (!core_check_number(step, "step", BD_POSITIVE) ||
        !read_condition(&arguments, Py_None, re, im, tangent, n, &condition))
        return NULL;
    bd_status status;
    Py_BEGIN_ALLOW_THREADS;
    const clocks started = begin_work(self);
    status = bd_gradient(self->equations, &condition, scale, y, tangent, step, row, nu);
    end_work(self, started);
    Py_END_ALLOW_THREADS;
    return PyLong_FromLong(status);
}

/* Copy the shares of the cycle to (n_point, 5): stick and slip along t1 and along t2, open. */
static void copy_shares(const points *at, double *share) {
    for (int p = 0; p < at->n_point; ++p) {
        const bd_status_share s = at->share[p];
        const double row[5] = {s.stick[0], s.slip[0], s.stick[1], s.slip[1], s.open};
        memcpy(share + 5 * (size_t)p, row, sizeof row);
    }
}

/* Motion, force and state shares of all points at y. */
static PyObject *contact(core_equations *self, PyObject *args) {
    PyObject *y_object, *X_object, *F_object, *share_object;
    if (!PyArg_ParseTuple(args, "OOOO:contact", &y_object, &X_object, &F_object, &share_object))
        return NULL;
    core_arguments arguments = {0};
    const points at = points_of(self);
    const npy_intp n1 = self->equations->n + 1;
    const npy_intp motion_shape[3] = {at.n_point, 3, at.n_coef}, share_shape[2] = {at.n_point, 5};
    double *y, *X, *F, *share;
    y = core_vector(&arguments, y_object, "y", n1, BD_INPUT);
    if (!y) return NULL;
    X = core_doubles(&arguments, X_object, "X", 3, motion_shape, BD_OUTPUT);
    if (!X) return NULL;
    F = core_doubles(&arguments, F_object, "F", 3, motion_shape, BD_OUTPUT);
    if (!F) return NULL;
    share = core_doubles(&arguments, share_object, "share", 2, share_shape, BD_OUTPUT);
    if (!share) return NULL;
    bd_status status;
    Py_BEGIN_ALLOW_THREADS;
    const clocks started = begin_work(self);
    status = bd_evaluate(self->equations, y, 0);
    const size_t n_point = (size_t)at.n_point, size = 3 * n_point * (size_t)at.n_coef;
    if (status == BD_OK) {
        memcpy(X, at.X, sizeof(double) * size);
        memcpy(F, at.F, sizeof(double) * size);
        copy_shares(&at, share);
    } else {
        for (size_t i = 0; i < size; ++i) X[i] = F[i] = NAN;
        for (size_t i = 0; i < 5 * n_point; ++i) share[i] = NAN;
    }
    end_work(self, started);
    Py_END_ALLOW_THREADS;
    return PyLong_FromLong(status);
}

static PyObject *get_cost(core_equations *self, void *closure) {
    (void)closure;
    bd_cost c;
    Py_BEGIN_ALLOW_THREADS;
    PyThread_acquire_lock(self->lock, WAIT_LOCK);
    c = *self->equations->cost;
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS;
    const core_state *state = PyType_GetModuleState(Py_TYPE(self));
    return named(state->counts, Py_BuildValue("ddddlllll", c.contact, c.assembly, c.algebra,
                                              c.processor, c.n_evaluation, c.n_jacobian,
                                              c.n_factorisation, c.n_least_norm, c.n_condensed));
}

static PyObject *get_n_unknown(core_equations *self, void *closure) {
    (void)closure;
    return PyLong_FromLong(self->equations->n);
}

PyMethodDef core_equations_methods[] = {
    {"evaluate", (PyCFunction)(void (*)(void))evaluate, METH_VARARGS | METH_KEYWORDS,
     "evaluate(y, r, J=None, C=None) -> int\n\n"
     "Write the residual r (n_unknown) at y and, unless None, its derivatives J (n_unknown, "
     "n_unknown) with respect to the unknowns and C (n_unknown) with respect to the parameter. "
     "Return the status."},
    {"solve", (PyCFunction)(void (*)(void))solve, METH_VARARGS | METH_KEYWORDS,
     "solve(y, tangent, scale, tolerance, max_iterations, line_search=0, reach=0.0, row=None, "
     "re=None, im=None, "
     "curvature=0.0, place_tolerance=0.0, max_step=0.0, loose=0.0, rough=0.0) -> Solved\n\n"
     "Run Newton's method; y and tangent are changed in place.\n\n"
     "With row (n_unknown + 1), solve for a point of the curve in the plane through y normal to "
     "row, in scaled "
     "unknowns. A Newton step longer than reach ends the run, unless reach is 0. A full step "
     "shorter than loose "
     "is the last one; if rough is not 0, the residual must then be at most rough. line_search 1 "
     "halves steps "
     "until the residual decreases, 2 until the next step is shorter.\n\n"
     "With re and im (n_unknown), solve for a peak of the amplitude re.u + i im.u; without row, re "
     "and im for a "
     "fold of the curve. tangent and curvature are then estimates of the direction of the curve "
     "and of the "
     "derivative of the vanishing quantity along it. place_tolerance is the tolerance on the "
     "distance to the "
     "point, max_step the largest step along the curve."},
    {"bordered", (PyCFunction)(void (*)(void))bordered, METH_VARARGS | METH_KEYWORDS,
     "bordered(y, row, scale, b, transposed=False) -> (status, condition, rank, orientation)\n\n"
     "Solve with the Jacobian at y in scaled unknowns, bordered by row, or with its transpose. The "
     "right-hand "
     "sides b (m, n_unknown + 1) are replaced by the solutions."},
    {"gradient", (PyCFunction)(void (*)(void))gradient, METH_VARARGS | METH_KEYWORDS,
     "gradient(y, tangent, scale, row, nu, step, re=None, im=None) -> int\n\n"
     "Compute the gradient of phi at a point of the curve with its unit tangent. phi is the slope "
     "of the "
     "logarithm of the amplitude |re.u + i im.u| along the curve, which vanishes at a peak; "
     "without re and im, "
     "it is the quantity that vanishes at a fold. row (n_unknown + 1) is the gradient in scaled "
     "unknowns. nu "
     "(n_unknown) are multipliers: a change of [J C] changes phi by -nu.d[J C](scale tangent). "
     "Jacobians are "
     "differenced over step along the tangent. Return the status."},
    {"contact", (PyCFunction)contact, METH_VARARGS,
     "contact(y, X, F, share) -> int\n\nFill motion and force (n_point, 3, n_coef) and the shares "
     "of the cycle "
     "(n_point, 5): stick and slip along t1, stick and slip along t2, open; NaN where the status "
     "is not 0."},
    {NULL, NULL, 0, NULL}};

PyGetSetDef core_equations_getset[] = {
    {"cost", (getter)get_cost, NULL,
     "Counts: processor seconds and numbers of operations since creation.", NULL},
    {"n_unknown", (getter)get_n_unknown, NULL, "Number of unknowns without the parameter.", NULL},
    {NULL, NULL, NULL, NULL, NULL}};
