/* Argument checks. Arrays must have the required dtype, shape and layout:
 * Python converts, C refuses. */
#include "binding/binding.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

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

static int raise_shape(PyArrayObject *array, const char *name, int n_dim, const npy_intp *shape) {
    PyObject *expected = shape_text(n_dim, shape),
             *found = shape_text(PyArray_NDIM(array), PyArray_DIMS(array));
    if (expected && found)
        PyErr_Format(PyExc_ValueError, "%s: expected shape %U, found %U", name, expected, found);
    Py_XDECREF(expected);
    Py_XDECREF(found);
    return 0;
}

/* Register a contiguous array of the call. Refuse memory shared with another array if one of them
 * is an output. */
static int enter(core_arguments *arguments, PyArrayObject *array, const char *name, int output) {
    const char *start = PyArray_BYTES(array), *end = start + PyArray_NBYTES(array);
    for (int i = 0; i < arguments->n; ++i) {
        const int disjoint = end <= arguments->array[i].start || arguments->array[i].end <= start;
        const int both_inputs = !output && !arguments->array[i].output;
        if (disjoint || both_inputs) continue;
        PyErr_Format(PyExc_ValueError, "%s: expected a separate array, found memory shared with %s",
                     name, arguments->array[i].name);
        return 0;
    }
    if (arguments->n == BD_MAX_ARRAYS) {
        PyErr_Format(PyExc_SystemError, "%s: expected at most %d arrays in one call", name,
                     BD_MAX_ARRAYS);
        return 0;
    }
    const int i = arguments->n++;
    arguments->array[i].name = name;
    arguments->array[i].start = start;
    arguments->array[i].end = end;
    arguments->array[i].output = output;
    return 1;
}

void *core_array(core_arguments *arguments, PyObject *object, const char *name, int type,
                 const char *type_name, int n_dim, const npy_intp *shape, int output) {
    if (!PyArray_Check(object)) {
        PyErr_Format(PyExc_TypeError, "%s: expected a numpy array, found %s", name,
                     Py_TYPE(object)->tp_name);
        return NULL;
    }
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_TYPE(array) != type || !PyArray_ISNOTSWAPPED(array)) {
        PyErr_Format(PyExc_TypeError, "%s: expected dtype %s, found %R", name, type_name,
                     PyArray_DESCR(array));
        return NULL;
    }
    if (!has_shape(array, n_dim, shape)) {
        raise_shape(array, name, n_dim, shape);
        return NULL;
    }
    if (!PyArray_IS_C_CONTIGUOUS(array) || !PyArray_ISALIGNED(array) ||
        (output && !PyArray_ISWRITEABLE(array))) {
        PyErr_Format(PyExc_ValueError, "%s: expected an aligned C-contiguous%s array", name,
                     output ? ", writable" : "");
        return NULL;
    }
    return enter(arguments, array, name, output) ? PyArray_DATA(array) : NULL;
}

double *core_doubles(core_arguments *arguments, PyObject *object, const char *name, int n_dim,
                     const npy_intp *shape, int output) {
    return core_array(arguments, object, name, NPY_DOUBLE, "float64", n_dim, shape, output);
}

double *core_vector(core_arguments *arguments, PyObject *object, const char *name, npy_intp n,
                    int output) {
    return core_doubles(arguments, object, name, 1, &n, output);
}

static int in_range(double x, core_range range) {
    switch (range) {
    case BD_FINITE: return isfinite(x);
    case BD_NON_NEGATIVE: return isfinite(x) && x >= 0.0;
    case BD_POSITIVE: return isfinite(x) && x > 0.0;
    case BD_NEGATIVE: return isfinite(x) && x < 0.0;
    }
    return 0;
}

/* Raise ValueError for number x at the index `at` of an array of n numbers. */
static void raise_number(double x, const char *name, core_range range, npy_intp at, npy_intp n) {
    static const char *const text[] = {"finite", "finite non-negative", "finite positive",
                                       "finite negative"};
    PyObject *value = PyFloat_FromDouble(x);
    if (!value) return;
    if (n == 1)
        PyErr_Format(PyExc_ValueError, "%s: expected a %s number, found %R", name, text[range],
                     value);
    else
        PyErr_Format(PyExc_ValueError, "%s: expected %s numbers, found %R at flat index %zd", name,
                     text[range], value, (Py_ssize_t)at);
    Py_DECREF(value);
}

