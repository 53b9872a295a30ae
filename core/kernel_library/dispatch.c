/* The callable that stands for a kernel whose machine code was made ahead of time.

   A Kernel holds variants: a code of the types that a variant takes, and the function that numba's
   module compiler made for them. A call goes to the first variant whose code fits exactly, else to
   the first that takes the arguments without a loss (an int for a float), else to `resolve`, which
   loads variants, has the kernel compiled, or says what is missing. The functions do not look at
   the types of arrays themselves: what does not fit here must never come to them.

   A code is a row of items: `s` kind size for a scalar, `a` kind size dimensions layout for an
   array, `(` items `)` for a tuple or a record; kinds are numpy's (b i u f), sizes in bytes, one
   digit each. A read-only array fits as a writable one does: the machine code is the same. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stddef.h>
#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#include <numpy/arrayobject.h>
#include <numpy/arrayscalars.h>

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    PyObject *variants; /* list of (bytes, function) */
    PyObject *resolve;  /* called with the kernel and the arguments */
    PyObject *dict;
} Kernel;

static int
fits_number(char kind, int size, PyObject *value, int exactly)
{
    char given;
    int bytes;
    if (PyBool_Check(value)) {
        given = 'b', bytes = 1;
    } else if (PyLong_CheckExact(value)) {
        given = 'i', bytes = 8;
    } else if (PyFloat_CheckExact(value)) {
        given = 'f', bytes = 8;
    } else if (PyArray_CheckScalar(value) && !PyArray_Check(value)) {
        PyArray_Descr *type = PyArray_DescrFromScalar(value);
        if (type == NULL) {
            PyErr_Clear();
            return 0;
        }
        given = type->kind, bytes = (int)PyDataType_ELSIZE(type);
        Py_DECREF(type);
    } else {
        return 0;
    }
    if (given == kind && bytes == size)
        return 1;
    if (exactly)
        return 0;
    if (kind == 'f')
        return size == 8 && (given == 'i' || given == 'u' || given == 'b' || given == 'f') && bytes <= 8;
    if (kind == 'i')
        return (given == 'i' && bytes <= size) || ((given == 'u' || given == 'b') && bytes < size);
    return kind == 'u' && (given == 'u' || given == 'b') && bytes <= size;
}

static int
fits_array(const char *code, PyObject *value)
{
    PyArrayObject *array = (PyArrayObject *)value;
    if (!PyArray_Check(value) || PyArray_DESCR(array)->kind != code[1] ||
        PyArray_ITEMSIZE(array) != code[2] - '0' || PyArray_NDIM(array) != code[3] - '0' ||
        !PyArray_ISBEHAVED_RO(array))
        return 0;
    return code[4] == 'A' || (code[4] == 'C' ? PyArray_IS_C_CONTIGUOUS(array)
                                             : PyArray_IS_F_CONTIGUOUS(array));
}

/* Move `code` past one item, and tell whether a value fits it. */
static int
fits(const char **code, PyObject *value, int exactly)
{
    const char *item = *code;
    if (*item == 's') {
        *code += 3;
        return fits_number(item[1], item[2] - '0', value, exactly);
    }
    if (*item == 'a') {
        *code += 5;
        return fits_array(item, value);
    }
    if (*item != '(' || !PyTuple_Check(value))
        return 0;
    Py_ssize_t count = PyTuple_GET_SIZE(value);
    *code += 1;
    for (Py_ssize_t i = 0; i < count; i++)
        if (**code == ')' || !fits(code, PyTuple_GET_ITEM(value, i), exactly))
            return 0;
    return *(*code)++ == ')';
}

static PyObject *
call_kernel(PyObject *self, PyObject *const *arguments, size_t flags, PyObject *names)
{
    Kernel *kernel = (Kernel *)self;
    Py_ssize_t count = PyVectorcall_NARGS(flags);
    if (names != NULL && PyTuple_GET_SIZE(names)) {
        PyErr_SetString(PyExc_TypeError, "kernels take their arguments by place, not by name");
        return NULL;
    }
    for (int exactly = 1; exactly >= 0; exactly--) {
        for (Py_ssize_t i = 0; i < PyList_GET_SIZE(kernel->variants); i++) {
            PyObject *variant = PyList_GET_ITEM(kernel->variants, i);
            const char *code = PyBytes_AS_STRING(PyTuple_GET_ITEM(variant, 0));
            Py_ssize_t k = 0;
            while (k < count && *code && fits(&code, arguments[k], exactly))
                k++;
            if (k < count || *code)
                continue;
            PyObject *function = PyTuple_GET_ITEM(variant, 1);
            PyObject *packed = PyTuple_New(count), *result;
            if (packed == NULL)
                return NULL;
            for (k = 0; k < count; k++) {
                Py_INCREF(arguments[k]);
                PyTuple_SET_ITEM(packed, k, arguments[k]);
            }
            Py_INCREF(function);
            result = PyObject_Call(function, packed, NULL);
            Py_DECREF(function);
            Py_DECREF(packed);
            return result;
        }
    }
    PyObject *packed = PyTuple_New(count + 1), *result;
    if (packed == NULL)
        return NULL;
    Py_INCREF(self);
    PyTuple_SET_ITEM(packed, 0, self);
    for (Py_ssize_t k = 0; k < count; k++) {
        Py_INCREF(arguments[k]);
        PyTuple_SET_ITEM(packed, k + 1, arguments[k]);
    }
    result = PyObject_Call(kernel->resolve, packed, NULL);
    Py_DECREF(packed);
    return result;
}

