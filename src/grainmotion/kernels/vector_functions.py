"""Functions of the vectors of `kernels.vectors`, compiled and, without compilation, of arrays of NumPy."""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import types

from grainmotion.kernels.vectors import Vector, common, compiled, compiled_type, constant, element


def _precision(x):
    """The precision of a number, which is double for whole numbers."""
    kind = np.asarray(x).dtype
    return kind if kind.kind == "f" else np.dtype(np.float64)


def _of_width(x, width):
    """Type of so many numbers in the precision of one; the width is a constant of the code."""
    if not isinstance(width, types.IntegerLiteral):
        return None
    return Vector(x if isinstance(x, types.Float) else types.float64, width.literal_value)


def _in(dtype):
    """Gives a vector's type, with numbers of another kind."""
    return lambda x: Vector(dtype, x.width) if isinstance(x, Vector) else None


def spread(x, width):
    """So many times the same number, in its precision."""
    return np.full(width, x, _precision(x))


compiled(spread, _of_width, lambda call: call.spread(call.cast(0, call.result.dtype)))


def counted(start, width):
    """The numbers start, start + 1, …, in the precision of ``start``."""
    return start + np.arange(width, dtype=_precision(start))


def _counted(call):
    dtype = call.result.dtype
    steps = call.builder.sitofp(constant(*range(call.width)), compiled_type(dtype, call.width))
    return call.builder.fadd(call.lanes(0, dtype), steps)


compiled(counted, _of_width, _counted)


def as_double(x):
    """A vector in double precision."""
    return np.asarray(x).astype(np.float64)


def as_precision(x, array):
    """A vector in the precision of an array."""
    return np.asarray(x).astype(array.dtype)


def truncated(x):
    """x without its fraction, as int32."""
    return np.trunc(x).astype(np.int32)


compiled(as_double, _in(types.float64), lambda call: call.lanes(0, types.float64))
compiled(as_precision, lambda x, array: _in(array.dtype)(x), lambda call: call.lanes(0, call.kinds[1].dtype))
compiled(truncated, _in(types.int32), lambda call: call.lanes(0, types.int32))


def inside(index, last):
    """Indices of 0 … last as they are, and last in place of all others."""
    return np.where((index >= 0) & (index <= last), index, np.int32(last))


def _inside(call):
    index, last = call.values[0], call.lanes(1, types.int32)
    below = call.builder.icmp_unsigned("<", index, last)  # a negative index is a large unsigned one
    return call.builder.select(below, index, last)


compiled(inside, lambda index, last: index, _inside)


def where(mask, a, b):
    """The lanes of ``a`` where ``mask`` holds, those of ``b`` elsewhere."""
    return np.where(mask, a, b)


def _where(call):
    dtype = call.result.dtype
    return call.builder.select(call.values[0], call.lanes(1, dtype), call.lanes(2, dtype))


compiled(where, lambda mask, a, b: common(a, b), _where)


def minimum(a, b):
    """The smaller number in each lane."""
    return np.minimum(a, b)


def maximum(a, b):
    """The larger number in each lane."""
    return np.maximum(a, b)


def _chosen(sign):
    def generate(call):
        a, b, dtype = call.both()
        return call.builder.select(call.compared(sign, a, b, dtype), a, b)

    return generate


compiled(minimum, common, _chosen("<"))
compiled(maximum, common, _chosen(">"))


def absolute(x):
    """The absolute value in each lane."""
    return np.abs(x)


def square_root(x):
    """The square root in each lane."""
    return np.sqrt(x)


compiled(absolute, lambda x: x, lambda call: call.intrinsic("fabs"))
compiled(square_root, lambda x: x, lambda call: call.intrinsic("sqrt"))


def any_lane(mask):
    """Whether a mask holds in any lane."""
    return bool(np.any(mask))


def _any_lane(call):
    bits = ir.IntType(call.width)
    return call.builder.icmp_unsigned("!=", call.builder.bitcast(call.values[0], bits), ir.Constant(bits, 0))


compiled(any_lane, lambda mask: types.boolean, _any_lane)


def least(x):
    """The smallest number of all lanes."""
    return np.min(x)


def largest(x):
    """The largest number of all lanes."""
    return np.max(x)


def _reduced(sign):
    def generate(call):
        rest, dtype, width = call.values[0], call.kinds[0].dtype, call.width // 2
        while width:
            a, b = (call.builder.shuffle_vector(rest, rest, constant(*range(s, s + width))) for s in (0, width))
            rest, width = call.builder.select(call.compared(sign, a, b, dtype), a, b), width // 2
        return call.builder.extract_element(rest, element(0))

    return generate


compiled(least, lambda x: x.dtype, _reduced("<"))
compiled(largest, lambda x: x.dtype, _reduced(">"))
