"""Vectors of eight numbers, as values of compiled code: the processor works on all of them at once.

Numba leaves it to LLVM whether a loop becomes vector instructions, and how.  With these types it always does, and
eight rays are traced by the code of one.  Lanes hold float32, float64, int32 or truth values.  `spread` and `counted`
make them, as does reading from arrays (`kernels.packet_memory`); they are combined by ``+ - * /``, comparisons, ``&``,
``|`` and the functions below, also with single numbers, which are rounded to the lanes' precision.  A product and a
sum may be rounded once for both; nothing else is reordered.

Without compilation (``NUMBA_DISABLE_JIT``) lanes are NumPy arrays of eight.
"""

from __future__ import annotations

import operator

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.datamodel import models
from numba.extending import lower_builtin, register_model, type_callable

PACKET_SIZE = 8
_FUSED = ("contract",)
_NUMBER_TYPES = {
    types.float32: ir.FloatType(),
    types.float64: ir.DoubleType(),
    types.int32: ir.IntType(32),
    types.boolean: ir.IntType(1),
}


class Packet(types.Type):
    """The type of eight numbers of a kind."""

    def __init__(self, dtype):
        self.dtype = dtype
        super().__init__(name=f"Packet({dtype})")


def vector(dtype):
    """LLVM's type of eight numbers."""
    return ir.VectorType(_NUMBER_TYPES[dtype], PACKET_SIZE)


@register_model(Packet)
class _PacketModel(models.PrimitiveModel):
    def __init__(self, manager, packet):
        super().__init__(manager, packet, vector(packet.dtype))


def constant(*numbers):
    """A vector of int32, as which numbers of elements are given."""
    return ir.Constant(ir.VectorType(ir.IntType(32), len(numbers)), list(numbers))


def element(k):
    """The number of an element."""
    return ir.Constant(ir.IntType(32), k)


class Call:
    """A call in compiled code: where its instructions go, and its arguments' types and LLVM values."""

    def __init__(self, context, builder, signature, values):
        self.context, self.builder = context, builder
        self.kinds, self.values = signature.args, values

    def cast(self, k, kind):
        """Argument k as a single number of a kind."""
        return self.context.cast(self.builder, self.values[k], self.kinds[k], kind)

    def lanes(self, k, dtype):
        """Argument k, lanes or a single number, as lanes of numbers of a kind."""
        if not isinstance(self.kinds[k], Packet):
            return self.spread(self.cast(k, dtype))
        source, value = self.kinds[k].dtype, self.values[k]
        if source == dtype:
            return value
        if source == types.int32:
            return self.builder.sitofp(value, vector(dtype))
        if dtype == types.int32:
            return self.builder.fptosi(value, vector(dtype))
        return (self.builder.fpext if dtype == types.float64 else self.builder.fptrunc)(value, vector(dtype))

    def spread(self, value):
        """The same number eight times."""
        unset = ir.Constant(ir.VectorType(value.type, PACKET_SIZE), ir.Undefined)
        return self.builder.shuffle_vector(
            self.builder.insert_element(unset, value, element(0)), unset, constant(*[0] * PACKET_SIZE)
        )

    def intrinsic(self, name):
        """LLVM's function of a vector, of the first argument."""
        value, single = self.values[0], self.kinds[0].dtype == types.float32
        name = f"llvm.{name}.v{PACKET_SIZE}f{32 if single else 64}"
        kind = ir.FunctionType(value.type, [value.type])
        function = self.builder.module.globals.get(name) or ir.Function(self.builder.module, kind, name)
        return self.builder.call(function, [value])


def compiled(function, result, generate, *kinds):
    """Let compiled code call ``function``.

    Its type is ``result(*types of arguments)``, and ``generate(call)`` makes its instructions; ``kinds`` are the
    arguments' types if others have an implementation already.
    """

    @type_callable(function)
    def typing(context):
        return result

    @lower_builtin(function, *(kinds or (types.VarArg(types.Type),)))
    def lower(context, builder, signature, values):
        return generate(Call(context, builder, signature, values))


def _common(*kinds):
    """The kind of numbers of the lanes among some arguments, if it is one, and others are numbers."""
    found = {k.dtype for k in kinds if isinstance(k, Packet)}
    fit = all(isinstance(k, (Packet, types.Number)) for k in kinds)
    return found.pop() if len(found) == 1 and fit else None


