/* bdamper._core.Wheel: elimination of a whole wheel whose sectors meet next neighbours alone.
 *
 * As in bd_core_equations.c, work is done without the GIL, under the lock of the object that owns the workspace. */
#include "bd_core.h"

#include <pythread.h>

typedef struct {
    PyObject_HEAD bd_wheel wheel;
    PyThread_type_lock lock;
} WheelObject;

static void Wheel_dealloc(WheelObject *self) {
    PyTypeObject *type = Py_TYPE(self);
    bd_wheel_destroy(&self->wheel);
    if (self->lock) PyThread_free_lock(self->lock);
    type->tp_free((PyObject *)self);
    Py_DECREF(type);
}

static int read_group(core_arguments *arguments, PyObject *object, const char *name, bd_wheel_input *in, int g) {
    if (!PyArray_Check(object) || PyArray_NDIM((PyArrayObject *)object) != 3) {
        PyErr_Format(PyExc_TypeError, "%s: expected a numpy array of shape (n_points, 3, n_blade + n_damper)", name);
        return 0;
    }
    const npy_intp n = PyArray_DIM((PyArrayObject *)object, 0), shape[3] = {n, 3, in->n_blade + in->n_damper};
    in->n_point[g] = (int)n;
    return (in->rows[g] = core_numbers(arguments, object, name, 3, shape, BD_FINITE)) != NULL;
}

static unsigned char *flags(core_arguments *arguments, PyObject *object, const char *name, npy_intp n) {
    return core_array(arguments, object, name, NPY_BOOL, "bool", 1, &n, BD_INPUT);
}

static PyObject *Wheel_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"n_sector", "n_harm", "n_blade", "n_damper", "n_kept", "own", "next", "active", "pinned", NULL};
    PyObject *own, *next, *active, *pinned;
    bd_wheel_input in = {0};
    core_arguments arguments = {0};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "iiiiiOOOO:Wheel", names, &in.n_sector, &in.n_harm, &in.n_blade,
                                     &in.n_damper, &in.n_kept, &own, &next, &active, &pinned))
        return NULL;
    if (!core_check_n_harm(in.n_harm)) return NULL;
    if (in.n_sector < 3 || in.n_blade < 1 || in.n_damper < 0 || in.n_kept < 0 || in.n_kept > in.n_blade ||
        in.n_kept + in.n_damper < 1 || in.n_sector > 10000 || in.n_blade + in.n_damper > 10000) {
        PyErr_SetString(PyExc_ValueError,
                        "n_sector, n_blade, n_damper, n_kept: expected at least 3 sectors, kept coordinates or "
                        "dampers, and no more kept than the blade has");
        return NULL;
    }
    if (!read_group(&arguments, own, "own", &in, 0) || !read_group(&arguments, next, "next", &in, 1)) return NULL;
    if (!(in.active = flags(&arguments, active, "active", bd_n_coef(in.n_harm)))) return NULL;
    if (!(in.pinned = flags(&arguments, pinned, "pinned", in.n_sector))) return NULL;
    const core_state *state = PyType_GetModuleState(type);
    WheelObject *self = (WheelObject *)type->tp_alloc(type, 0);
    if (!self) return NULL;
    self->lock = PyThread_allocate_lock();
    if (!self->lock || !core_check_status(bd_wheel_create(&self->wheel, &in, &state->lapack))) {
        if (!PyErr_Occurred()) PyErr_NoMemory();
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

static PyObject *Wheel_factor(WheelObject *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"own", "next", "blade", "damping", "damper", "springs", "neighbour", NULL};
    PyObject *own, *next, *blade, *damping, *damper, *springs, *neighbour;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOOOOO:factor", names, &own, &next, &blade, &damping, &damper,
                                     &springs, &neighbour))
        return NULL;
    const bd_wheel *w = &self->wheel;
    const npy_intp N = w->n_sector, m = w->n_coef, l = (m + 1) / 2, b = w->n_blade, d = w->n_damper, k = w->n_kept;
    const npy_intp first[5] = {N, w->n_point[0], 7, m, m}, second[5] = {N, w->n_point[1], 7, m, m},
                   blades[4] = {l, N, b, b};
    const npy_intp dampers[4] = {l, N, 2, d}, held[2] = {N, d}, near[3] = {l, k, k};
    core_arguments a = {0};
    bd_wheel_matrix matrix;
    if (!(matrix.tangent[0] = core_numbers(&a, own, "own", 5, first, BD_FINITE))) return NULL;
    if (!(matrix.tangent[1] = core_numbers(&a, next, "next", 5, second, BD_FINITE))) return NULL;
    if (!(matrix.blade = core_numbers(&a, blade, "blade", 4, blades, BD_FINITE))) return NULL;
    if (!(matrix.damping = core_numbers(&a, damping, "damping", 4, blades, BD_FINITE))) return NULL;
    if (!(matrix.damper = core_numbers(&a, damper, "damper", 4, dampers, BD_FINITE))) return NULL;
    if (!(matrix.springs = core_numbers(&a, springs, "springs", 2, held, BD_FINITE))) return NULL;
    if (!(matrix.neighbour = core_numbers(&a, neighbour, "neighbour", 3, near, BD_FINITE))) return NULL;
    long factored;
    Py_BEGIN_ALLOW_THREADS;
    PyThread_acquire_lock(self->lock, WAIT_LOCK);
    bd_wheel_factor(&self->wheel, &matrix);
    factored = self->wheel.factored;
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS;
    return PyLong_FromLong(factored);
}

