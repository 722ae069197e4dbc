"""grainmotion: the rigid motion of every grain, from one tomography scan and a few radiographs per state.

The whole job in a notebook::

    import grainmotion as gm

    scan = gm.read_scan("reference/*.tif", "reference.csv", flats="flats/*.tif", darks="darks/*.tif")
    volume = gm.reconstruct(scan, gm.Volume.zeros((280, 180, 180), voxel_size=0.112)).volume
    grains = gm.grains_from_labels(volume, gm.segment(volume).labels)
    state = gm.read_scan("step-01/*.tif", "step-01.csv", flats="flats/*.tif", darks="darks/*.tif")
    motions = gm.track(grains, state)
    motions.to_table()
"""

from grainmotion.calibrate import CalibrateSettings, calibrate
from grainmotion.calibrating.corrections import Calibration
from grainmotion.compare import Comparison, compare
from grainmotion.errors import GrainmotionError, InputError
from grainmotion.experiment.file import read_experiment
from grainmotion.experiment.scans import read_scan
from grainmotion.geometry import Geometry, Panel
from grainmotion.grains import Grain, GrainSet, grains_from_labels
from grainmotion.hardening import Hardening, HardeningSettings, calibrate_hardening
from grainmotion.intensity import line_integrals_from_counts
from grainmotion.motions import Motions, StateFit, Status
from grainmotion.pipeline.run import run
from grainmotion.plan import Plan, PlanSettings, plan
from grainmotion.project import back_project, project, simulate_radiographs
from grainmotion.rebuild import rebuild
from grainmotion.reconstruct import Reconstruction, ReconstructSettings, reconstruct
from grainmotion.scan import Scan, normalize_air, snr
from grainmotion.segment import Segmentation, SegmentSettings, segment
from grainmotion.track import PAPER, TrackSettings, track
from grainmotion.volume import Volume

__all__ = [
    "PAPER",
    "CalibrateSettings",
    "Calibration",
    "Comparison",
    "Geometry",
    "Grain",
    "GrainSet",
    "GrainmotionError",
    "Hardening",
    "HardeningSettings",
    "InputError",
    "Motions",
    "Panel",
    "Plan",
    "PlanSettings",
    "ReconstructSettings",
    "Reconstruction",
    "Scan",
    "SegmentSettings",
    "Segmentation",
    "StateFit",
    "Status",
    "TrackSettings",
    "Volume",
    "back_project",
    "calibrate",
    "calibrate_hardening",
    "compare",
    "grains_from_labels",
    "line_integrals_from_counts",
    "normalize_air",
    "plan",
    "project",
    "read_experiment",
    "read_scan",
    "rebuild",
    "reconstruct",
    "run",
    "segment",
    "simulate_radiographs",
    "snr",
    "track",
]
