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
/* Get one function of a SciPy Cython module. The name of the capsule is the C signature. It must
 * have the expected arguments with int integers, otherwise the call would corrupt memory. */
static int find_function(PyObject *capi, const char *name, const char *pattern, void *target) {
    PyObject *capsule = PyDict_GetItemString(capi, name);
    const char *signature = capsule ? PyCapsule_GetName(capsule) : NULL;
    if (!signature) {
        PyErr_Format(PyExc_ImportError,
                     "bdamper needs %s from scipy.linalg, which this SciPy does not offer", name);
        return -1;
    }
    char kinds[32];
    size_t n = 0;
    const char *p = strchr(signature, '(');
    /* one letter for each argument: c, i, d or ? */
    while (p && *p && *p != ')' && n + 1 < sizeof kinds) {
        ++p;
        while (*p == ' ') ++p;
        const size_t span = strcspn(p, ",)");
        if (strncmp(p, "char *", 6) == 0)
            kinds[n++] = 'c';
        else if (strncmp(p, "int *", 5) == 0)
            kinds[n++] = 'i';
        else if (strncmp(p, "double *", 8) == 0)
            kinds[n++] = 'd';
        else if (strncmp(p, "__pyx_t_5scipy_6linalg_", 23) == 0 && span > 4 &&
                 strncmp(p + span - 4, "_d *", 4) == 0)
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
