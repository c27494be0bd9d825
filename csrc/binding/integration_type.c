/* bdamper._core.TimeIntegration: time integration of all sectors of one structure.
 *
 * As in equations_type.c, computation runs without the GIL, under the lock of the object that owns
 * the workspace. */
#include "binding/binding.h"
#include "util/clock.h"

#include <math.h>
#include <pythread.h>

typedef struct {
    PyObject_HEAD bd_time time;
    PyThread_type_lock lock;
    PyObject *point_law; /* owner of the user laws' memory */
} TimeIntegrationObject;

static void TimeIntegration_dealloc(TimeIntegrationObject *self) {
    PyTypeObject *type = Py_TYPE(self);
    bd_time_destroy(&self->time);
    if (self->lock) PyThread_free_lock(self->lock);
    Py_XDECREF(self->point_law);
    type->tp_free((PyObject *)self);
    Py_DECREF(type);
}

/* Arguments of TimeIntegration(), in order. */
typedef struct {
    PyObject *n_mode, *diameter, *stiffness, *mass, *damping, *G, *kt, *kn, *mu, *n0, *load, *shift,
        *law, *held, *order, *force, *row, *point_law;
} ring_objects;

/* First dimension of an array, at most `most`; -1 with an exception. */
static npy_intp length(PyObject *object, const char *name, npy_intp most) {
    if (!PyArray_Check(object) || PyArray_NDIM((PyArrayObject *)object) < 1) {
        PyErr_Format(PyExc_TypeError, "%s: expected a numpy array of at least one dimension", name);
        return -1;
    }
    const npy_intp n = PyArray_DIM((PyArrayObject *)object, 0);
    if (n <= most) return n;
    PyErr_Format(PyExc_ValueError, "%s: expected at most %zd, found %zd", name, (Py_ssize_t)most,
                 (Py_ssize_t)n);
    return -1;
}

/* Data of an array of whole numbers from 0 to most, or NULL with an exception. */
static int *integers(core_arguments *arguments, PyObject *object, const char *name, int n_dim,
                     const npy_intp *shape, int most) {
    npy_intp n = 1;
    for (int i = 0; i < n_dim; ++i) n *= shape[i];
    int *x = core_array(arguments, object, name, NPY_INT, "intc", n_dim, shape, BD_INPUT);
    if (!x) return NULL;
    for (npy_intp i = 0; i < n; ++i) {
        if (x[i] >= 0 && x[i] <= most) continue;
        PyErr_Format(PyExc_ValueError, "%s: expected 0 to %d, found %d at flat index %zd", name,
                     most, x[i], (Py_ssize_t)i);
        return NULL;
    }
    return x;
}

/* Read modes, excitation and responses. Return 0 with an exception. With n modes of all families,
 *
 *     n_mode, diameter           (n_family)         modes and nodal diameter of a family
 *     stiffness, mass, damping   (n)                modal
 *     G                          (3 n_point n)      complex contact modes of one family after the
 *                                                   other, each (n_point, 3, n_mode)
 *     order, force               (n_force), (n_force, 2, 2 n)   engine orders; cosine and sine
 *     row                        (n_row, 2 n)       responses.
 *
 * The 2 n coordinates are the real parts of all modes, then the imaginary parts. */
