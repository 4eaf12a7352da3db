"""Arrays of which a compiled function knows the addresses: to hand over two dozen arrays would cost more than a step.

For programs that numba compiles; nothing else may import it.
"""

# mypy: ignore-errors

import numpy as np
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array


@intrinsic
def vector_at(typing, address, rows, dtype):
    """The array with one axis that is at an address."""
    return types.Array(dtype.dtype, 1, "C")(types.intp, types.intp, dtype), made


@intrinsic
def table_at(typing, address, rows, columns, dtype):
    """The array with two axes that is at an address."""
    return types.Array(dtype.dtype, 2, "C")(types.intp, types.intp, types.intp, dtype), made


def made(context, builder, signature, values):
    """Code for an array."""
    array_type = signature.return_type
    array = make_array(array_type)(context, builder)
    element = context.get_data_type(array_type.dtype)
    size = context.get_constant(types.intp, context.get_abi_sizeof(element))
    address, *shape = values[:-1]
    strides = [builder.mul(columns, size) for columns in shape[1:]] + [size]
    data = builder.inttoptr(address, element.as_pointer())
    populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return array._getvalue()


def arrays_at(W):
    """The arrays of a batch; a row of `W` has the address of one, and its shape."""
    return (
        table_at(W[0, 0], W[0, 1], W[0, 2], np.int32),
        table_at(W[1, 0], W[1, 1], W[1, 2], np.float64),
        vector_at(W[2, 0], W[2, 1], np.int64),
        table_at(W[3, 0], W[3, 1], W[3, 2], np.int64),
        table_at(W[4, 0], W[4, 1], W[4, 2], np.float64),
        table_at(W[5, 0], W[5, 1], W[5, 2], np.int64),
        table_at(W[6, 0], W[6, 1], W[6, 2], np.float64),
        vector_at(W[7, 0], W[7, 1], np.float64),
        vector_at(W[8, 0], W[8, 1], np.int64),
        table_at(W[9, 0], W[9, 1], W[9, 2], np.int64),
        table_at(W[10, 0], W[10, 1], W[10, 2], np.float64),
        table_at(W[11, 0], W[11, 1], W[11, 2], np.uint64),
        table_at(W[12, 0], W[12, 1], W[12, 2], np.int64),
        vector_at(W[13, 0], W[13, 1], np.int64),
        vector_at(W[14, 0], W[14, 1], np.bool_),
        vector_at(W[15, 0], W[15, 1], np.int64),
        vector_at(W[16, 0], W[16, 1], np.float64),
        vector_at(W[17, 0], W[17, 1], np.int64),
        vector_at(W[18, 0], W[18, 1], np.bool_),
        vector_at(W[19, 0], W[19, 1], np.float64),
        table_at(W[20, 0], W[20, 1], W[20, 2], np.int64),
        table_at(W[21, 0], W[21, 1], W[21, 2], np.float64),
    )
