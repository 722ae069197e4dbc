"""Reading and writing the eight numbers of `kernels.packets` in flat arrays.

Elements that do not lie together are read one by one, or two neighbours by one load: a processor's own instruction
for eight of them (a gather) is slow on many, and is missing on some.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types

from grainmotion.kernels.packets import PACKET_SIZE, Packet, compiled, constant, element, vector

_INDEX = ir.IntType(64)


def _element(call, offset=0):
    """Address of the element that the second argument numbers, or of one after it, in the first, an array."""
    data = call.context.make_array(call.kinds[0])(call.context, call.builder, value=call.values[0]).data
    number = call.builder.add(call.cast(1, types.int64), ir.Constant(_INDEX, offset))
    return call.builder.gep(data, [number])


def _bytes(dtype):
    return dtype.bitwidth // 8


def loaded(array, start):
    """Eight elements of an array, from ``start``."""
    return array[start : start + PACKET_SIZE]


def _loaded(call):
    dtype = call.kinds[0].dtype
    address = call.builder.bitcast(_element(call), vector(dtype).as_pointer())
    return call.builder.load(address, align=_bytes(dtype))


compiled(loaded, lambda array, start: Packet(array.dtype), _loaded)


def stored(array, start, count, x):
    """Put the first ``count`` lanes, all eight at most, in an array, from ``start``."""
    array[start : start + count] = x[:count]


def _stored(call):
    builder, dtype = call.builder, call.kinds[0].dtype
    address, count = _element(call), call.cast(2, types.int64)
    x = call.lanes(3, dtype)
    whole = builder.icmp_signed(">=", count, ir.Constant(_INDEX, PACKET_SIZE))
    with builder.if_else(whole) as (all_lanes, some_lanes):
        with all_lanes:
            builder.store(x, builder.bitcast(address, x.type.as_pointer()), align=_bytes(dtype))
        with some_lanes:
            copy = cgutils.alloca_once_value(builder, x)
            first = builder.bitcast(copy, address.type)
            cgutils.raw_memcpy(builder, address, first, count, _bytes(dtype))
    return call.context.get_dummy_value()


compiled(stored, lambda array, start, count, x: types.none, _stored)


def gathered(array, start, index):
    """Elements ``start + index`` of an array; ``index`` is not negative."""
    return array[start + index]


def pairs(array, start, index):
    """Elements ``start + index`` of an array, and those that follow them."""
    return array[start + index], array[start + index + 1]


def _addresses(call, offset=0):
    """Addresses of the elements of all lanes."""
    builder, first = call.builder, _element(call, offset)
    twos = builder.bitcast(
        call.values[2], ir.VectorType(_INDEX, PACKET_SIZE // 2)
    )  # two indices leave a vector at once
    low, shift = ir.Constant(_INDEX, 0xFFFFFFFF), ir.Constant(_INDEX, 32)
    places = []
    for k in range(PACKET_SIZE // 2):
        two = builder.extract_element(twos, element(k))
        places += [builder.gep(first, [i]) for i in (builder.and_(two, low), builder.lshr(two, shift))]
    return places


def _gathered(call, offset=0):
    found = ir.Constant(vector(call.kinds[0].dtype), ir.Undefined)
    for k, address in enumerate(_addresses(call, offset)):
        found = call.builder.insert_element(found, call.builder.load(address), element(k))
    return found


def _both_of_pairs(call):
    """Two neighbouring float32 are read like one float64: eight loads make two vectors, instead of sixteen."""
    builder, dtype = call.builder, call.kinds[0].dtype
    if dtype == types.float32:
        double, addresses = ir.DoubleType(), _addresses(call)
        halves = []
        for order in ((0, 1, 4, 5), (2, 3, 6, 7)):  # so that either half of the results is made of the same half here
            four = ir.Constant(ir.VectorType(double, 4), ir.Undefined)
            for k, lane in enumerate(order):
                pair = builder.load(builder.bitcast(addresses[lane], double.as_pointer()), align=4)
                four = builder.insert_element(four, pair, element(k))
            halves.append(builder.bitcast(four, vector(dtype)))
        orders = [[s + k for k in (0, 2, 8, 10, 4, 6, 12, 14)] for s in (0, 1)]
        found = [builder.shuffle_vector(*halves, constant(*order)) for order in orders]
    else:
        found = [_gathered(call), _gathered(call, 1)]
    return call.context.make_tuple(builder, types.UniTuple(Packet(dtype), 2), found)


compiled(gathered, lambda array, start, index: Packet(array.dtype), _gathered)
compiled(pairs, lambda array, start, index: types.UniTuple(Packet(array.dtype), 2), _both_of_pairs)