int core_check_numbers(const double *x, npy_intp n, const char *name, core_range range) {
    for (npy_intp i = 0; i < n; ++i)
        if (!in_range(x[i], range)) {
            raise_number(x[i], name, range, i, n);
            return 0;
        }
    return 1;
}

int core_check_number(double x, const char *name, core_range range) {
    return core_check_numbers(&x, 1, name, range);
}

double *core_numbers(core_arguments *arguments, PyObject *object, const char *name, int n_dim,
                     const npy_intp *shape, core_range range) {
    npy_intp n = 1;
    for (int i = 0; i < n_dim; ++i) n *= shape[i];
    double *x = core_doubles(arguments, object, name, n_dim, shape, BD_INPUT);
    return x && core_check_numbers(x, n, name, range) ? x : NULL;
}

int core_check_n_harm(npy_intp n_harm) {
    if (n_harm >= 1 && n_harm <= BD_MAX_HARM) return 1;
    PyErr_Format(PyExc_ValueError, "number of harmonics: expected 1 to %d, found %zd", BD_MAX_HARM,
                 (Py_ssize_t)n_harm);
    return 0;
}

int core_check_evaluation(int evaluation, int n_time, int n_harm) {
    if (evaluation < BD_EXACT || evaluation > BD_SAMPLED_PLAIN) {
        PyErr_Format(PyExc_ValueError,
                     "evaluation: expected 0 (exact), 1 (sampled) or 2 (plain), found %d",
                     evaluation);
        return 0;
    }
    if (evaluation == BD_EXACT && n_time != 0) {
        PyErr_Format(PyExc_ValueError, "n_time: expected 0 with evaluation 0 (exact), found %d",
                     n_time);
        return 0;
    }
    if (evaluation != BD_EXACT && (n_time < 4 * n_harm + 4 || n_time > 1 << 20)) {
        PyErr_Format(PyExc_ValueError,
                     "n_time: expected %d to %d samples for %d harmonics, found %d", 4 * n_harm + 4,
                     1 << 20, n_harm, n_time);
        return 0;
    }
    return 1;
}

int core_check_law(int law, int evaluation) {
    if (law < 0 || law >= BD_LAW_USER) {
        PyErr_Format(PyExc_ValueError, "law: expected 0 to %d, found %d", BD_LAW_USER - 1, law);
        return 0;
    }
    if (bd_evaluation_supports((bd_evaluation)evaluation, (bd_law)law)) return 1;
    PyErr_Format(PyExc_ValueError,
                 "law: the coupled laws (%d, %d) have no exact evaluation; expected evaluation 1 "
                 "or 2, found 0",
                 BD_LAW_COUPLED, BD_LAW_COUPLED_CONSTANT);
    return 0;
}

/* An infinite slider denotes an end of the interval of residual tractions, which exists for the 1-D
 * laws only. */
int core_check_slider(const double *w, int law) {
    const int one_d = law == BD_LAW_SEPARABLE || law == BD_LAW_CONSTANT;
    for (int d = 0; d < 2; ++d) {
        if (isfinite(w[d]) || (one_d && !isnan(w[d]))) continue;
        PyObject *value = PyFloat_FromDouble(w[d]);
        if (value)
            PyErr_Format(PyExc_ValueError, "w: expected finite numbers under law %d, found %R", law,
                         value);
        Py_XDECREF(value);
        return 0;
    }
    return 1;
}

/* Read one array of a law. */
static const double *law_numbers(PyObject *object, const char *name, npy_intp least, int *n) {
    PyArrayObject *array = (PyArrayObject *)object;
    if (!PyArray_Check(object) || PyArray_TYPE(array) != NPY_DOUBLE || PyArray_NDIM(array) != 1 ||
        !PyArray_ISCARRAY_RO(array) || PyArray_DIM(array, 0) < least ||
        PyArray_DIM(array, 0) > 10000) {
        PyErr_Format(PyExc_TypeError, "own: expected %s as a vector of at least %zd float64", name,
                     (Py_ssize_t)least);
        return NULL;
    }
    *n = (int)PyArray_DIM(array, 0);
    return core_check_numbers(PyArray_DATA(array), *n, name, BD_FINITE) ? PyArray_DATA(array)
                                                                        : NULL;
}