static int read_families(core_arguments *arguments, const ring_objects *o, bd_time_input *in) {
    const npy_intp n_family = length(o->n_mode, "n_mode", BD_MAX_HARM + 1);
    const npy_intp n_point = length(o->kn, "kn", 1000000);
    if (n_family < 0 || n_point < 0) return 0;
    in->n_family = (int)n_family;
    in->n_point = (int)n_point;
    in->n_mode = integers(arguments, o->n_mode, "n_mode", 1, &n_family, 100000);
    if (!in->n_mode) return 0;
    in->diameter = integers(arguments, o->diameter, "diameter", 1, &n_family, in->n_sector - 1);
    if (!in->diameter) return 0;
    npy_intp n = 0; /* modes of all families */
    for (npy_intp f = 0; f < n_family; ++f) n += in->n_mode[f];
    if (n < 1 || n > 100000) {
        PyErr_Format(PyExc_ValueError, "n_mode: expected a total of 1 to 100000 modes, found %zd",
                     (Py_ssize_t)n);
        return 0;
    }
    const npy_intp n_row = length(o->row, "row", 100000);
    if (n_row < 0) return 0;
    in->n_row = (int)n_row;
    in->stiffness = core_numbers(arguments, o->stiffness, "stiffness", 1, &n, BD_NON_NEGATIVE);
    if (!in->stiffness) return 0;
    in->mass = core_numbers(arguments, o->mass, "mass", 1, &n, BD_NON_NEGATIVE);
    if (!in->mass) return 0;
    in->damping = core_numbers(arguments, o->damping, "damping", 1, &n, BD_NON_NEGATIVE);
    if (!in->damping) return 0;
    const npy_intp n_G = 3 * n_point * n;
    in->G = core_array(arguments, o->G, "G", NPY_CDOUBLE, "complex128", 1, &n_G, BD_INPUT);
    if (!in->G || !core_check_numbers(in->G, 2 * n_G, "G", BD_FINITE)) return 0;

    const npy_intp n_force = length(o->order, "order", BD_MAX_HARM + 1);
    if (n_force < 0) return 0;
    in->n_force = (int)n_force;
    const npy_intp by_force[3] = {n_force, 2, 2 * n}, by_row[2] = {n_row, 2 * n};
    in->force_order = integers(arguments, o->order, "order", 1, &n_force, BD_MAX_HARM);
    if (!in->force_order) return 0;
    in->excitation = core_numbers(arguments, o->force, "force", 3, by_force, BD_FINITE);
    if (!in->excitation) return 0;
    in->response_row = core_numbers(arguments, o->row, "row", 2, by_row, BD_FINITE);
    return in->response_row != NULL;
}

/* Read the parameters of the contact points. Return 0 with an exception. Arrays with two columns
 * refer to the tangential directions, arrays with three also to the normal direction. */
static int read_points(core_arguments *arguments, const ring_objects *o, bd_time_input *in) {
    const npy_intp n = in->n_point, by2[2] = {n, 2}, by3[2] = {n, 3};
    if (!(in->kt = core_numbers(arguments, o->kt, "kt", 2, by2, BD_FINITE))) return 0;
    if (!(in->kn = core_numbers(arguments, o->kn, "kn", 1, &n, BD_NON_NEGATIVE))) return 0;
    if (!(in->mu = core_numbers(arguments, o->mu, "mu", 1, &n, BD_NON_NEGATIVE))) return 0;
    if (!(in->n0 = core_numbers(arguments, o->n0, "n0", 1, &n, BD_FINITE))) return 0;
    if (!(in->load = core_numbers(arguments, o->load, "load", 1, &n, BD_FINITE))) return 0;
    if (!(in->shift = core_numbers(arguments, o->shift, "shift", 2, by3, BD_FINITE))) return 0;
    if (!(in->law = integers(arguments, o->law, "law", 1, &n, BD_N_LAW - 1))) return 0;
    return (in->fixed_slider = integers(arguments, o->held, "held", 2, by2, 1)) != NULL;
}

/* Object with a copy of the input, and a reference to the Python object (a tuple or None) that owns
 * the memory of the user laws. Return NULL with an exception. */
static PyObject *new_object(PyTypeObject *type, const bd_time_input *in, PyObject *user_laws) {
    TimeIntegrationObject *self = (TimeIntegrationObject *)type->tp_alloc(type, 0);
    if (!self) return NULL;
    self->point_law = Py_NewRef(user_laws);
    self->lock = PyThread_allocate_lock();
    const int is_ready = self->lock && core_check_status(bd_time_create(&self->time, in));
    if (!is_ready) {
        if (!PyErr_Occurred()) PyErr_NoMemory(); /* a missing lock sets no exception */
        Py_CLEAR(self);
    }
    return (PyObject *)self;
}

