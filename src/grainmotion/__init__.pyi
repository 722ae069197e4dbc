from . import simulate as simulate
from .analysis.deformed_volume import rebuild as rebuild
from .analysis.validation import Comparison as Comparison
from .analysis.validation import compare as compare
from .backends.device import Device as Device
from .calibration.calibrate import CalibrateSettings as CalibrateSettings
from .calibration.calibrate import calibrate as calibrate
from .calibration.corrections import Calibration as Calibration
from .calibration.scanner import ScannerCalibration as ScannerCalibration
from .calibration.settings import ReferenceSettings as ReferenceSettings
from .calibration.settings import ScannerSettings as ScannerSettings
from .errors import BackendError as BackendError
from .errors import GrainmotionError as GrainmotionError
from .errors import InputError as InputError
from .experiment.config import Air as Air
from .experiment.config import read_experiment as read_experiment
from .experiment.scan_inputs import read_scan as read_scan
from .io.motions_csv import read_motions as read_motions
from .io.motions_csv import write_motions as write_motions
from .model.detector_alignment import DetectorAlignment as DetectorAlignment
from .model.geometry import Geometry as Geometry
from .model.grains import Grain as Grain
from .model.grains import GrainSet as GrainSet
from .model.motions import Motions as Motions
from .model.motions import StateFit as StateFit
from .model.motions import Status as Status
from .model.scan import Scan as Scan
from .model.scan import normalize_air as normalize_air
from .model.scan import snr as snr
from .model.volume import Volume as Volume
from .planning.plan import Plan as Plan
from .planning.plan import PlanSettings as PlanSettings
from .planning.plan import plan as plan
from .preprocessing.beam_hardening import (
    Hardening as Hardening,
)
from .preprocessing.beam_hardening import (
    HardeningSettings as HardeningSettings,
)
from .preprocessing.beam_hardening import (
    calibrate_hardening as calibrate_hardening,
)
from .preprocessing.flat_field import line_integrals_from_counts as line_integrals_from_counts
from .projection.grains import simulate_radiographs as simulate_radiographs
from .projection.volumes import back_project as back_project
from .projection.volumes import project as project
from .reconstruction.reconstruct import (
    Reconstruction as Reconstruction,
)
from .reconstruction.reconstruct import (
    ReconstructSettings as ReconstructSettings,
)
from .reconstruction.reconstruct import (
    reconstruct as reconstruct,
)
from .report.page import write_report as write_report
from .segmentation.extraction import extract_grains as extract_grains
from .segmentation.extraction import grains_from_labels as grains_from_labels
from .segmentation.segment import Segmentation as Segmentation
from .segmentation.segment import segment as segment
from .segmentation.settings import SegmentSettings as SegmentSettings
from .tracking.track import PAPER as PAPER
from .tracking.track import TrackSettings as TrackSettings
from .tracking.track import track as track
from .workflow.reference import Reference as Reference
from .workflow.run import run as run

__version__: str