static PyObject *
new_kernel(PyTypeObject *type, PyObject *arguments, PyObject *names)
{
    PyObject *resolve;
    if (!PyArg_ParseTuple(arguments, "O", &resolve))
        return NULL;
    Kernel *kernel = (Kernel *)type->tp_alloc(type, 0);
    if (kernel == NULL)
        return NULL;
    kernel->vectorcall = call_kernel;
    Py_INCREF(resolve);
    kernel->resolve = resolve;
    kernel->variants = PyList_New(0);
    if (kernel->variants == NULL) {
        Py_DECREF(kernel);
        return NULL;
    }
    return (PyObject *)kernel;
}

static PyObject *
add_variant(PyObject *self, PyObject *arguments)
{
    PyObject *code, *function;
    if (!PyArg_ParseTuple(arguments, "SO", &code, &function))
        return NULL;
    PyObject *variant = PyTuple_Pack(2, code, function);
    if (variant == NULL || PyList_Append(((Kernel *)self)->variants, variant)) {
        Py_XDECREF(variant);
        return NULL;
    }
    Py_DECREF(variant);
    Py_RETURN_NONE;
}

static int
traverse_kernel(PyObject *self, visitproc visit, void *arg)
{
    Kernel *kernel = (Kernel *)self;
    Py_VISIT(kernel->variants);
    Py_VISIT(kernel->resolve);
    Py_VISIT(kernel->dict);
    return 0;
}

static int
clear_kernel(PyObject *self)
{
    Kernel *kernel = (Kernel *)self;
    Py_CLEAR(kernel->dict);
    return 0;
}

static void
free_kernel(PyObject *self)
{
    Kernel *kernel = (Kernel *)self;
    PyObject_GC_UnTrack(self);
    Py_CLEAR(kernel->variants);
    Py_CLEAR(kernel->resolve);
    Py_CLEAR(kernel->dict);
    Py_TYPE(self)->tp_free(self);
}

static PyMethodDef methods[] = {
    {"add", add_variant, METH_VARARGS, "Add a variant: the code of its types, and its function."},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef properties[] = {
    {"__dict__", PyObject_GenericGetDict, PyObject_GenericSetDict, NULL, NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyTypeObject KernelType = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "medialis.base._dispatch.Kernel",
    .tp_doc = "A kernel made ahead of time; what fits none of its variants goes to `resolve`.",
    .tp_basicsize = sizeof(Kernel),
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_HAVE_VECTORCALL,
    .tp_vectorcall_offset = offsetof(Kernel, vectorcall),
    .tp_call = PyVectorcall_Call,
    .tp_dictoffset = offsetof(Kernel, dict),
    .tp_getattro = PyObject_GenericGetAttr,
    .tp_setattro = PyObject_GenericSetAttr,
    .tp_methods = methods,
    .tp_getset = properties,
    .tp_new = new_kernel,
    .tp_traverse = traverse_kernel,
    .tp_clear = clear_kernel,
    .tp_dealloc = free_kernel,
};

/* Whether this processor runs what was compiled for x86-64-v2 (all since 2009, and all others). */
static int
runs_here(void)
{
#if (defined(__x86_64__) || defined(_M_X64)) && (defined(__GNUC__) || defined(__clang__))
    __builtin_cpu_init();
    return __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt");
#else
    return 1; /* Windows 11 and Macs have it; Windows 10 without it has no numpy 2 either */
#endif
}

/* Whether it runs what was compiled for x86-64-v3 (Intel since 2013, AMD since 2015). */
static int
runs_v3(void)
{
#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
           __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
#else
    return 0;
#endif
}

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_dispatch", "Calls kernels that were made ahead of time.", -1, NULL,
};

PyMODINIT_FUNC
PyInit__dispatch(void)
{
    import_array();
    if (PyType_Ready(&KernelType) < 0)
        return NULL;
    PyObject *module = PyModule_Create(&definition);
    if (module == NULL)
        return NULL;
    Py_INCREF(&KernelType);
    if (PyModule_AddObject(module, "Kernel", (PyObject *)&KernelType) < 0 ||
        PyModule_AddIntConstant(module, "RUNS_HERE", runs_here()) < 0 ||
        PyModule_AddIntConstant(module, "RUNS_V3", runs_v3()) < 0) {
        Py_DECREF(module);
        return NULL;
    }
    return module;
}