/* TimeIntegration(n_sector, ..., row, own=None): check and copy all arguments. Each name in Python
 * has a field of ring_objects in the same order; `own`, the user laws of the points or None, is
 * point_law. The arrays remain those of the caller (core_arguments only compares their memory), so
 * nothing needs to be released for them. bd_time_create copies the table of user laws, so it can be
 * released here. The memory that the laws use belongs to o.point_law. */
static PyObject *TimeIntegration_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"n_sector", "n_mode", "diameter", "stiffness", "mass", "damping", "G",
                            "kt",       "kn",     "mu",       "n0",        "load", "shift",   "law",
                            "held",     "order",  "force",    "row",       "own",  NULL};
    ring_objects o = {.point_law = Py_None};
    bd_time_input in = {0};
    core_arguments arguments = {0};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "iOOOOOOOOOOOOOOOOO|O:TimeIntegration", names,
                                     &in.n_sector, &o.n_mode, &o.diameter, &o.stiffness, &o.mass,
                                     &o.damping, &o.G, &o.kt, &o.kn, &o.mu, &o.n0, &o.load,
                                     &o.shift, &o.law, &o.held, &o.order, &o.force, &o.row,
                                     &o.point_law))
        return NULL;
    if (in.n_sector < 1 || in.n_sector > 100000) {
        PyErr_Format(PyExc_ValueError, "n_sector: expected 1 to 100000, found %d", in.n_sector);
        return NULL;
    }
    if (!core_check_kernel() || !read_families(&arguments, &o, &in) ||
        !read_points(&arguments, &o, &in))
        return NULL;
    bd_point_law *point_law;
    if (!core_point_laws(o.point_law, in.n_point, &point_law)) return NULL;
    in.point_law = point_law;
    PyObject *self = NULL;
    if (core_check_point_laws(in.law, point_law, in.n_point))
        self = new_object(type, &in, o.point_law);
    PyMem_Free(point_law);
    return self;
}

/* Return whether numbers of steps, spectral radius, tolerance and frequencies are in their ranges. */
static int check_path(const bd_time_path *path) {
    enum { MOST_STEPS = 1000000000 };
    const int good_steps = path->n_step >= 0 && path->n_step <= MOST_STEPS;
    const int good_first = path->first_step >= 0 && path->first_step <= MOST_STEPS;
    if (!good_steps || !good_first || path->steps_per_period < 1) {
        PyErr_SetString(
            PyExc_ValueError,
            "n_step, first, per_period: expected 0 to 1000000000 steps, at least one per period");
        return 0;
    }
    const int good_radius = path->spectral_radius >= 0.0 && path->spectral_radius <= 1.0;
    const int good_tolerance = path->tolerance > 0.0 && path->tolerance <= 0.01;
    if (!good_radius || !good_tolerance) {
        PyErr_SetString(PyExc_ValueError,
                        "radius, tolerance: expected 0 to 1, and a positive number up to 0.01");
        return 0;
    }
    if (!core_check_number(path->omega, "omega", BD_POSITIVE)) return 0;
    return core_check_number(path->omega_end, "omega_end", BD_POSITIVE);
}

/* The part of a path from step `done`, at the start of a period, to step `end`, with its outputs. */
static bd_time_path part_of(const bd_time *t, const bd_time_path *path, long done, long end) {
    bd_time_path part = *path;
    part.n_step = end - done;
    part.find_acceleration = path->find_acceleration && !done;
    part.first_step = (path->first_step + done) % path->steps_per_period;

    /* the square of the frequency is linear in the angle */
    const double square = path->omega * path->omega;
    const double gain = path->omega_end * path->omega_end - square;
    if (done) part.omega = sqrt(square + gain * (double)done / (double)path->n_step);
    if (end < path->n_step)
        part.omega_end = sqrt(square + gain * (double)end / (double)path->n_step);

    const size_t n_period_before = (size_t)(done / path->steps_per_period);
    const size_t per_period = 2 * (size_t)t->n_row * (size_t)(path->n_harm + 1);
    if (path->response_harmonics) part.response_harmonics += per_period * n_period_before;
    if (path->energy) part.energy += BD_TIME_N_ENERGY * n_period_before;
    if (path->coordinates) part.coordinates += 2 * (size_t)t->n_total * (size_t)done;
    return part;
}