static PyObject *Wheel_solve(WheelObject *self, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"factored", "r", "x", NULL};
    PyObject *r_object, *x_object;
    long factored;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "lOO:solve", names, &factored, &r_object, &x_object)) return NULL;
    const npy_intp shape[3] = {self->wheel.n_sector, self->wheel.n_coef, self->wheel.size};
    core_arguments arguments = {0};
    double *r, *x;
    if (!(r = core_numbers(&arguments, r_object, "r", 3, shape, BD_FINITE))) return NULL;
    if (!(x = core_doubles(&arguments, x_object, "x", 3, shape, BD_OUTPUT))) return NULL;
    bd_status status;
    long latest;
    Py_BEGIN_ALLOW_THREADS;
    PyThread_acquire_lock(self->lock, WAIT_LOCK);
    status = bd_wheel_solve(&self->wheel, factored, r, x);
    latest = self->wheel.factored;
    PyThread_release_lock(self->lock);
    Py_END_ALLOW_THREADS;
    if (status == BD_OK) Py_RETURN_NONE;
    PyErr_Format(PyExc_ValueError, "factored: expected the number of the matrix factored last, %ld (0 for none), found %ld",
                 latest, factored);
    return NULL;
}

static PyMethodDef Wheel_methods[] = {
    {"factor", (PyCFunction)(void (*)(void))Wheel_factor, METH_VARARGS | METH_KEYWORDS,
     "factor(own, next, blade, damping, damper, springs, neighbour) -> int\n\nEliminate the matrix of these tangents and "
     "linear parts (csrc/bd_wheel.h); the number by which solve() is told it, 0 if it is singular."},
    {"solve", (PyCFunction)(void (*)(void))Wheel_solve, METH_VARARGS | METH_KEYWORDS,
     "solve(factored, r, x)\n\nFill x with the solution for the right-hand side r of the matrix of that number, which must "
     "be the one factored last."},
    {NULL, NULL, 0, NULL}};

static PyType_Slot Wheel_slots[] = {{Py_tp_doc,
                                     "Wheel(n_sector, n_harm, n_blade, n_damper, n_kept, own, next, active, pinned)\n--\n\n"
                                     "Elimination of a wheel whose sectors meet next neighbours alone."},
                                    {Py_tp_new, Wheel_new},
                                    {Py_tp_dealloc, Wheel_dealloc},
                                    {Py_tp_methods, Wheel_methods},
                                    {0, NULL}};

PyType_Spec core_wheel_spec = {.name = "bdamper._core.Wheel",
                               .basicsize = sizeof(WheelObject),
                               .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
                               .slots = Wheel_slots};
