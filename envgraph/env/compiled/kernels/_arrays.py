"""Numba types and intrinsics for the names that all programs use: arrays that are addresses, and operations on bits.

To numba, an array of NumPy consists of seven values, and each function that takes the array compiles operations on
them. A `Vector` is only an address, a `Matrix` an address and the length of a row. Only programs that numba compiles
may import this module; `_python_kernels` defines the same names for Python.
"""

# mypy: ignore-errors

import operator

from llvmlite import binding, ir
from numba import _helperlib, types
from numba.core.cgutils import create_struct_proxy
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model


class Vector(types.Type):
    """The numba type of an array with one axis. Its indices must be in range and not negative."""

    def __init__(self, dtype, fixed):
        self.dtype, self.fixed = dtype, fixed
        super().__init__(f"Vector({dtype}, {fixed})")


class Matrix(types.Type):
    """The numba type of an array with two axes, whose rows are vectors.

    Args:
        dtype: type of the entries.
        fixed: True if the program never writes into the array, so that loaded values need not be loaded again.
    """

    def __init__(self, dtype, fixed):
        self.dtype, self.row = dtype, Vector(dtype, fixed)
        super().__init__(f"Matrix({dtype}, {fixed})")


@register_model(Vector)
class VectorModel(models.PrimitiveModel):
    """The numba data model of a `Vector`: the address of the first entry."""

    def __init__(self, manager, type_):
        super().__init__(manager, type_, manager.lookup(type_.dtype).get_data_type().as_pointer())


@register_model(Matrix)
class MatrixModel(models.StructModel):
    """The numba data model of a `Matrix`: the address of the first row, and the length of a row."""

    def __init__(self, manager, type_):
        super().__init__(manager, type_, [("first", type_.row), ("width", types.intp)])


# --- entries

FIRST = {"target": "cpu"}
"""Options of typing declarations. numba tries those with the most specific target first."""


@infer_global(operator.getitem)
class ReadTyping(AbstractTemplate):
    """The numba typing of `array[index]` for vectors and matrices. numba tries it before dozens of its own typings."""

    metadata = FIRST

    def generic(self, args, kws):
        array, place = args
        if isinstance(array, Vector) and isinstance(place, types.Integer):
            return signature(array.dtype, array, types.intp)
        if isinstance(array, Matrix) and isinstance(place, types.Integer):
            return signature(array.row, array, types.intp)
        if isinstance(array, Matrix) and isinstance(place, types.BaseTuple):
            return signature(array.dtype, array, types.UniTuple(types.intp, 2))
        return None


@infer_global(operator.setitem)
class WriteTyping(AbstractTemplate):
    """The numba typing of `array[index] = value` for vectors and matrices."""

    metadata = FIRST

    def generic(self, args, kws):
        array, place, _ = args
        if isinstance(array, Vector) and isinstance(place, types.Integer):
            return signature(types.none, array, types.intp, array.dtype)
        if isinstance(array, Matrix) and isinstance(place, types.BaseTuple):
            return signature(types.none, array, types.UniTuple(types.intp, 2), array.dtype)
        return None


def emit_address(context, builder, array_type, array, place):
    """Emit code that computes the address of an entry, or of a row if a matrix has only one index."""
    if isinstance(array_type, Vector):
        return builder.gep(array, [place], inbounds=True)
    matrix = create_struct_proxy(array_type)(context, builder, array)
    if not isinstance(place.type, ir.ArrayType):
        return builder.gep(matrix.first, [builder.mul(place, matrix.width)], inbounds=True)
    row, column = (builder.extract_value(place, number) for number in range(2))
    return builder.gep(matrix.first, [builder.add(builder.mul(row, matrix.width), column)], inbounds=True)


@lower_builtin(operator.getitem, Vector, types.Integer)
@lower_builtin(operator.getitem, Matrix, types.BaseTuple)
def emit_load(context, builder, sig, args):
    """Emit code that loads an entry of a vector or matrix."""
    address = emit_address(context, builder, sig.args[0], *args)
    loaded = builder.load(address)
    row = sig.args[0] if isinstance(sig.args[0], Vector) else sig.args[0].row
    if row.fixed:
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return context.data_model_manager[row.dtype].from_data(builder, loaded)


@lower_builtin(operator.getitem, Matrix, types.Integer)
def emit_row_address(context, builder, sig, args):
    """Emit code that computes the address of a row of a matrix."""
    return emit_address(context, builder, sig.args[0], *args)


@lower_builtin(operator.setitem, Vector, types.Integer, types.Any)
@lower_builtin(operator.setitem, Matrix, types.BaseTuple, types.Any)
def emit_store(context, builder, sig, args):
    """Emit code that stores a value in an entry of a vector or matrix."""
    address = emit_address(context, builder, sig.args[0], *args[:2])
    builder.store(context.data_model_manager[sig.args[2]].as_data(builder, args[2]), address)


# --- operators of numbers


def declare_operator(symbol, result=None):
    """Declare the typing of an operator of two ints or two floats, as numba's own, which it finds after dozens."""

    @infer_global(symbol)
    class OperatorTyping(AbstractTemplate):
        metadata = FIRST

        def generic(self, args, kws):
            given = {types.unliteral(each) for each in args}
            if len(args) == 2 and given in ({types.int64}, {types.float64}):
                (type_,) = given
                return signature(result or type_, type_, type_)
            return None


for name in ("add", "sub", "mul", "iadd", "isub"):
    declare_operator(getattr(operator, name))
for name in ("eq", "ne", "lt", "le", "gt", "ge"):
    declare_operator(getattr(operator, name), types.boolean)


# --- arrays


