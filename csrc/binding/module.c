/* bdamper._core: functions and types of the module, and LAPACK from SciPy. */
#define BD_CORE_IMPORTS_NUMPY
#include "binding/binding.h"

#include <string.h>

static struct PyModuleDef core_module;

static PyObject *kernels(PyObject *module, PyObject *args) {
    (void)module, (void)args;
    return core_kernel_names();
}

static PyObject *kernel(PyObject *module, PyObject *args) {
    (void)module, (void)args;
    return core_check_kernel() ? PyUnicode_FromString(bd_kernel_get()->name) : NULL;
}

static PyMethodDef core_methods[] = {
    {"evaluate_contact", (PyCFunction)(void (*)(void))core_evaluate_contact,
     METH_VARARGS | METH_KEYWORDS,
     "evaluate_contact(x, kt, kn, mu, n0, w, F, J, law=0, evaluation=0, n_time=0, load=n0, "
     "own=None) -> "
     "(shares, segments)\n\n"
     "Compute the force F (3, n_coef) and tangent J (3, n_coef, 3, n_coef) of one contact point. "
     "Return the "
     "shares of the cycle, and for each direction a list of (start, end, state)."},
    {"check_laws", core_check_laws, METH_O,
     "check_laws(own)\n\n"
     "Check a tuple of user laws, (function, parameters, memory) or None; raise an exception if "
     "the shipped "
     "laws cannot use their numbers."},
    {"step_laws", core_step_laws, METH_VARARGS,
     "step_laws(own, x, memory, after, F, D)\n\n"
     "Compute one step of the user laws at n points. own is a tuple of (function, parameters, "
     "memory) or None "
     "for each point.\n\n"
     "The step leads from the memory (n, 3 + n_state) to the motion x (n, 3), with the closing "
     "relative to "
     "touching. Outputs are the memory `after` the step, the forces F (n, 3) and their derivative "
     "D (n, 3, 3)."},
    {"kernels", kernels, METH_NOARGS,
     "kernels() -> tuple of str\n\n"
     "Return the builds of the inner loops that this processor runs, fastest first."},
    {"kernel", kernel, METH_NOARGS,
     "kernel() -> str\n\n"
     "Return the active build: the fastest one, or the build in the environment variable "
     "BDAMPER_KERNEL."},
    {NULL, NULL, 0, NULL}};

/* ---- LAPACK ---- */

#ifdef BD_SYSTEM_LAPACK
static int find_lapack(bd_lapack *lapack) {
    *lapack = bd_lapack_system();
    return 0;
}
#else
/* Letter of an argument type: c, i or d for char *, int * or double *, and ? for others. SciPy has
 * its own type for double, whose name in Cython ends in _d. */
static char letter_of_argument(const char *type, size_t length) {
    static const char prefix[] = "__pyx_t_5scipy_6linalg_", suffix[] = "_d *";
    const size_t n_prefix = sizeof prefix - 1, n_suffix = sizeof suffix - 1;
    if (strncmp(type, "char *", 6) == 0) return 'c';
    if (strncmp(type, "int *", 5) == 0) return 'i';
    if (strncmp(type, "double *", 8) == 0) return 'd';
    if (strncmp(type, prefix, n_prefix) != 0) return '?';
    return strncmp(type + length - n_suffix, suffix, n_suffix) == 0 ? 'd' : '?';
}

/* Letters of the arguments of a C signature, such as "void (char *, int *)". Arguments beyond the
 * space for letters are left out. */
static void letters_of_arguments(const char *signature, char *letters, size_t space) {
    size_t n = 0;
    const char *at = strchr(signature, '('); /* before an argument: '(' or ',' */
    while (at && *at && *at != ')' && n + 1 < space) {
        ++at;
        while (*at == ' ') ++at;
        const size_t length = strcspn(at, ",)");
        letters[n++] = letter_of_argument(at, length);
        at += length;
    }
    letters[n] = '\0';
}

/* Get one function of a SciPy Cython module. The name of the capsule is the C signature. It must
 * have the expected arguments with int integers, otherwise the call would corrupt memory. */
