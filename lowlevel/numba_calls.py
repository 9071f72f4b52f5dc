"""Calls of kernels by their addresses, as compiled code calls its own: private parts of numba's compiler.

What may fail: numba changes its calling convention, or the names of these parts. Then the ordinary path is taken, which
calls each kernel from Python (`lowlevel.capabilities`).
"""

from collections.abc import Callable
from typing import Any

from numba import types


def address_of(function: Any) -> int:
    """Return the address of a kernel's code; the kernel must have exactly one signature."""
    (compiled,) = function.overloads.values()
    address: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    return address


def entry(function: Any) -> Callable[..., Any]:
    """Return the machine code of a kernel as a callable that skips numba's dispatch by argument types.

    The caller must pass arguments of exactly the signature's types: nothing checks them any more.
    """
    (compiled,) = function.overloads.values()
    code: Callable[..., Any] = compiled.entry_point
    return code


def call_by_address(target: Any, builder: Any, arguments: Any, signature: Any) -> Any:
    """Generate a call of the function at the address ``arguments[0]`` with the other arguments.

    It follows numba's own calling convention, so the callee is an ordinary kernel. A C function would take arrays as
    bare pointers. The callee's status is dropped, so an exception in it would be lost: such functions must not raise.
    """
    convention = target.call_conv
    kind = convention.get_function_type(signature.return_type, signature.args)
    function = builder.inttoptr(arguments[0], kind.as_pointer())
    _, result = convention.call_function(builder, function, signature.return_type, signature.args, arguments[1:])
    return target.get_dummy_value() if signature.return_type == types.none else result
