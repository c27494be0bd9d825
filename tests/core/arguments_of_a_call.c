/* More arrays than a call of the core has, for test_core_arguments.py. */
#define BD_CORE_IMPORTS_NUMPY
#include "binding/arguments.c"

/* functions of other files, which this test does not call */
const char *bd_law_parameter_error(const bd_point_law *point_law) { return point_law ? "" : NULL; }
int bd_kernel_all(const bd_kernel **kernel) { return kernel ? 0 : -1; }
const bd_kernel *bd_kernel_get(void) { return NULL; }

enum { CAPACITY = sizeof((core_arguments *)0)->array / sizeof((core_arguments *)0)->array[0] };

int capacity(void) { return CAPACITY; }

/* Enter a numpy array of n numbers `times` times into one call. Return how often it was accepted;
 * a refusal raises an exception. */
PyObject *accepted(PyObject *array, int n, int times) {
    import_array();
    /* with room beyond the end, where a missing check would write */
    core_arguments *arguments = PyMem_Calloc(2, sizeof *arguments);
    if (!arguments) return PyErr_NoMemory();
    int count = 0;
    while (count < times && core_vector(arguments, array, "x", n, BD_INPUT)) ++count;
    PyMem_Free(arguments);
    return PyErr_Occurred() ? NULL : PyLong_FromLong(count);
}
