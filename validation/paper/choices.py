"""Effect of the paper's choices: reference, point of view, operators, gain and offset, one at a time."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Projector
from grainmotion.analysis.validation import compare
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan, normalize_air
from grainmotion.model.volume import Volume
from grainmotion.objective.data_term import Derivatives
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.volumes import project
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.simulate import LATER_ANGLES_DEG
from grainmotion.tracking.track import TrackSettings
from validation.benchmarks.peers.rtk import filtered_back_projection
from validation.common.cache import SIMULATION
from validation.common.measures import relative_difference
from validation.paper import gravel, page
from validation.paper.eulerian import EulerianProblem, track_by_filters

STATES = ("random", "unmoved")
VIEWS = 4
FDK = {"FDK, ramp": 0.0, "FDK, ramp with Hann window": 1.0}  # cut-off of the window over Nyquist's frequency
CHECKED_VIEWS = slice(None, None, 8)  # views by which an FDK volume's place and scale are checked
MAX_EPSILON = 0.1  # ε above which an FDK volume cannot be in its place
NEAR_START = (1.0, 6.0)  # voxels and degrees: where the unmoved state starts for the Eulerian comparison
BEAM_LOSS = 0.1  # of the beam
ERROR_NAMES = ("translation_rms", "rotation_rms_deg")


def study() -> page.Section:
    """One table a choice."""
    case = gravel.case()
    h = case.scanner.voxel_size
    parts = [
        f"The simulated gravel again, {VIEWS} views, in two states: *random*, every grain moved by up to 5 voxels and "
        "10° its own way, and *unmoved*.  Zero start and the package's defaults unless stated otherwise.  Errors are "
        "root mean square a component over the grains that did not fail; a grain fails if it is missing, not "
        f"converged, or off by more than 1 voxel ({h:g} mm) or 5°.  CPU s is that of tracking alone.  All references "
        "share one segmentation for the extraction of grains, the default one of the smooth SART volume, so that "
        "nothing but the choice differs.",
        "### Reference: SART or filtered back-projection",
        references(),
        "### Lagrangian or Eulerian",
        points_of_view(),
        "### Operators of reconstruction and tracking",
        operators(),
        "### Gain and offset",
        gains(),
    ]
    return page.Section("Where the paper's choices matter", "\n\n".join(parts))


# ---------------------------------------------------------------------- the reference
def references() -> str:
    """SART against filtered back-projection."""
    scan = gravel.full_scan().select(CHECKED_VIEWS)
    found = gravel.reference()
    volumes = {f"SART, {len(found.residuals)} sweeps": (found.volume, found.cpu)}
    volumes |= {name: fdk(cut_off) for name, cut_off in FDK.items()}
    rows, runs = [], {}
    for name, (volume, cpu) in volumes.items():
        images = project(volume, scan.geometry)
        epsilon = relative_difference(images, scan.line_integrals)
        if epsilon > MAX_EPSILON:
            raise ValueError(f"{name}: ε = {epsilon:.3f} against its own scan; its axes or its scale are wrong")
        sample = grains_from_labels(volume, gravel.labels())
        for state in STATES:
            run = runs[name, state] = gravel.track_state(sample, state)
            rows.append([name, f"{cpu:.0f}", f"{epsilon:.4f}", state, *run.cells()])
    return (
        "FDK is RTK's (PyPI `itk-rtk`), run in an environment of its own.  That its volume lies the right way round "
        "and has the right scale is seen in ε, ‖b − A x‖/‖b‖ by this package's projector over every "
        f"{CHECKED_VIEWS.step}th view of the scan.\n\n"
        + page.table(["reference", "its CPU s", "ε", "state", *gravel.HEAD], rows)
        + "\n"
        + _by_height(runs)
    )


def _by_height(runs: dict[tuple[str, str], gravel.Run]) -> str:
    """Rotation errors of the grains near and far from the source's plane, where a cone beam is exact for FDK."""
    heights = np.abs(gravel.case().sample.centers[:, 2])
    far = heights > np.median(heights)
    sentences = []
    for name in dict.fromkeys(name for name, _ in runs):
        errors = [_rms(runs[name, "random"].errors.rotation_errors_deg[half]) for half in (~far, far)]
        sentences.append(f"{errors[0]:.3f}° and {errors[1]:.3f}° with {name}")
    return (
        "The data of a circular cone-beam scan are complete only in the source's plane, and FDK's formula is exact "
        f"nowhere else.  Rotations of the random state, for the half of the grains nearest to that plane and for the "
        f"others: {'; '.join(sentences)}."
    )


