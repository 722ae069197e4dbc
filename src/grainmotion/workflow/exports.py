"""Files for other software: ParaView (``vtk``), spam (``spam``), Fiji and napari (``tiff``, ``ome-zarr``)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from grainmotion.analysis.deformed_volume import rebuild
from grainmotion.analysis.grain_mesh import GrainMesh, display_mesh, grain_mesh
from grainmotion.experiment.config import Export, OutputTable, VolumeFormat
from grainmotion.experiment.scan_tables import StateTable
from grainmotion.io.spam import write_ddic_tsv
from grainmotion.io.volumes.access import write_volume
from grainmotion.io.vtk import write_grains_vtp, write_image_vti, write_pvd, write_surfaces_vtp
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.progress import begin, counted
from grainmotion.model.volume import Volume
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.reference_stages import SegmentedReference

REFERENCE_TIFFS: tuple[str, str] = ("reference.tif", "reference_labels.tif")
REFERENCE_EXPORTS: dict[Export, tuple[str, ...]] = {
    "vtk": ("reference.vti", "reference_grains.vtp", "reference_surfaces.vtp"),
    "spam": REFERENCE_TIFFS,
    "tiff": REFERENCE_TIFFS,
    "ome-zarr": ("reference.ome.zarr/.zattrs",),
}
STATE_EXPORTS: dict[Export, tuple[str, ...]] = {"vtk": ("grains.vtp", "surfaces.vtp"), "spam": ("grains-ddic.tsv",)}
"""Files of each state; those of ``tiff`` are the rebuilt volume and its labels."""
COLLECTIONS = ("grains.pvd", "surfaces.pvd")
DEFORMED: Mapping[VolumeFormat, tuple[str, ...]] = MappingProxyType({
    "tiff": ("rebuilt.tif", "rebuilt_labels.tif"), "hdf5": ("rebuilt.h5",), "ome-zarr": ("rebuilt.ome.zarr/.zattrs",)
})  # fmt: skip
"""Files of a rebuilt volume; a folder of OME-Zarr is known by one of its files."""
RESULT_STORES = ("rebuilt.ome.zarr", "reference.ome.zarr")


class Exporter:
    """Writes what is asked for; the grains' surfaces are made once, when they are first needed."""

    def __init__(self, context: RunContext, reference: Callable[[], SegmentedReference]) -> None:
        self.context, self.reference = context, reference

    @cached_property
    def meshes(self) -> list[tuple[int, GrainMesh]]:
        """Label and mesh of each grain that has a surface."""
        begin("surfaces of the grains")
        grains = self.reference().grains
        return list(counted(display_meshes(grains), len(grains)))

    def reference_files(self, export: Export, paths: list[Path]) -> None:
        """Volume, labels and grains of the reference."""
        stored = self.reference().stored
        assert stored.labels is not None
        if export == "vtk":
            write_image_vti(paths[0], stored.volume, stored.labels)
            grains = self.reference().grains
            still = Motions.identity(grains.labels, grains.centers)
            write_grains_vtp(paths[1], still, time=0.0, reference=True)
            write_surfaces_vtp(paths[2], self.meshes, still, time=0.0, reference=True)
        else:
            _write_with_labels(paths[0], stored.volume, stored.labels)

    def state_files(self, export: Export, table: StateTable, motions: Motions, paths: list[Path]) -> None:
        """The motions of a state."""
        if export == "vtk":
            time = time_of(table, self.context.tables.states)
            write_grains_vtp(paths[0], motions, time=time)
            write_surfaces_vtp(paths[1], self.meshes, motions, time=time)
        else:
            stored, about = self.reference().stored, self.context.tables.output.spam_about
            write_ddic_tsv(paths[0], motions, stored.volume, stored.labels, about=about)

    def deformed(self, motions: Motions, paths: list[Path]) -> None:
        """The deformed volume and its labels on the reference's grid."""
        volume, labels = rebuild(self.reference().grains, motions, self.reference().stored.volume)
        _write_with_labels(paths[0], volume, labels)

    def collections(self, paths: list[Path]) -> None:
        """Collections of the points and of the surfaces, a time step a state, the reference at 0."""
        folder, states = self.context.folder, self.context.tables.states
        for k, path in enumerate(paths):
            steps = [(0.0, folder / REFERENCE_EXPORTS["vtk"][k + 1])]
            steps += [(time_of(t, states), folder / t.name / STATE_EXPORTS["vtk"][k]) for t in states]
            write_pvd(path, steps)


def exported_files(exports: Collection[str], state: str) -> list[str]:
    """Files that exports write, from the folder of the results, each once; those of a state in the folder ``state``."""
    of_reference = [name for key, names in REFERENCE_EXPORTS.items() if key in exports for name in names]
    of_state = [name for key, names in STATE_EXPORTS.items() if key in exports for name in names]
    collections = COLLECTIONS if "vtk" in exports else ()
    deformed = DEFORMED["tiff"] if "tiff" in exports else ()
    names = [*collections, *of_reference, *(f"{state}/{name}" for name in (*of_state, *deformed))]
    return list(dict.fromkeys(name.removesuffix("/.zattrs") for name in names))


def rebuilt_formats(output: OutputTable) -> list[VolumeFormat]:
    """In which formats the rebuilt volumes are wanted, each once."""
    formats: list[VolumeFormat] = [output.volumes] if output.rebuild else []
    return [*formats, "tiff"] if "tiff" in output.exports and "tiff" not in formats else formats


def time_of(table: StateTable, states: list[StateTable]) -> float:
    """Time of a state: in seconds if all states have one, else 1, 2, … in loading order."""
    times = [state.time for state in states]
    if table.time is not None and None not in times:
        return table.time
    return float(1 + [state.name for state in states].index(table.name))


def display_meshes(grains: GrainSet) -> Iterator[tuple[int, GrainMesh]]:
    """Label and mesh of each grain, one by one; one without attenuation has none."""
    for grain in grains.grains:
        mesh = grain_mesh(grain, grains.voxel_size)
        if mesh is not None:
            yield grain.label, display_mesh(mesh, grains.voxel_size)


def _write_with_labels(path: Path, volume: Volume, labels: NDArray[np.int32]) -> None:
    """A volume and its labels, in the format of the name of their first file."""
    write_volume(path.parent if path.parent.name in RESULT_STORES else path, volume, labels=labels)
