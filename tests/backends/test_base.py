"""CPU, CUDA and Dask offer every operation of the protocol, with the same parameters."""

import inspect

import pytest

from grainmotion.backends.base import PatchBackend
from grainmotion.backends.cpu import CpuBackend
from grainmotion.cluster.dask_backend import DaskBackend

OPERATIONS = {name: member for name, member in vars(PatchBackend).items() if inspect.isfunction(member)}
OPERATIONS = {name: function for name, function in OPERATIONS.items() if not name.startswith("_")}


def cpu():
    return CpuBackend


def cuda():
    pytest.importorskip("numba.cuda", reason="numba-cuda is not installed")
    pytest.importorskip("numba_cuda", reason="numba-cuda is not installed")
    from grainmotion.backends.cuda import CudaBackend

    return CudaBackend


def dask():
    return DaskBackend


def test_protocol_has_operations():
    assert {"project", "project_with_derivatives", "vjp", "jvp", "gram_blocks"} <= OPERATIONS.keys()


@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("backend", [cpu, cuda, dask], ids=lambda backend: backend.__name__)
def test_every_backend_has_every_operation(backend, operation):
    ours = inspect.signature(getattr(backend(), operation)).parameters
    assert list(ours) == list(inspect.signature(OPERATIONS[operation]).parameters)


@pytest.mark.parametrize("backend", [cpu, cuda, dask], ids=lambda backend: backend.__name__)
def test_every_backend_says_whether_it_places_coarse_grains(backend):
    assert isinstance(backend().places_coarse_grains, bool)