@page.PAGE.cached(*SIMULATION)
def fdk(hann: float) -> tuple[Volume, float]:
    """RTK's filtered back-projection of the full scan, and its CPU seconds."""
    scanner, scan = gravel.case().scanner, gravel.full_scan()
    array, cpu, _ = filtered_back_projection(scan.line_integrals, scanner, gravel.angles_deg(), hann)
    return Volume(array, scanner.voxel_size), cpu


# ---------------------------------------------------------------------- the point of view
def points_of_view() -> str:
    """The Lagrangian projector against the Eulerian one, all else equal."""
    sample = gravel.grains()
    still = Motions.identity(sample.labels, sample.centers)
    starts = {
        "random": ("zero", still),
        "unmoved": ("near", gravel.near_truth(sample, "unmoved", *NEAR_START, seed=57)),
    }
    ways: dict[str, tuple[type[StateProblem], Derivatives]] = {
        "Lagrangian, analytic derivatives": (StateProblem, "analytic"),
        "Lagrangian, finite differences": (StateProblem, "differences"),
        "Eulerian, finite differences": (EulerianProblem, "differences"),
    }
    rows, runs = [], {}
    for state, (where, start) in starts.items():
        for name, (problem, derivatives) in ways.items():
            run = runs[state, name] = _by_filters(problem, sample, state, start, derivatives)
            rows.append([state, where, name, int(run.motions.iterations[0]), *run.cells()])
    return (
        "The Lagrangian projector pulls each ray back into the grain's own voxels.  The Eulerian one resamples the "
        "moved grain trilinearly onto the sample's grid and projects that.  Both are run by the same solver, all "
        "grains free, under the filters 6, 2 and 0.7 pixels in turn, and nothing else; the smooth projector in both.  "
        f"The *near* start is up to {NEAR_START[0]:g} voxel and {NEAR_START[1]:g}° from the truth: from zero, the "
        "unmoved state would start at its solution.\n\n"
        + page.table(["state", "start", "projector", "iterations", *gravel.HEAD], rows)
        + "\n"
        + _eulerian_over_lagrangian(runs, *list(ways)[::2])
    )


def _eulerian_over_lagrangian(runs: dict[tuple[str, str], gravel.Run], ours: str, other: str) -> str:
    sentences = []
    for state in STATES:
        a, b = runs[state, ours], runs[state, other]
        sentences.append(
            f"in the {state} state {b.errors.translation_rms / a.errors.translation_rms:.2f} times in translation, "
            f"{b.errors.rotation_rms_deg / a.errors.rotation_rms_deg:.2f} times in rotation, for {b.cpu / a.cpu:.0f} "
            "times the CPU time"
        )
    return (
        f"Eulerian errors over Lagrangian ones with analytic derivatives: {'; '.join(sentences)}.  Resampling blurs "
        "a grain that lies off the grid and leaves one that lies on it as it is.  The unmoved state lies on the "
        "grid and so favours the Eulerian projector; no real motion does."
    )


def _by_filters(
    problem: type[StateProblem], sample: GrainSet, state: str, start: Motions, derivatives: Derivatives
) -> gravel.Run:
    _compile_by_filters()
    scan = gravel.state(state, VIEWS)
    begin = time.process_time()
    motions = track_by_filters(problem, sample, scan, start, derivatives=derivatives)
    cpu = time.process_time() - begin
    case = gravel.case()
    return gravel.Run(motions, compare(motions, case.motions[state], case.scanner.voxel_size), cpu)


@cache
def _compile_by_filters() -> None:
    """Run each way once on one grain, so that no CPU time holds compilation."""
    gravel.compile_kernels()
    one = GrainSet(gravel.grains().grains[:1])
    for problem, derivatives in ((StateProblem, "differences"), (EulerianProblem, "differences")):
        start = Motions.identity(one.labels, one.centers)
        track_by_filters(problem, one, gravel.state("unmoved", 2), start, (2.0,), derivatives)