static int find_function(PyObject *capi, const char *name, const char *expected, void *function) {
    PyObject *capsule = PyDict_GetItemString(capi, name);
    const char *signature = capsule ? PyCapsule_GetName(capsule) : NULL;
    if (!signature) {
        PyErr_Format(PyExc_ImportError,
                     "bdamper needs %s from scipy.linalg, which this SciPy does not offer", name);
        return -1;
    }
    char letters[32];
    letters_of_arguments(signature, letters, sizeof letters);
    const int returns_void = strncmp(signature, "void (", 6) == 0;
    if (!returns_void || strcmp(letters, expected) != 0) {
        PyErr_Format(PyExc_ImportError,
                     "bdamper: %s of this SciPy has the signature '%s', expected arguments '%s' "
                     "(c: char*, i: int*, d: double*); build with -Dlapack=system instead",
                     name, signature, expected);
        return -1;
    }
    void *pointer = PyCapsule_GetPointer(capsule, signature);
    if (!pointer) return -1;
    /* C has no conversion from an object pointer to a function pointer */
    memcpy(function, &pointer, sizeof pointer);
    return 0;
}

static int find_lapack(bd_lapack *lapack) {
    PyObject *module = PyImport_ImportModule("scipy.linalg.cython_lapack");
    PyObject *api = module ? PyObject_GetAttrString(module, "__pyx_capi__") : NULL;
    const int failed = !api || find_function(api, "dgetrf", "iidiii", &lapack->dgetrf) ||
                       find_function(api, "dgetrs", "ciidiidii", &lapack->dgetrs) ||
                       find_function(api, "dgecon", "cididddii", &lapack->dgecon) ||
                       find_function(api, "dgelsy", "iiididiididii", &lapack->dgelsy);
    Py_XDECREF(module);
    Py_XDECREF(api);
    return failed ? -1 : 0;
}
#endif

static int core_exec(PyObject *module) {
    core_state *state = PyModule_GetState(module);
    if (PyArray_ImportNumPyAPI() < 0 || find_lapack(&state->lapack) < 0) return -1;
    if (core_add_results(module, state) < 0 || core_add_laws(module) < 0) return -1;
    PyType_Spec *const spec[] = {&core_sector_spec, &core_eased_spec, &core_modes_spec,
                                 &core_time_integration_spec, &core_wheel_spec};
    for (size_t i = 0; i < sizeof spec / sizeof *spec; ++i) {
        PyObject *type = PyType_FromModuleAndSpec(module, spec[i], NULL);
        const int failed = type ? PyModule_AddType(module, (PyTypeObject *)type) : -1;
        if (spec[i] == &core_sector_spec)
            state->sector = (PyTypeObject *)type;
        else
            Py_XDECREF(type);
        if (failed) return -1;
    }
    return 0;
}

static int core_traverse(PyObject *module, visitproc visit, void *arg) {
    const core_state *state = PyModule_GetState(module);
    Py_VISIT(state->counts);
    Py_VISIT(state->solved);
    Py_VISIT(state->sector);
    return 0;
}

static int core_clear(PyObject *module) {
    core_state *state = PyModule_GetState(module);
    Py_CLEAR(state->counts);
    Py_CLEAR(state->solved);
    Py_CLEAR(state->sector);
    return 0;
}

static void core_free(void *module) { core_clear(module); }

static PyModuleDef_Slot core_slots[] = {{Py_mod_exec, core_exec},
#ifdef Py_MOD_GIL_NOT_USED
                                        {Py_mod_gil, Py_MOD_GIL_NOT_USED},
#endif
                                        {0, NULL}};

static struct PyModuleDef core_module = {
    PyModuleDef_HEAD_INIT,
    .m_name = "bdamper._core",
    .m_doc =
        "C core of bdamper: contact laws, harmonic balance, Newton iteration and time integration.",
    .m_size = sizeof(core_state),
    .m_methods = core_methods,
    .m_traverse = core_traverse,
    .m_clear = core_clear,
    .m_free = core_free,
    .m_slots = core_slots};

PyMODINIT_FUNC PyInit__core(void) { return PyModuleDef_Init(&core_module); }