def data_and_shape(context, builder, array_type, array):
    """Return the LLVM values of a NumPy array's address and of its shape."""
    held = create_struct_proxy(array_type)(context, builder, array)
    return held.data, held.shape


def emit_matrix(context, builder, type_, first, width):
    """Emit code that builds a matrix from the address of its first row and the length of a row."""
    matrix = create_struct_proxy(type_)(context, builder)
    matrix.first, matrix.width = first, width
    return matrix._getvalue()


@intrinsic
def vector(typing, array):
    """Convert an array of NumPy with one axis to a `Vector` on the same memory."""

    def code(context, builder, sig, args):
        return data_and_shape(context, builder, array, args[0])[0]

    return Vector(array.dtype, False)(array), code


@intrinsic
def matrix(typing, array):
    """Convert an array of NumPy with two axes to a `Matrix` on the same memory. The program may write into it."""
    return matrix_intrinsic(array, False)


@intrinsic
def fixed(typing, array):
    """Convert an array of NumPy with two axes to a `Matrix` on the same memory. The program must not write into it."""
    return matrix_intrinsic(array, True)


def matrix_intrinsic(array, is_fixed):
    """Return the signature of an intrinsic that converts an array to a `Matrix`, and the emitter of its code."""

    def code(context, builder, sig, args):
        first, shape = data_and_shape(context, builder, array, args[0])
        return emit_matrix(context, builder, sig.return_type, first, builder.extract_value(shape, 1))

    return Matrix(array.dtype, is_fixed)(array), code


@intrinsic
def width(typing, array):
    """Return the length of a row of a matrix."""

    def code(context, builder, sig, args):
        return create_struct_proxy(array)(context, builder, args[0]).width

    return types.intp(array), code


TABLES, REALS = Matrix(types.int32, True), Matrix(types.float64, True)
INTS, FLOATS, WORDS = (Matrix(each, False) for each in (types.int64, types.float64, types.uint64))
INT, FLOAT, BOOL = (Vector(each, False) for each in (types.int64, types.float64, types.bool_))
GIVEN = TABLES, REALS, Vector(types.int64, True), INTS, FLOATS, INTS, FLOATS, FLOAT, INT, INTS, FLOATS, WORDS
HOT, COLUMNS = Matrix(types.float32, False), Vector(types.int64, True)
BATCH = types.Tuple((*GIVEN, INTS, INT, BOOL, INT, FLOAT, INT, BOOL, FLOAT, INT, HOT, INTS, FLOATS, COLUMNS, INT))
"""The types of the arrays of a batch, in the order of `BatchArrays`."""


@intrinsic
def arrays_at(typing, address):
    """Return a tuple of the arrays of a batch. `address` is that of a table with the address and shape of each array.

    Programs are given the address alone, because numba takes longer to unpack an array.
    """

    def code(context, builder, sig, args):
        numbers = builder.inttoptr(args[0], ir.IntType(64).as_pointer())
        found = []
        for row, type_ in enumerate(BATCH):
            address, width = (
                builder.load(builder.gep(numbers, [context.get_constant(types.intp, 3 * row + column)]))
                for column in (0, 2)
            )
            held = type_.row if isinstance(type_, Matrix) else type_
            first = builder.inttoptr(address, context.get_value_type(held))
            found.append(emit_matrix(context, builder, type_, first, width) if held is not type_ else first)
        return context.make_tuple(builder, BATCH, found)

    return BATCH(types.int64), code


# --- bits


def int_intrinsic(count, code):
    """Return an intrinsic function that applies the emitter `code` to `count` (1 or 2) 64-bit integers."""

    @intrinsic
    def one(typing, word):
        return types.int64(types.int64), lambda context, builder, sig, args: code(builder, *args)

    @intrinsic
    def two(typing, word, place):
        return types.int64(types.int64, types.int64), lambda context, builder, sig, args: code(builder, *args)

    return one if count == 1 else two


def emit_bit_index(builder, place):
    """Emit code that computes the index of a bit within a 32-bit word: `place` modulo 32."""
    return builder.and_(place, ir.Constant(place.type, 31))


ONE = ir.Constant(ir.IntType(64), 1)
bit = int_intrinsic(
    2, lambda builder, word, place: builder.and_(builder.ashr(word, emit_bit_index(builder, place)), ONE)
)
bit_at = int_intrinsic(1, lambda builder, place: builder.shl(ONE, emit_bit_index(builder, place)))
count_bits = int_intrinsic(1, lambda builder, word: builder.ctpop(word))
lowest_bit = int_intrinsic(1, lambda builder, word: builder.cttz(word, ir.Constant(ir.IntType(1), 0)))


# --- numbers


def checked_intrinsic(operation):
    """Return an intrinsic function of two ints: the last 64 bits of the result, and True if it has more."""

    @intrinsic
    def checked(typing, left, right):
        def code(context, builder, sig, args):
            pair = getattr(builder, operation)(*args)
            return context.make_tuple(builder, sig.return_type, [builder.extract_value(pair, n) for n in range(2)])

        return types.Tuple((types.int64, types.bool_))(types.int64, types.int64), code

    return checked


def float_function(name, count=1):
    """Return a function of the C library of `count` floats.

    LLVM must not know the function by its name: it would compute `pow(x, 2.0)` as `x * x`, which rounds otherwise.
    """
    binding.add_symbol(f"envgraph_{name}", _helperlib.c_helpers[name])
    return types.ExternalFunction(f"envgraph_{name}", types.float64(*[types.float64] * count))


add_checked, subtract_checked, multiply_checked = map(
    checked_intrinsic, ("sadd_with_overflow", "ssub_with_overflow", "smul_with_overflow")
)
exp, log, sqrt, pow = float_function("exp"), float_function("log"), float_function("sqrt"), float_function("pow", 2)
