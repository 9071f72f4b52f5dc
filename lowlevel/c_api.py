"""Callbacks in compiled code: built-in functions that Zenoh calls like any Python object, without interpreted code.

An interpreted callback costs more than breeding: it performs a few dozen attribute look-ups per message. With hundreds
of processes on a core, whose memory is cold, it costs more than Zenoh itself. So compiled code takes a sample apart,
and calls other objects, through CPython's C API (https://docs.python.org/3/c-api/).

The rules are those of an extension module in C:

- An object is its address, an integer. Reference counts are kept by hand.
- The thread that runs this code holds the interpreter's lock (GIL), but for the stretch between `let_others_run` and
  `run_again`.
- A function that fails returns 0 with a Python exception set. The caller returns 0 too, or clears the exception.
"""

import ctypes
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types

from lowlevel.compiled import subroutine
from lowlevel.pointers import octets_at

OBJECT = types.intp
"""An object's address; as a result 0 if an exception is set."""
CALLBACK = OBJECT(OBJECT, OBJECT)
"""The C signature of a built-in function (PyCFunction): its own object and the sample in, a new reference out."""


def _api(name: str, result: Any, *arguments: Any) -> Any:
    """Declare a function of the C API by name.

    The linker resolves the name when a process loads the code. An address, as a ctypes pointer holds it, would be valid
    in one process only, so numba would refuse to cache the code.
    """
    return types.ExternalFunction(name, result(*arguments))


# The returned objects are new references, which the caller must release (`decref`) or return, unless marked "borrowed".
call: Any = _api("PyObject_CallOneArg", OBJECT, OBJECT, OBJECT)
call_without: Any = _api("PyObject_CallNoArgs", OBJECT, OBJECT)
attribute: Any = _api("PyObject_GetAttr", OBJECT, OBJECT, OBJECT)
tuple_item: Any = _api("PyTuple_GetItem", OBJECT, OBJECT, types.intp)  # borrowed
item_of_list: Any = _api("PyList_GetItem", OBJECT, OBJECT, types.intp)  # borrowed
length: Any = _api("PyList_Size", types.intp, OBJECT)
append: Any = _api("PyList_Append", types.int32, OBJECT, OBJECT)
integer: Any = _api("PyLong_AsLongLong", types.int64, OBJECT)
incref: Any = _api("Py_IncRef", types.void, OBJECT)
decref: Any = _api("Py_DecRef", types.void, OBJECT)
forget_exception: Any = _api("PyErr_Clear", types.void)
let_others_run: Any = _api("PyEval_SaveThread", types.intp)
run_again: Any = _api("PyEval_RestoreThread", types.void, types.intp)
"""Take the lock back, with what `let_others_run` returned. Between the two calls no Python object may be touched."""
_set_slice: Any = _api("PyList_SetSlice", types.int32, OBJECT, types.intp, types.intp, OBJECT)
_new_tuple: Any = _api("PyTuple_New", OBJECT, types.intp)
_set_tuple_item: Any = _api("PyTuple_SetItem", types.int32, OBJECT, types.intp, OBJECT)  # takes the reference
_bytes_of: Any = _api("PyObject_Bytes", OBJECT, OBJECT)
_new_bytes: Any = _api("PyBytes_FromStringAndSize", OBJECT, types.intp, types.intp)
_size: Any = _api("PyBytes_Size", types.intp, OBJECT)
_content: Any = _api("PyBytes_AsString", types.intp, OBJECT)


@subroutine
def new_ref(reference: Any) -> Any:
    """Return the object with one more reference, to be returned or stored where a reference is taken."""
    incref(reference)
    return reference


@subroutine
def content(bytes_object: Any) -> Any:
    """Return the content of a bytes object as a uint8 array. Not a copy: the object must outlive the array."""
    return octets_at(_content(bytes_object), _size(bytes_object))


@subroutine
def payload_of(sample: Any, name: Any) -> Any:
    """Return a sample's payload as a new bytes object, or 0 with an exception set.

    ``name`` is the address of `PAYLOAD_NAME`: compiled code has no Python constants, so the caller provides it.
    """
    payload = attribute(sample, name)
    if payload == 0:
        return payload
    bytes_object = _bytes_of(payload)
    decref(payload)
    return bytes_object


@subroutine
def message_of(octets: Any) -> Any:
    """Copy a uint8 array into a new bytes object."""
    return _new_bytes(octets.ctypes.data, octets.size)


@subroutine
def pair(first: Any, second: Any) -> Any:
    """Return a new tuple of two objects, with references of its own to both."""
    both = _new_tuple(2)
    _set_tuple_item(both, 0, new_ref(first))
    _set_tuple_item(both, 1, new_ref(second))
    return both


@subroutine
def remove_first(list_object: Any, items: Any) -> Any:
    """Delete the first ``items`` items of a list: a slice assignment without a value."""
    _set_slice(list_object, 0, items, 0)


PAYLOAD_NAME = sys.intern("payload")  # attribute names in code are interned, and look-ups compare such by address


class _Definition(ctypes.Structure):
    """CPython's PyMethodDef: the description that a built-in function points to for as long as it exists."""

    _fields_ = (("name", ctypes.c_char_p), ("code", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p))


_ONE_ARGUMENT = 0x0008  # METH_O: the code is called with the argument itself, not with a tuple
_new_function = ctypes.pythonapi.PyCFunction_NewEx
_new_function.restype = ctypes.py_object
_new_function.argtypes = (ctypes.c_void_p, ctypes.py_object, ctypes.py_object)


class BuiltIn:
    """A factory of built-in functions that share one piece of compiled code. It must outlive its functions.

    Args:
        name: the functions' ``__name__``.
        code: a `lowlevel.compiled.c_function` of signature CALLBACK.
    """

    def __init__(self, name: str, code: Any) -> None:
        # The functions hold its address only, which keeps nothing alive. So a factory belongs at the top of a module.
        self._definition = _Definition(name.encode(), code.address, _ONE_ARGUMENT, None)

    def of(self, own: object) -> Callable[[Any], Any]:
        """Return a function of one argument whose code also gets ``own``, to which the function holds a reference."""
        function: Callable[[Any], Any] = _new_function(ctypes.addressof(self._definition), own, None)
        return function


def addresses(*objects: object) -> Any:
    """Return the objects' addresses as int64. They hold no reference: the caller must keep the objects alive."""
    return np.array([id(each) for each in objects], np.int64)  # CPython's id() is the address
