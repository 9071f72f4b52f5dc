"""Callbacks in compiled code: what Zenoh calls is a Python object, but here a built-in function, with no Python behind.

What an interpreted function does with a message, a few dozen names looked up, costs more than breeding, and with
hundreds of processes on a core, whose memory is cold, more than Zenoh. So compiled code asks CPython's own C API what
is in a sample, and calls other objects by it (https://docs.python.org/3/c-api/). In compiled code an object is its
address, and who runs it holds the interpreter's lock.
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
"""An object's address; 0 where an exception is set."""
CALLBACK = OBJECT(OBJECT, OBJECT)
"""Of a function's own object and a sample to what it returns, a new reference."""


def _api(name: str, result: Any, *arguments: Any) -> Any:
    return types.ExternalFunction(name, result(*arguments))


# From the C API; objects that they return are new references, unless it says "borrowed".
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
"""With what `let_others_run` returned: between the two no object may be touched."""
_set_slice: Any = _api("PyList_SetSlice", types.int32, OBJECT, types.intp, types.intp, OBJECT)
_new_tuple: Any = _api("PyTuple_New", OBJECT, types.intp)
_set_tuple_item: Any = _api("PyTuple_SetItem", types.int32, OBJECT, types.intp, OBJECT)  # takes the reference
_bytes_of: Any = _api("PyObject_Bytes", OBJECT, OBJECT)
_new_bytes: Any = _api("PyBytes_FromStringAndSize", OBJECT, types.intp, types.intp)
_size: Any = _api("PyBytes_Size", types.intp, OBJECT)
_content: Any = _api("PyBytes_AsString", types.intp, OBJECT)


@subroutine
def new_ref(its: Any) -> Any:
    """An object once more, to be returned."""
    incref(its)
    return its


@subroutine
def content(its: Any) -> Any:
    """What is in a bytes object, as an array that must not outlive it."""
    return octets_at(_content(its), _size(its))


@subroutine
def payload_of(sample: Any, name: Any) -> Any:
    """A sample's payload, a new bytes object; ``name`` is that of the attribute, `PAYLOAD_NAME`."""
    payload = attribute(sample, name)
    if payload == 0:
        return payload
    its_bytes = _bytes_of(payload)
    decref(payload)
    return its_bytes


@subroutine
def message_of(octets: Any) -> Any:
    """A new bytes object."""
    return _new_bytes(octets.ctypes.data, octets.size)


@subroutine
def pair(first: Any, second: Any) -> Any:
    """A new tuple of two objects."""
    its = _new_tuple(2)
    _set_tuple_item(its, 0, new_ref(first))
    _set_tuple_item(its, 1, new_ref(second))
    return its


@subroutine
def remove_first(its: Any, items: Any) -> Any:
    """So many items of a list."""
    _set_slice(its, 0, items, 0)


PAYLOAD_NAME = sys.intern("payload")


class _Definition(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = (("name", ctypes.c_char_p), ("code", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p))


_ONE_ARGUMENT = 0x0008  # METH_O
_new_function = ctypes.pythonapi.PyCFunction_NewEx
_new_function.restype = ctypes.py_object
_new_function.argtypes = (ctypes.c_void_p, ctypes.py_object, ctypes.py_object)


class BuiltIn:
    """Makes built-in functions of compiled code.

    Args:
        name: of the functions.
        code: a `lowlevel.compiled.c_function` of signature CALLBACK.
    """

    def __init__(self, name: str, code: Any) -> None:
        self._definition = _Definition(name.encode(), code.address, _ONE_ARGUMENT, None)  # the functions point to it

    def of(self, own: object) -> Callable[[Any], Any]:
        """A function whose code is given ``own`` with each argument."""
        function: Callable[[Any], Any] = _new_function(ctypes.addressof(self._definition), own, None)
        return function


def addresses(*objects: object) -> Any:
    """Where objects are, int64; they must be kept."""
    return np.array([id(each) for each in objects], np.int64)