# ---------------------------------------------------------------------- the operators
def operators() -> str:
    """Siddon's path and the smooth image in SART and in tracking, two by two."""
    names: dict[Projector, str] = {"trilinear": "smooth", "exact": "Siddon"}
    rows, runs = [], {}
    for made in names:
        volume = gravel.reference(replace(gravel.SMOOTH, projector=made)).volume
        sample = grains_from_labels(volume, gravel.labels())
        for tracked in names:
            for state in STATES:
                run = gravel.track_state(sample, state, settings=TrackSettings(projector=tracked))
                rows.append([names[made], names[tracked], state, *run.cells()])
                runs[made, tracked, state] = run.errors
    worse = []
    for changed in (("exact", "trilinear"), ("trilinear", "exact")):
        pairs = [(runs[*changed, s], runs["trilinear", "trilinear", s]) for s in STATES]
        ratios = [np.mean([getattr(a, m) / getattr(b, m) for a, b in pairs]) for m in ERROR_NAMES]
        worse.append("{:.1f} times in translation and {:.1f} times in rotation".format(*ratios))
    return (
        "The paper asks for the same operator in both, and takes Siddon's.  Here *smooth* is trilinear sampling, "
        "*Siddon* the exact path through boxes, with analytic derivatives; each SART stops by its own rule.\n\n"
        + page.table(["SART", "tracking", "state", *gravel.HEAD], rows)
        + f"\nAgainst smooth in both, the mean over the states of what Siddon's path does to the errors: in SART alone "
        f"{worse[0]}, in tracking alone {worse[1]}."
    )


# ---------------------------------------------------------------------- gain and offset
def gains() -> str:
    """a and b of Eq. 22 on and off, with and without a drift."""
    plain = gravel.state("random", VIEWS)
    scans = {
        "none": plain,
        f"beam −{BEAM_LOSS:.0%}": dimmed("random", BEAM_LOSS),
        f"line integrals +{BEAM_LOSS:.0%}": Scan(plain.line_integrals * np.float32(1 + BEAM_LOSS), plain.geometry),
    }
    sample, h = gravel.grains(), gravel.case().scanner.voxel_size
    rows = []
    for drift, scan in scans.items():
        ways = {"a, b free": (scan, True), "a = 1, b = 0": (scan, False)}
        if drift.startswith("beam"):
            ways["a = 1, b = 0, air set to zero first"] = (normalize_air(scan, margin=8), False)
        for way, (drifted, free) in ways.items():
            # Where a drift is ignored, every grain fits badly, and a search for all of them is long and in vain.
            settings = TrackSettings(gain=free, search=False)
            run = gravel.track_state(sample, "random", settings=settings, scan=drifted)
            fit, e = run.motions.fit, run.errors
            refused = int((~run.motions.ok).sum())
            errors = [f"{_rms(e.translation_errors) / h:.4f}", f"{_rms(e.rotation_errors_deg):.3f}"]
            rows.append(
                [drift, way, f"{fit.gain:.4f}", f"{fit.offset:.4f}", *errors, run.failures, refused, f"{run.cpu:.1f}"]
            )
    return (
        "The random state alone, against a reference that did not drift.  *Beam*: the source gives "
        f"{BEAM_LOSS:.0%} less than when the flats were taken, in all views, with the photon noise of that beam, so "
        f"that every line integral gains −ln {1 - BEAM_LOSS:g} = {-np.log(1 - BEAM_LOSS):.4f}: an offset.  *Line "
        f"integrals*: every one of them is multiplied by {1 + BEAM_LOSS:g}, as by a softer beam: a gain.  Grains that "
        "fit badly are not searched for here.  Errors are over all grains, those that the tracker refused (its status "
        "is not converged) among them.\n\n"
        + page.table(
            ["drift", "tracking", "a found", "b found", *gravel.HEAD[:3], "refused by the tracker", gravel.HEAD[3]],
            rows,
        )
    )


def dimmed(name: str, loss: float) -> Scan:
    """A state by a beam that is weaker than its flats say."""
    case = gravel.case()
    weaker = replace(case, physics=replace(case.physics, photons=case.physics.photons * (1 - loss)))
    scan = weaker.state(case.motions[name], LATER_ANGLES_DEG[VIEWS], gravel.noise_number(name, VIEWS))
    return Scan(scan.line_integrals - np.float32(np.log(1 - loss)), scan.geometry)


def _rms(errors: NDArray[np.float64]) -> float:
    """Root mean square of all components of the grains that have a measured motion; the others are NaN."""
    return float(np.sqrt(np.nanmean(errors**2)))
