"""Every CUDA kernel compiles to PTX without a GPU; the simulator runs Python and would not find errors of types."""

from __future__ import annotations

import pytest

pytest.importorskip("numba_cuda", reason="numba-cuda is not installed: pip install grainmotion[dev]")
from numba import cuda, types

from grainmotion.kernels.cuda import device_array, filters, grain_projection, normal_equations, volume_projection

if cuda.is_available():
    pytest.skip("a GPU is available, and its tests compile the kernels", allow_module_level=True)

COMPUTE_CAPABILITY = (9, 0)
PRECISIONS = {"single": types.float32, "double": types.float64}
INT, FLOAT, BOOL = types.int64, types.float64, types.boolean


def array(element: types.Type, axes: int) -> types.Array:
    """Type of a C-contiguous array."""
    return types.Array(element, axes, "C")


def signatures(real: types.Type) -> dict[str, tuple]:
    """Every kernel and the types of its arguments, by name."""
    matrix, tables = array(FLOAT, 2), array(INT, 2)
    sides = array(types.float32, 3)
    placed = (array(INT, 1), tables, matrix, sides, matrix, array(FLOAT, 3), matrix, tables, array(INT, 1), tables,
              FLOAT, BOOL, FLOAT, FLOAT, BOOL)  # fmt: skip
    flat, patch, stack = array(real, 1), array(real, 2), array(real, 3)
    layout = (INT, INT, INT, array(FLOAT, 1))
    return {
        "fill": (device_array._fill, flat, INT),
        "project": (grain_projection._project, flat, *placed, flat),
        "differentiate": (grain_projection._project_with_derivatives, flat, *placed, flat, patch),
        "gather": (grain_projection._gather, flat, tables, array(INT, 1), array(INT, 1), array(INT, 1), stack),
        "rows": (filters._along_rows, stack, stack, flat),
        "columns": (filters._along_columns, stack, stack, flat),
        "filter": (filters._filter_patches, patch, patch, tables, array(INT, 1), stack, flat),
        "vjp": (normal_equations._vjp, patch, tables, array(INT, 1), stack, matrix),
        "jvp": (normal_equations._jvp, patch, tables, array(INT, 1), array(INT, 1), array(INT, 1), matrix, stack),
        "gram blocks": (normal_equations._gram_blocks, patch, tables, array(INT, 1), tables, array(INT, 1),
                        array(FLOAT, 3)),
        "swap": (volume_projection._swap, stack, stack),
        "swap flags": (volume_projection._swap, array(BOOL, 3), array(BOOL, 3)),
        "forward": (volume_projection._forward, flat, *layout, FLOAT, matrix, BOOL, BOOL, stack),
        "adjoint": (volume_projection._adjoint, stack, *layout, FLOAT, matrix, array(INT, 1), BOOL, BOOL, flat),
        "residual": (volume_projection._residual, flat, *layout, FLOAT, matrix, BOOL, BOOL, FLOAT, stack,
                     array(BOOL, 3), array(INT, 1), FLOAT, stack, array(FLOAT, 3)),
        "constrain": (volume_projection._constrain, flat, INT, INT, INT, INT, FLOAT, real),
        "extrapolate": (volume_projection._constrain_and_extrapolate, flat, flat, INT, INT, INT, INT, FLOAT, real,
                        real),
    }  # fmt: skip


class Gpu:
    """Properties of a GPU that the compiler asks for."""

    compute_capability = COMPUTE_CAPABILITY


@pytest.fixture
def without_gpu(monkeypatch):
    """Make numba compile for COMPUTE_CAPABILITY; skip where the compilers are not installed."""
    from numba.cuda import dispatcher
    from numba.cuda.cudadrv import nvrtc, nvvm

    try:
        nvvm.NVVM()
        nvrtc.get_supported_ccs()
    except Exception as error:
        pytest.skip(f"the CUDA compilers (nvidia-nvvm, nvidia-cuda-nvrtc) are not installed: {error}")
    monkeypatch.setattr(dispatcher, "get_current_device", Gpu)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", signatures(types.float32))
def test_kernel_compiles_to_ptx(without_gpu, name, precision):
    kernel, *arguments = signatures(PRECISIONS[precision])[name]

    code, _ = cuda.compile_ptx(kernel.py_func, tuple(arguments), cc=COMPUTE_CAPABILITY)

    assert ".target sm_90" in code
    assert ".entry" in code
    ray_tracers = {"project", "differentiate", "forward", "residual"}
    if precision == "single" and name in ray_tracers:
        loads = code.count("ld.global.f32") + code.count("ld.global.nc.f32")
        assert loads >= 8  # the image is read in its own precision, not widened
    if name == "adjoint":
        assert "atom.global.add" in code or "red.global.add" in code or "atom.add" in code