/* Integrate whole periods, some thousand steps at a time; Ctrl-C stops the integration between
 * them. Return 0 with an exception; *status is the result of the integration. */
static int integrate_in_parts(TimeIntegrationObject *self, const bd_time_path *path, double *q,
                              double *v, double *a, double *w, bd_time_effort *effort,
                              bd_status *status) {
    enum { STEPS = 4096 };
    const long per_period = path->steps_per_period;
    /* number of steps of a part: whole periods up to STEPS, at least one */
    const long most = per_period > STEPS ? per_period : STEPS / per_period * per_period;
    long done = 0;
    /* a path of no steps is one part, which only finds the accelerations */
    do {
        const long end = path->n_step - done > most ? done + most : path->n_step;
        const bd_time_path part = part_of(&self->time, path, done, end);
        Py_BEGIN_ALLOW_THREADS;
        PyThread_acquire_lock(self->lock, WAIT_LOCK);
        *status = bd_time_integrate(&self->time, &part, q, v, a, w, effort);
        PyThread_release_lock(self->lock);
        Py_END_ALLOW_THREADS;
        if (PyErr_CheckSignals()) return 0;
        done = end;
    } while (done < path->n_step && *status == BD_OK);
    return 1;
}

/* Data of an array of finite numbers that the call reads and then overwrites, or NULL with an
 * exception. */
static double *state(core_arguments *arguments, PyObject *object, const char *name, int n_dim,
                     const npy_intp *shape) {
    double *x = core_doubles(arguments, object, name, n_dim, shape, BD_OUTPUT);
    if (!x) return NULL;
    const npy_intp n = PyArray_SIZE((PyArrayObject *)object);
    return core_check_numbers(x, n, name, BD_FINITE) ? x : NULL;
}

/* Return whether all contact states are known numbers or BD_TIME_UNKNOWN; otherwise 0 with an
 * exception. */
static int check_states(const signed char *states, npy_intp n) {
    for (npy_intp i = 0; i < n; ++i) {
        if (states[i] >= BD_TIME_UNKNOWN && states[i] < BD_TIME_N_STATE) continue;
        PyErr_Format(PyExc_ValueError, "states: expected %d to %d, found %d at flat index %zd",
                     BD_TIME_UNKNOWN, BD_TIME_N_STATE - 1, states[i], (Py_ssize_t)i);
        return 0;
    }
    return 1;
}

/* Optional output of the harmonics (n_state, n_period, n_row, n_harm + 1). Set n_harm; *X remains
 * NULL for None. Return 0 with an exception. */
static int read_harmonics(core_arguments *arguments, PyObject *object, const bd_time *t,
                          npy_intp n_state, npy_intp n_period, int *n_harm, double **X) {
    if (object == Py_None) return 1;
    if (!PyArray_Check(object) || PyArray_NDIM((PyArrayObject *)object) != 4) {
        PyErr_SetString(PyExc_TypeError, "harmonic: expected a numpy array of four dimensions");
        return 0;
    }
    const npy_intp n_column = PyArray_DIM((PyArrayObject *)object, 3);
    if (n_column < 1 || n_column > BD_MAX_HARM + 1) {
        PyErr_Format(PyExc_ValueError, "harmonic: expected 1 to %d columns, found %zd",
                     BD_MAX_HARM + 1, (Py_ssize_t)n_column);
        return 0;
    }
    const npy_intp shape[4] = {n_state, n_period, t->n_row, n_column};
    *X = core_array(arguments, object, "harmonic", NPY_CDOUBLE, "complex128", 4, shape, BD_OUTPUT);
    *n_harm = (int)n_column - 1;
    return *X != NULL;
}

/* integrate(q, v, a, w, ...), see the docstring below: integrate n_state states, one after the
 * other. q, v and a are (n_state, 2 n_total), w is (n_state, n_sector, n_point, 2 + n_memory), and
 * all outputs have n_state as first dimension. A status other than BD_OK ends the loop. */
