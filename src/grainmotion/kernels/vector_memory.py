"""Reading and writing the vectors of `kernels.vectors` in flat arrays.

Neighbours are read and written at once, in as few instructions as the processor allows.  Elements that do not lie
together are read one by one, or two neighbours by one load: a processor's own instruction for all of them (a gather) is
slow on many, and is missing on some.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types

from grainmotion.kernels.vectors import Vector, compiled, compiled_type, constant, element

_INDEX = ir.IntType(64)


def _is_flat(array):
    return isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"


def _element(call, offset=0):
    """Address of the element that the second argument numbers, or of one after it, in the first, an array."""
    data = call.context.make_array(call.kinds[0])(call.context, call.builder, value=call.values[0]).data
    number = call.cast(1, types.int64)
    return call.builder.gep(data, [call.builder.add(number, ir.Constant(_INDEX, offset)) if offset else number])


def _bytes(dtype):
    return dtype.bitwidth // 8


def loaded(array, start, width):
    """So many elements of an array, from ``start``."""
    return array[start : start + width].copy()


def _loaded_type(array, start, width):
    if not (_is_flat(array) and isinstance(width, types.IntegerLiteral)):
        return None
    return Vector(array.dtype, width.literal_value)


def _loaded(call):
    kind = call.result
    address = call.builder.bitcast(_element(call), compiled_type(kind.dtype, kind.width).as_pointer())
    return call.builder.load(address, align=_bytes(kind.dtype))


compiled(loaded, _loaded_type, _loaded)


def stored(array, start, x):
    """Put all lanes in an array, from ``start``."""
    array[start : start + len(x)] = x


def stored_first(array, start, x, count):
    """Put the first ``count`` lanes, all at most, in an array, from ``start``."""
    array[start : start + count] = x[:count]


def _store(call, x, address):
    """Lanes to an address, which need not be aligned to more than a number."""
    call.builder.store(x, call.builder.bitcast(address, x.type.as_pointer()), align=_bytes(call.kinds[0].dtype))


def _stored(call):
    _store(call, call.lanes(2, call.kinds[0].dtype), _element(call))
    return call.context.get_dummy_value()


def _stored_first(call):
    builder, dtype = call.builder, call.kinds[0].dtype
    address, count = _element(call), call.cast(3, types.int64)
    x = call.lanes(2, dtype)
    whole = builder.icmp_signed(">=", count, ir.Constant(_INDEX, call.width))
    with builder.if_else(whole) as (all_lanes, some_lanes):
        with all_lanes:
            _store(call, x, address)
        with some_lanes:
            copy = cgutils.alloca_once_value(builder, x)
            first = builder.bitcast(copy, address.type)
            cgutils.raw_memcpy(builder, address, first, count, _bytes(dtype))
    return call.context.get_dummy_value()


compiled(stored, lambda array, start, x: types.none if _is_flat(array) else None, _stored)
compiled(stored_first, lambda array, start, x, count: types.none if _is_flat(array) else None, _stored_first)


def gathered(array, start, index):
    """Elements ``start + index`` of an array; ``index`` is not negative."""
    return array[start + index]


def pairs(array, start, index):
    """Elements ``start + index`` of an array, and those that follow them."""
    return array[start + index], array[start + index + 1]


def _gathered_type(array, start, index):
    return Vector(array.dtype, index.width) if _is_flat(array) else None


def _pairs_type(array, start, index):
    return types.UniTuple(Vector(array.dtype, index.width), 2) if _is_flat(array) else None


def _addresses(call, offset=0):
    """Addresses of the elements of all lanes."""
    builder, first, count = call.builder, _element(call, offset), call.width // 2
    twos = builder.bitcast(call.values[2], ir.VectorType(_INDEX, count))  # two indices leave a vector at once
    low, shift = ir.Constant(_INDEX, 0xFFFFFFFF), ir.Constant(_INDEX, 32)
    places = []
    for k in range(count):
        two = builder.extract_element(twos, element(k))
        places += [builder.gep(first, [i]) for i in (builder.and_(two, low), builder.lshr(two, shift))]
    return places


def _gathered(call, offset=0):
    found = ir.Constant(compiled_type(call.kinds[0].dtype, call.width), ir.Undefined)
    for k, address in enumerate(_addresses(call, offset)):
        found = call.builder.insert_element(found, call.builder.load(address), element(k))
    return found


def _both_of_pairs(call):
    """Two neighbouring float32 are read like one float64: eight loads make two vectors of eight, instead of sixteen."""
    builder, dtype, width = call.builder, call.kinds[0].dtype, call.width
    kind = compiled_type(dtype, width)
    if dtype == types.float32:
        double, addresses = ir.DoubleType(), _addresses(call)
        halves = []
        for half in (0, 2):  # of four neighbouring lanes: so that no shuffle crosses the middle of a vector
            lanes = [k for k in range(width) if k % 4 in (half, half + 1)]
            read = ir.Constant(ir.VectorType(double, width // 2), ir.Undefined)
            for k, lane in enumerate(lanes):
                pair = builder.load(builder.bitcast(addresses[lane], double.as_pointer()), align=4)
                read = builder.insert_element(read, pair, element(k))
            halves.append(builder.bitcast(read, kind))
        firsts = [k + s for k in range(0, width, 4) for s in (0, 2, width, width + 2)]
        found = [builder.shuffle_vector(*halves, constant(*(k + s for k in firsts))) for s in (0, 1)]
    else:
        found = [_gathered(call), _gathered(call, 1)]
    return call.context.make_tuple(builder, types.UniTuple(Vector(dtype, width), 2), found)


compiled(gathered, _gathered_type, _gathered)
compiled(pairs, _pairs_type, _both_of_pairs)


def prefetch(array, at):
    """Tell the processor that ``array[at]`` and its neighbours are read soon; any index may be given."""


def _prefetch(call):
    number = ir.IntType(32)
    pointer = call.builder.bitcast(_element(call), ir.IntType(8).as_pointer())
    kind = ir.FunctionType(ir.VoidType(), [pointer.type, number, number, number])
    function = call.builder.module.declare_intrinsic("llvm.prefetch.p0", fnty=kind)
    call.builder.call(function, [pointer, *(ir.Constant(number, k) for k in (0, 3, 1))])  # data, to be read, kept close
    return call.context.get_dummy_value()


compiled(prefetch, lambda array, at: types.none if _is_flat(array) else None, _prefetch)