def _both(call):
    """The two arguments as lanes, and the kind of their numbers."""
    dtype = _common(*call.kinds)
    return call.lanes(0, dtype), call.lanes(1, dtype), dtype


def _binary(function, result, generate):
    """`compiled`, for an operator of two lanes, or of lanes and a number."""
    for kinds in ((Packet, Packet), (Packet, types.Number), (types.Number, Packet)):
        compiled(function, result, generate, *kinds)


def _same(a, b):
    dtype = _common(a, b)
    return None if dtype is None else Packet(dtype)


def _truth(a, b):
    return None if _common(a, b) is None else Packet(types.boolean)


def _arithmetic(of_floats, of_integers):
    def generate(call):
        a, b, dtype = _both(call)
        if dtype == types.int32:
            return getattr(call.builder, of_integers)(a, b)
        return getattr(call.builder, of_floats)(a, b, flags=_FUSED)

    return generate


def _compared(call, sign, a, b, dtype):
    compare = call.builder.icmp_signed if dtype == types.int32 else call.builder.fcmp_ordered
    return compare(sign, a, b)


def _comparison(sign):
    return lambda call: _compared(call, sign, *_both(call))


_binary(operator.add, _same, _arithmetic("fadd", "add"))
_binary(operator.sub, _same, _arithmetic("fsub", "sub"))
_binary(operator.mul, _same, _arithmetic("fmul", "mul"))
_binary(operator.truediv, _same, _arithmetic("fdiv", "sdiv"))
for _sign, _function in (
    ("<", operator.lt),
    ("<=", operator.le),
    (">", operator.gt),
    (">=", operator.ge),
    ("!=", operator.ne),
):
    _binary(_function, _truth, _comparison(_sign))
compiled(operator.and_, _same, lambda call: call.builder.and_(*call.values), Packet, Packet)
compiled(operator.neg, lambda a: a if isinstance(a, Packet) else None, lambda c: c.builder.fneg(c.values[0]), Packet)


def spread(x):
    """Eight times the same number, in double precision."""
    return np.full(PACKET_SIZE, x, np.float64)


compiled(spread, lambda x: Packet(types.float64), lambda call: call.lanes(0, types.float64))


def counted(start):
    """The numbers start, start + 1, …, in double precision."""
    return start + np.arange(PACKET_SIZE, dtype=np.float64)


def _counted(call):
    steps = call.builder.sitofp(constant(*range(PACKET_SIZE)), vector(types.float64))
    return call.builder.fadd(call.lanes(0, types.float64), steps)


compiled(counted, lambda start: Packet(types.float64), _counted)


def as_double(x):
    """Lanes in double precision."""
    return np.asarray(x).astype(np.float64)


compiled(as_double, lambda x: Packet(types.float64), lambda call: call.lanes(0, types.float64))


def as_precision(x, array):
    """Lanes in the precision of an array."""
    return np.asarray(x).astype(array.dtype)


compiled(as_precision, lambda x, array: Packet(array.dtype), lambda call: call.lanes(0, call.kinds[1].dtype))


def truncated(x):
    """x without its fraction, as int32."""
    return np.trunc(x).astype(np.int32)


compiled(truncated, lambda x: Packet(types.int32), lambda call: call.lanes(0, types.int32))


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
    dtype = _common(*call.kinds[1:])
    return call.builder.select(call.values[0], call.lanes(1, dtype), call.lanes(2, dtype))


compiled(where, lambda mask, a, b: _same(a, b), _where)


def minimum(a, b):
    """The smaller number in each lane."""
    return np.minimum(a, b)


def maximum(a, b):
    """The larger number in each lane."""
    return np.maximum(a, b)


def _chosen(sign):
    def generate(call):
        a, b, dtype = _both(call)
        return call.builder.select(_compared(call, sign, a, b, dtype), a, b)

    return generate


compiled(minimum, _same, _chosen("<"))
compiled(maximum, _same, _chosen(">"))


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
    bits = ir.IntType(PACKET_SIZE)
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
        rest, dtype, width = call.values[0], call.kinds[0].dtype, PACKET_SIZE // 2
        while width:
            a, b = (call.builder.shuffle_vector(rest, rest, constant(*range(s, s + width))) for s in (0, width))
            rest, width = call.builder.select(_compared(call, sign, a, b, dtype), a, b), width // 2
        return call.builder.extract_element(rest, element(0))

    return generate


compiled(least, lambda x: x.dtype, _reduced("<"))
compiled(largest, lambda x: x.dtype, _reduced(">"))