static PyObject *TimeIntegration_integrate(TimeIntegrationObject *self, PyObject *args,
                                           PyObject *kwargs) {
    static char *names[] = {"q",     "v",         "a",      "w",         "n_step", "per_period",
                            "omega", "omega_end", "radius", "tolerance", "fresh",  "harmonic",
                            "trace", "first",     "energy", "seconds",   "states", NULL};
    PyObject *q_object, *v_object, *a_object, *w_object;
    PyObject *harmonic = Py_None, *trace = Py_None, *energy = Py_None, *states = Py_None;
    double seconds = 0.0;
    bd_time_path path = {0};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOlidddd|pOOlOdO:integrate", names, &q_object,
                                     &v_object, &a_object, &w_object, &path.n_step,
                                     &path.steps_per_period, &path.omega, &path.omega_end,
                                     &path.spectral_radius, &path.tolerance,
                                     &path.find_acceleration, &harmonic, &trace, &path.first_step,
                                     &energy, &seconds, &states))
        return NULL;
    if (seconds > 0.0) path.last_second = bd_processor_seconds() + seconds;
    core_arguments arguments = {0};
    const bd_time *t = &self->time;
    const npy_intp n_state = length(q_object, "q", 1000000), n = 2 * t->n_total;
    if (n_state < 0 || !check_path(&path)) return NULL;

    /* states, which the integration overwrites */
    const npy_intp by_q[2] = {n_state, n};
    const npy_intp by_w[4] = {n_state, t->n_sector, t->n_point, 2 + t->n_memory};
    const npy_intp n_w = by_w[1] * by_w[2] * by_w[3];
    double *q, *v, *a, *w;
    if (!(q = state(&arguments, q_object, "q", 2, by_q))) return NULL;
    if (!(v = state(&arguments, v_object, "v", 2, by_q))) return NULL;
    if (!(a = state(&arguments, a_object, "a", 2, by_q))) return NULL;
    if (!(w = state(&arguments, w_object, "w", 4, by_w))) return NULL;

    /* optional outputs */
    const npy_intp n_period = path.n_step / path.steps_per_period;
    const npy_intp by_trace[3] = {n_state, path.n_step, n},
                   by_energy[3] = {n_state, n_period, BD_TIME_N_ENERGY};
    double *X = NULL, *x = NULL, *e = NULL;
    if (!read_harmonics(&arguments, harmonic, t, n_state, n_period, &path.n_harm, &X)) return NULL;
    if (trace != Py_None) {
        x = core_doubles(&arguments, trace, "trace", 3, by_trace, BD_OUTPUT);
        if (!x) return NULL;
    }
    if (energy != Py_None) {
        e = core_doubles(&arguments, energy, "energy", 3, by_energy, BD_OUTPUT);
        if (!e) return NULL;
    }
    const npy_intp by_states[4] = {n_state, path.steps_per_period, t->n_sector, t->n_point};
    const npy_intp n_states = by_states[1] * by_states[2] * by_states[3];
    signed char *expected = NULL;
    if (states != Py_None) {
        expected =
            core_array(&arguments, states, "states", NPY_INT8, "int8", 4, by_states, BD_OUTPUT);
        if (!expected || !check_states(expected, n_state * n_states)) return NULL;
    }

    bd_time_effort effort = {0};
    bd_status status = BD_OK;
    const npy_intp n_harmonics = 2 * n_period * t->n_row * (path.n_harm + 1); /* complex */
    for (npy_intp i = 0; i < n_state && status == BD_OK; ++i) {
        path.response_harmonics = X ? X + i * n_harmonics : NULL;
        path.energy = e ? e + BD_TIME_N_ENERGY * i * n_period : NULL;
        path.coordinates = x ? x + i * path.n_step * n : NULL;
        path.states = expected ? expected + i * n_states : NULL;
        if (!integrate_in_parts(self, &path, q + i * n, v + i * n, a + i * n, w + i * n_w, &effort,
                                &status))
            return NULL;
    }
    return Py_BuildValue("ill", (int)status, effort.n_solution, effort.n_evaluation);
}

