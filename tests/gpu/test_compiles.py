"""Every kernel compiles for a real card, where there is none: the simulator runs Python and would not tell."""

from __future__ import annotations

import pytest

pytest.importorskip("numba_cuda", reason="numba-cuda is not installed: pip install grainmotion[dev]")
from numba import cuda, types

from grainmotion.kernels.cuda import device_array, filters, grain_projection, normal_equations, volume_projection

if cuda.is_available():
    pytest.skip("a card is there and compiles the kernels that it runs", allow_module_level=True)

HOPPER = (9, 0)
REAL = {"single": types.float32, "double": types.float64}
INT, FLOAT, YES = types.int64, types.float64, types.boolean


def array(of: types.Type, axes: int) -> types.Array:
    return types.Array(of, axes, "C")


def signatures(real: types.Type) -> dict[str, tuple]:
    """Every kernel with the types of its arguments."""
    whole, tables = array(FLOAT, 2), array(INT, 2)
    sides = array(types.float32, 3)
    placed = (array(INT, 1), tables, whole, sides, whole, array(FLOAT, 3), whole, tables, array(INT, 1), tables, FLOAT,
              YES, FLOAT, FLOAT, YES)  # fmt: skip
    flat, patch, stack = array(real, 1), array(real, 2), array(real, 3)
    laid = (INT, INT, INT, array(FLOAT, 1))
    return {
        "fill": (device_array._fill, flat, INT),
        "project": (grain_projection._project, flat, *placed, flat),
        "differentiate": (grain_projection._project_with_derivatives, flat, *placed, flat, patch),
        "gather": (grain_projection._gather, flat, tables, array(INT, 1), array(INT, 1), array(INT, 1), stack),
        "rows": (filters._along_rows, stack, stack, flat),
        "columns": (filters._along_columns, stack, stack, flat),
        "filter": (filters._filter_patches, patch, patch, tables, array(INT, 1), stack, flat),
        "vjp": (normal_equations._vjp, patch, tables, array(INT, 1), stack, whole),
        "jvp": (normal_equations._jvp, patch, tables, array(INT, 1), array(INT, 1), array(INT, 1), whole, stack),
        "gram blocks": (normal_equations._gram_blocks, patch, tables, array(INT, 1), tables, array(INT, 1),
                        array(FLOAT, 3)),
        "swap": (volume_projection._swap, stack, stack),
        "swap flags": (volume_projection._swap, array(YES, 3), array(YES, 3)),
        "forward": (volume_projection._forward, flat, *laid, FLOAT, whole, YES, YES, stack),
        "adjoint": (volume_projection._adjoint, stack, *laid, FLOAT, whole, array(INT, 1), YES, YES, flat),
        "residual": (volume_projection._residual, flat, *laid, FLOAT, whole, YES, YES, FLOAT, stack, array(YES, 3),
                     array(INT, 1), FLOAT, stack, array(FLOAT, 3)),
        "constrain": (volume_projection._constrain, flat, INT, INT, INT, INT, FLOAT, real),
        "extrapolate": (volume_projection._constrain_and_extrapolate, flat, flat, INT, INT, INT, INT, FLOAT, real,
                        real),
    }  # fmt: skip


class Card:
    """What the compiler asks of a card."""

    compute_capability = HOPPER


@pytest.fixture
def hopper(monkeypatch):
    """A card to compile for."""
    from numba.cuda import dispatcher
    from numba.cuda.cudadrv import nvrtc, nvvm

    try:
        nvvm.NVVM()
        nvrtc.get_supported_ccs()
    except Exception as error:
        pytest.skip(f"the compilers for cards (nvidia-nvvm, nvidia-cuda-nvrtc) are not installed: {error}")
    monkeypatch.setattr(dispatcher, "get_current_device", Card)


@pytest.mark.parametrize("precision", REAL)
@pytest.mark.parametrize("name", signatures(types.float32))
def test_kernel_compiles_to_machine_code_of_the_card(hopper, name, precision):
    kernel, *arguments = signatures(REAL[precision])[name]

    code, _ = cuda.compile_ptx(kernel.py_func, tuple(arguments), cc=HOPPER)

    assert ".target sm_90" in code
    assert ".entry" in code
    walks = {"project", "differentiate", "forward", "residual"}
    if precision == "single" and name in walks:
        loads = code.count("ld.global.f32") + code.count("ld.global.nc.f32")
        assert loads >= 8  # the image is read in its own precision, not widened
    if name == "adjoint":
        assert "atom.global.add" in code or "red.global.add" in code or "atom.add" in code