static int read_point_law(PyObject *item, bd_point_law *point_law) {
    if (item == Py_None) return 1;
    if (!PyTuple_Check(item) || PyTuple_GET_SIZE(item) < 3) {
        PyErr_SetString(PyExc_TypeError,
                        "own: expected None or (function, parameters, memory) for each point");
        return 0;
    }
    /* a capsule, or a tuple that begins with one and keeps further objects alive */
    PyObject *function = PyTuple_GET_ITEM(item, 0);
    if (PyTuple_Check(function) && PyTuple_GET_SIZE(function) > 0)
        function = PyTuple_GET_ITEM(function, 0);
    if (!PyCapsule_CheckExact(function)) {
        PyErr_Format(PyExc_TypeError, "own: expected a capsule, found %s",
                     Py_TYPE(function)->tp_name);
        return 0;
    }
    void *pointer = PyCapsule_GetPointer(function, PyCapsule_GetName(function));
    if (!pointer) return 0;
    /* C has no conversion from an object pointer to a function pointer */
    memcpy(&point_law->function, &pointer, sizeof pointer);
    point_law->data = PyCapsule_GetContext(function);
    PyObject *parameters = PyTuple_GET_ITEM(item, 1), *memory = PyTuple_GET_ITEM(item, 2);
    point_law->parameter = law_numbers(parameters, "parameters", 0, &point_law->n_parameter);
    if (!point_law->parameter) return 0;
    /* three components of the motion, then the states */
    int n_memory = 0;
    point_law->memory = law_numbers(memory, "memory", 3, &n_memory);
    if (!point_law->memory) return 0;
    point_law->n_state = n_memory - 3;
    const char *misfit = bd_law_parameter_error(point_law);
    if (!misfit) return 1;
    PyErr_Format(PyExc_ValueError, "%s; found %d parameters and %d states", misfit,
                 point_law->n_parameter, point_law->n_state);
    return 0;
}

int core_point_laws(PyObject *object, npy_intp n, bd_point_law **point_law) {
    *point_law = NULL;
    if (!object || object == Py_None) return 1;
    if (!PyTuple_Check(object) || PyTuple_GET_SIZE(object) != n) {
        PyErr_Format(PyExc_TypeError, "own: expected None or a tuple of %zd laws", (Py_ssize_t)n);
        return 0;
    }
    /* one more, because an allocation of nothing may be NULL */
    bd_point_law *all = PyMem_Calloc((size_t)n + 1, sizeof *all);
    if (!all) {
        PyErr_NoMemory();
        return 0;
    }
    for (npy_intp p = 0; p < n; ++p)
        if (!read_point_law(PyTuple_GET_ITEM(object, p), all + p)) {
            PyMem_Free(all);
            return 0;
        }
    *point_law = all;
    return 1;
}

int core_check_point_laws(const int *law, const bd_point_law *point_law, npy_intp n) {
    for (npy_intp p = 0; p < n; ++p)
        if ((law[p] == BD_LAW_USER) != (point_law && point_law[p].function)) {
            PyErr_Format(PyExc_ValueError,
                         "own: expected a function for each point with law %d and for no other, "
                         "found law %d at point %zd",
                         BD_LAW_USER, law[p], (Py_ssize_t)p);
            return 0;
        }
    return 1;
}

PyObject *core_kernel_names(void) {
    const bd_kernel *kernel[BD_MOST_KERNELS];
    const int n = bd_kernel_all(kernel);
    PyObject *names = PyTuple_New(n);
    for (int i = 0; names && i < n; ++i) {
        PyObject *name = PyUnicode_FromString(kernel[i]->name);
        if (name)
            PyTuple_SET_ITEM(names, i, name);
        else
            Py_CLEAR(names);
    }
    return names;
}

int core_check_kernel(void) {
    if (bd_kernel_get()) return 1;
    PyObject *names = core_kernel_names();
    if (names)
        PyErr_Format(PyExc_ValueError, "%s: expected one of %R, found '%s'", BD_KERNEL_VARIABLE,
                     names, getenv(BD_KERNEL_VARIABLE));
    Py_XDECREF(names);
    return 0;
}

int core_check_status(bd_status status) {
    if (status == BD_NO_MEMORY) PyErr_NoMemory();
    if (status == BD_BAD_ARGUMENT)
        PyErr_SetString(PyExc_ValueError, "the core found invalid arguments");
    return status == BD_OK;
}