/* follow(q, w): move the sliders w (n_sector, n_point, 2 + n_memory) along the coordinates q (n_step,
 * 2 n_total), without the GIL. */
static PyObject *TimeIntegration_follow(TimeIntegrationObject *self, PyObject *args) {
    PyObject *q_object, *w_object;
    if (!PyArg_ParseTuple(args, "OO:follow", &q_object, &w_object)) return NULL;
    core_arguments arguments = {0};
    const bd_time *t = &self->time;
    const npy_intp n_step = length(q_object, "q", 100000000);
    if (n_step < 0) return NULL;
    const npy_intp by_q[2] = {n_step, 2 * t->n_total};
    const npy_intp by_w[3] = {t->n_sector, t->n_point, 2 + t->n_memory};
    const double *q = core_numbers(&arguments, q_object, "q", 2, by_q, BD_FINITE);
    if (!q) return NULL;
    double *w = state(&arguments, w_object, "w", 3, by_w);
    if (!w) return NULL;
    Py_BEGIN_ALLOW_THREADS;
    PyThread_acquire_lock(self->lock, WAIT_LOCK);
    bd_time_update_sliders(&self->time, (long)n_step, q, w);
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS;
    Py_RETURN_NONE;
}

static PyMethodDef TimeIntegration_methods[] = {
    {"integrate", (PyCFunction)(void (*)(void))TimeIntegration_integrate,
     METH_VARARGS | METH_KEYWORDS,
     "integrate(q, v, a, w, n_step, per_period, omega, omega_end, radius, tolerance, fresh=False, "
     "harmonic=None, trace=None, first=0, energy=None, seconds=0.0, states=None) -> (int, int, "
     "int)\n\n"
     "Integrate m states in place: q, v, a (m, 2 n) and w (m, n_sector, n_point, 2 + n_memory), "
     "sliders and "
     "memories of user laws.\n\n"
     "The n_step steps have equal angles, per_period in a period, and begin at step `first` of a "
     "period. The "
     "frequency changes from omega to omega_end linearly in time. radius is the spectral radius at "
     "infinite "
     "frequency, tolerance the relative tolerance of the contact forces. With fresh, accelerations "
     "and "
     "coordinates without mass are computed from the remaining state.\n\n"
     "Optional outputs: harmonic, the harmonics of the responses in each whole period (m, n_step "
     "// per_period, "
     "n_row, n_harm + 1); energy (m, n_step // per_period, 4), J: work of the excitation, losses "
     "in damping, "
     "work on the contacts, increase of kinetic and strain energy; trace, the coordinates at the "
     "start of each "
     "step (m, n_step, 2 n). With seconds, the integration stops after this processor time.\n\n"
     "states (m, per_period, n_sector, n_point) int8, read and overwritten: contact states at each "
     "phase of the "
     "last period, -1 if unknown. A step expects them to return, which saves evaluations.\n\n"
     "Return the status, the number of solutions for contact forces and the number of their "
     "evaluations. The "
     "status is 1 if contact forces were not found even in shortened steps, and 8 if the processor "
     "time is spent."},
    {"follow", (PyCFunction)TimeIntegration_follow, METH_VARARGS,
     "follow(q, w)\n\n"
     "Update the sliders w, as in integrate, along a prescribed motion q (n_step, 2 n)."},
    {NULL, NULL, 0, NULL}};

static PyType_Slot TimeIntegration_slots[] = {{Py_tp_new, TimeIntegration_new},
                                              {Py_tp_dealloc, TimeIntegration_dealloc},
                                              {Py_tp_methods, TimeIntegration_methods},
                                              {Py_tp_doc,
                                               "Time integration of all sectors of one structure."},
                                              {0, NULL}};

PyType_Spec core_time_integration_spec = {.name = "bdamper._core.TimeIntegration",
                                          .basicsize = sizeof(TimeIntegrationObject),
                                          .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
                                          .slots = TimeIntegration_slots};
