"""Vectors of some numbers, as values of compiled code: the processor works on all of them at once.

Numba leaves it to LLVM whether a loop becomes vector instructions, and how.  With these types it always does, whatever
width the processor's own vectors have.  Their width is part of their type: volumes are projected sixteen neighbouring
rays at a time (`kernels.vertical_trilinear`), grains eight (`kernels.grain_ray_packets`).  A vector's numbers, its
lanes, are float32, float64, int32 or truth values.  `spread` and `counted` of `kernels.vector_functions` make vectors,
as does reading from arrays (`kernels.vector_memory`); they are combined by ``+ - * /``, comparisons, ``&``, and the
functions there, also with single numbers, which are rounded to the lanes' precision.  A product and a sum may be
rounded once for both; nothing else is reordered.

Without compilation (``NUMBA_DISABLE_JIT``) vectors are arrays of NumPy.
"""

from __future__ import annotations

import operator

from llvmlite import ir
from numba.core import types
from numba.core.datamodel import models
from numba.extending import lower_builtin, register_model, type_callable

_FUSED = ("contract",)
_NUMBER_TYPES = {
    types.float32: ir.FloatType(),
    types.float64: ir.DoubleType(),
    types.int32: ir.IntType(32),
    types.boolean: ir.IntType(1),
}


class Vector(types.Type):
    """The type of ``width`` numbers of a kind."""

    def __init__(self, dtype, width):
        self.dtype, self.width = dtype, width
        super().__init__(name=f"Vector({dtype}, {width})")


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, compiled_type(kind.dtype, kind.width))


def compiled_type(dtype, width):
    """LLVM's type of so many numbers of a kind."""
    return ir.VectorType(_NUMBER_TYPES[dtype], width)


def constant(*numbers):
    """A vector of int32, as which numbers of elements are given."""
    return ir.Constant(ir.VectorType(ir.IntType(32), len(numbers)), list(numbers))


def element(k):
    """The number of an element."""
    return ir.Constant(ir.IntType(32), k)


class Call:
    """A call in compiled code: where its instructions go, its arguments' types and LLVM values, and its result's type.

    ``width`` is that of the result, or of the first argument that is a vector.
    """

    def __init__(self, context, builder, signature, values):
        self.context, self.builder = context, builder
        self.kinds, self.values, self.result = signature.args, values, signature.return_type
        vectors = [k for k in (self.result, *self.kinds) if isinstance(k, Vector)]
        self.width = vectors[0].width if vectors else 0

    def cast(self, k, kind):
        """Argument k as a single number of a kind."""
        return self.context.cast(self.builder, self.values[k], self.kinds[k], kind)

    def lanes(self, k, dtype):
        """Argument k, a vector or a single number, as a vector of numbers of a kind."""
        if not isinstance(self.kinds[k], Vector):
            return self.spread(self.cast(k, dtype))
        source, value, kind = self.kinds[k].dtype, self.values[k], compiled_type(dtype, self.width)
        if source == dtype:
            return value
        if source == types.int32:
            return self.builder.sitofp(value, kind)
        if dtype == types.int32:
            return self.builder.fptosi(value, kind)
        return (self.builder.fpext if dtype == types.float64 else self.builder.fptrunc)(value, kind)

    def spread(self, value):
        """The same number in every lane."""
        unset = ir.Constant(ir.VectorType(value.type, self.width), ir.Undefined)
        first = self.builder.insert_element(unset, value, element(0))
        return self.builder.shuffle_vector(first, unset, constant(*[0] * self.width))

    def compared(self, sign, a, b, dtype):
        """Truth values of a comparison of two vectors of a kind."""
        compare = self.builder.icmp_signed if dtype == types.int32 else self.builder.fcmp_ordered
        return compare(sign, a, b)

    def both(self):
        """The first two arguments as vectors, and the kind of their numbers."""
        dtype = common(*self.kinds[:2]).dtype
        return self.lanes(0, dtype), self.lanes(1, dtype), dtype

    def intrinsic(self, name):
        """LLVM's function of a vector, of the first argument."""
        value, single = self.values[0], self.kinds[0].dtype == types.float32
        name = f"llvm.{name}.v{self.width}f{32 if single else 64}"
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


def common(a, b):
    """The vector type among the types of two arguments, if it is one and the other is the same or a number."""
    found = {k for k in (a, b) if isinstance(k, Vector)}
    fit = all(isinstance(k, (Vector, types.Number)) for k in (a, b))
    return found.pop() if len(found) == 1 and fit else None


def _truth(a, b):
    kind = common(a, b)
    return None if kind is None else Vector(types.boolean, kind.width)


def _binary(function, result, generate):
    """`compiled`, for an operator of two vectors, or of a vector and a number."""
    for kinds in ((Vector, Vector), (Vector, types.Number), (types.Number, Vector)):
        compiled(function, result, generate, *kinds)


def _arithmetic(of_floats, of_integers):
    def generate(call):
        a, b, dtype = call.both()
        if dtype == types.int32:
            return getattr(call.builder, of_integers)(a, b)
        return getattr(call.builder, of_floats)(a, b, flags=_FUSED)

    return generate


def _comparison(sign):
    return lambda call: call.compared(sign, *call.both())


_binary(operator.add, common, _arithmetic("fadd", "add"))
_binary(operator.sub, common, _arithmetic("fsub", "sub"))
_binary(operator.mul, common, _arithmetic("fmul", "mul"))
_binary(operator.truediv, common, _arithmetic("fdiv", "sdiv"))
for _sign, _function in (
    ("<", operator.lt),
    ("<=", operator.le),
    (">", operator.gt),
    (">=", operator.ge),
    ("!=", operator.ne),
):
    _binary(_function, _truth, _comparison(_sign))
compiled(operator.and_, common, lambda call: call.builder.and_(*call.values), Vector, Vector)
compiled(operator.neg, lambda a: a if isinstance(a, Vector) else None, lambda c: c.builder.fneg(c.values[0]), Vector)
