"""Calls of kernels by their addresses, as compiled code calls its own: private parts of numba's compiler.

What may fail: numba changes its calling convention, or the names of these parts. Then the ordinary path is taken, which
calls each kernel from Python (`lowlevel.capabilities`).
"""

from collections.abc import Callable
from typing import Any

from numba import types


def address_of(function: Any) -> int:
    """Return the address of a kernel's code."""
    (compiled,) = function.overloads.values()
    address: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    return address


def entry(function: Any) -> Callable[..., Any]:
    """Return the code of a kernel without numba's check of its arguments: types must match its signature exactly."""
    (compiled,) = function.overloads.values()
    code: Callable[..., Any] = compiled.entry_point
    return code


def call_by_address(target: Any, builder: Any, arguments: Any, signature: Any) -> Any:
    """Emit a call of the function at the first of the ``arguments`` with the others, in numba's own convention."""
    convention = target.call_conv
    kind = convention.get_function_type(signature.return_type, signature.args)
    function = builder.inttoptr(arguments[0], kind.as_pointer())
    _, result = convention.call_function(builder, function, signature.return_type, signature.args, arguments[1:])
    return target.get_dummy_value() if signature.return_type == types.none else result
