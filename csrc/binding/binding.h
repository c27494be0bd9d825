/* Declarations shared by the files of the extension module: argument checks, named
 * results, module state. */
#ifndef BD_BINDING_BINDING_H
#define BD_BINDING_BINDING_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#define NPY_NO_DEPRECATED_API NPY_1_25_API_VERSION
#define PY_ARRAY_UNIQUE_SYMBOL bdamper_core_numpy
#ifndef BD_CORE_IMPORTS_NUMPY
#define NO_IMPORT_ARRAY
#endif
#include <numpy/arrayobject.h>

#include "balance/nonlinear_mode.h"
#include "balance/sector.h"
#include "balance/speed_family.h"
#include "bladed_disk/wheel_equations.h"
#include "solver/newton.h"
#include "time/integration.h"

#include <pythread.h>

typedef struct {
    bd_lapack lapack;
    PyTypeObject *counts, *solved; /* struct sequences */
    PyTypeObject *sector;
} core_state;

/* ---- arguments (arguments.c) ---- */

/* Wheel() has the most arrays of all calls. */
enum { BD_MAX_ARRAYS = 26 };

/* Arrays of one call. */
typedef struct {
    int n;
    struct {
        const char *name, *start, *end;
        int output;
    } array[BD_MAX_ARRAYS];
} core_arguments;

typedef enum { BD_FINITE, BD_NON_NEGATIVE, BD_POSITIVE, BD_NEGATIVE } core_range;
enum { BD_INPUT, BD_OUTPUT };

/* Return the data of a C-contiguous, aligned array of the given type and shape, or NULL
 * with an exception that names the argument. An output must not share memory with
 * another array of the call. */
void *core_array(core_arguments *arguments, PyObject *object, const char *name, int type,
                 const char *type_name, int n_dim, const npy_intp *shape, int output);
double *core_doubles(core_arguments *arguments, PyObject *object, const char *name, int n_dim,
                     const npy_intp *shape, int output);
double *core_vector(core_arguments *arguments, PyObject *object, const char *name, npy_intp n,
                    int output);

/* An input with n numbers in a range. */
double *core_numbers(core_arguments *arguments, PyObject *object, const char *name, int n_dim,
                     const npy_intp *shape, core_range range);

/* Return whether n numbers are in a range; otherwise raise an exception that names them. */
int core_check_numbers(const double *x, npy_intp n, const char *name, core_range range);
int core_check_number(double x, const char *name, core_range range);

int core_check_n_harm(npy_intp n_harm);
int core_check_evaluation(int evaluation, int n_time, int n_harm);
int core_check_law(int law, int evaluation);
int core_check_slider(const double *w, int law);
/* whether this processor runs the kernel in the environment variable */
int core_check_kernel(void);
PyObject *core_kernel_names(void);

/* Read user laws at n points from None or a tuple. Its items are None or (function, parameters,
 * memory, ...) for each point; function is a capsule or a tuple that begins with one. The items
 * must outlive the laws. Return 0 with an exception, also for a shipped law with wrong counts. The
 * caller frees *point_law with PyMem_Free; it is NULL for None. */
int core_point_laws(PyObject *object, npy_intp n, bd_point_law **point_law);

/* Return whether the points with a function are exactly those with BD_LAW_USER. */
int core_check_point_laws(const int *law, const bd_point_law *point_law, npy_intp n);

/* Return 0 with an exception for wrong arguments or lack of memory. */
int core_check_status(bd_status status);

/* ---- equations (equations_type.c) ---- */

/* Common object of all types of equations. The types share methods and destructor and differ in
 * their constructors. */
typedef struct core_equations {
    PyObject_HEAD bd_equations *equations; /* owned */
    bd_hbm *hbm;                           /* evaluates the contact; NULL for a wheel */
    bd_wheel *wheel;                       /* the same equations, or NULL */
    struct core_equations *inner;          /* wrapped equations, whose lock is used; NULL if none */
    PyObject *point_law;                   /* owner of the user laws' memory, or NULL */
    PyThread_type_lock lock;
} core_equations;

/* Return an object without equations; NULL with an exception. */
core_equations *core_equations_new(PyTypeObject *type, core_equations *inner);
void core_equations_dealloc(PyObject *self);
extern PyMethodDef core_equations_methods[];
extern PyGetSetDef core_equations_getset[];

/* ---- parts of the module ---- */

extern PyType_Spec core_sector_spec, core_eased_spec, core_modes_spec; /* sector_types.c */
extern PyType_Spec core_time_integration_spec;                         /* integration_type.c */
extern PyType_Spec core_wheel_spec;                                    /* wheel_type.c */
int core_add_results(PyObject *module, core_state *state);
/* contact_functions.c */
PyObject *core_evaluate_contact(PyObject *module, PyObject *args, PyObject *kwargs);
PyObject *core_step_laws(PyObject *module, PyObject *args);
PyObject *core_check_laws(PyObject *module, PyObject *laws);
int core_add_laws(PyObject *module);

#endif
