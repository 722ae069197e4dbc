"""Sixteen neighbouring values of an array at once, in registers as wide as the processor has.

A loop over rows whose reads move from place to place makes the compiler gather values one by one, which few processors
do quickly.  Here the reads of a step are neighbours in memory, and the code says so: `load` takes sixteen values in
as few instructions as the target allows, whatever its width.  Values are added and multiplied lane by lane with the
usual operators; without compilation they are arrays of numpy.
"""

from __future__ import annotations

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, overload, register_model, type_callable

LANES = 16


def load(array, at):
    """Values ``array[at : at + LANES]``."""
    return array[at : at + LANES].copy()


def store(array, at, values):
    """Write ``array[at : at + LANES]``."""
    array[at : at + LANES] = values


def splat(value):
    """The same value in every lane."""
    return np.full(LANES, value)


def ramp(value):
    """0, 1, 2 … LANES − 1, in the precision of ``value``."""
    return np.arange(LANES).astype(np.asarray(value).dtype)


def smaller(a, b):
    """The smaller of each lane."""
    return np.minimum(a, b)


def larger(a, b):
    """The larger of each lane."""
    return np.maximum(a, b)


def absolute(a):
    """|a| of each lane."""
    return np.abs(a)


def prefetch(array, at):
    """Tell the processor that ``array[at]`` and its neighbours are read soon; any index may be given."""


# ---------------------------------------------------------------------- the same, compiled
class LanesType(types.Type):
    """Type of `LANES` values of one precision."""

    def __init__(self, dtype):
        self.dtype = dtype
        super().__init__(name=f"Lanes({dtype})")


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, ir.VectorType(_scalar(fe_type.dtype), LANES))


def _scalar(dtype):
    return ir.FloatType() if dtype == types.float32 else ir.DoubleType()


def _pointer(context, builder, array_type, array, at):
    """Address of ``array[at]``, which need not be aligned to more than a value, for `LANES` values."""
    data = context.make_array(array_type)(context, builder, array).data
    vector = ir.VectorType(_scalar(array_type.dtype), LANES)
    return builder.bitcast(builder.gep(data, [at]), vector.as_pointer()), array_type.dtype.bitwidth // 8


def _is_line(array):
    return isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"


@intrinsic
def _load(typing, array, at):
    if not _is_line(array):
        return None

    def generate(context, builder, signature, arguments):
        place = context.cast(builder, arguments[1], signature.args[1], types.intp)
        pointer, alignment = _pointer(context, builder, signature.args[0], arguments[0], place)
        return builder.load(pointer, align=alignment)

    return LanesType(array.dtype)(array, at), generate


@intrinsic
def _store(typing, array, at, values):
    if not _is_line(array):
        return None

    def generate(context, builder, signature, arguments):
        place = context.cast(builder, arguments[1], signature.args[1], types.intp)
        pointer, alignment = _pointer(context, builder, signature.args[0], arguments[0], place)
        builder.store(arguments[2], pointer, align=alignment)
        return context.get_dummy_value()

    return types.void(array, at, values), generate


@intrinsic
def _splat(typing, value):
    def generate(context, builder, signature, arguments):
        kind = ir.VectorType(_scalar(signature.args[0]), LANES)
        one = builder.insert_element(ir.Constant(kind, ir.Undefined), arguments[0], ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), zeros)

    return LanesType(value)(value), generate


@intrinsic
def _ramp(typing, value):
    def generate(context, builder, signature, arguments):
        return ir.Constant(ir.VectorType(_scalar(signature.args[0]), LANES), [float(k) for k in range(LANES)])

    return LanesType(value)(value), generate


def _choice(comparison):
    @intrinsic
    def choose(typing, a, b):
        def generate(context, builder, signature, arguments):
            a, b = arguments
            return builder.select(builder.fcmp_ordered(comparison, a, b), a, b)

        return a(a, b), generate

    return choose


_smaller, _larger = _choice("<"), _choice(">")


@intrinsic
def _absolute(typing, a):
    def generate(context, builder, signature, arguments):
        kind = arguments[0].type
        name = f"llvm.fabs.v{LANES}f{signature.return_type.dtype.bitwidth}"
        function = builder.module.declare_intrinsic(name, fnty=ir.FunctionType(kind, [kind]))
        return builder.call(function, arguments)

    return a(a), generate


@overload(load, inline="always")
def _compiled_load(array, at):
    return lambda array, at: _load(array, at)


@overload(store, inline="always")
def _compiled_store(array, at, values):
    return lambda array, at, values: _store(array, at, values)


@overload(splat, inline="always")
def _compiled_splat(value):
    return lambda value: _splat(value)


@overload(ramp, inline="always")
def _compiled_ramp(value):
    return lambda value: _ramp(value)


@overload(smaller, inline="always")
def _compiled_smaller(a, b):
    return lambda a, b: _smaller(a, b)


@overload(larger, inline="always")
def _compiled_larger(a, b):
    return lambda a, b: _larger(a, b)


@intrinsic
def _prefetch(typing, array, at):
    if not _is_line(array):
        return None

    def generate(context, builder, signature, arguments):
        place = context.cast(builder, arguments[1], signature.args[1], types.intp)
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        number = ir.IntType(32)
        pointer = builder.bitcast(builder.gep(data, [place]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch.p0", fnty=kind)
        builder.call(function, [pointer, *(ir.Constant(number, k) for k in (0, 3, 1))])  # data, to be read, kept close
        return context.get_dummy_value()

    return types.void(array, at), generate


@overload(prefetch, inline="always")
def _compiled_prefetch(array, at):
    return lambda array, at: _prefetch(array, at)


@overload(absolute, inline="always")
def _compiled_absolute(a):
    return lambda a: _absolute(a)


def _arithmetic(symbol, instruction):
    """An operator between lanes; the compiler may join it with another to one instruction."""

    @type_callable(symbol)
    def _type(context):
        def typer(a, b):
            if isinstance(a, LanesType) and a == b:
                return a
            return None

        return typer

    @lower_builtin(symbol, LanesType, LanesType)
    def _lower(context, builder, signature, arguments):
        return getattr(builder, instruction)(*arguments, flags=("contract",))


for _symbol, _instruction in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _arithmetic(_symbol, _instruction)
