"""Many small steps: errors do not add up, for each state is measured from the reference.

Radiographs are of exact shapes, by an independent projector.  Each stone goes along half a circle of its own plane, 0.3
voxel a step, and turns by half a degree a step about its own axis: after 50 steps 9.5 voxels from its place, by 25°.
"""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.analysis.validation import compare
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.sequences.extrapolation import extrapolate
from grainmotion.simulate import LATER_ANGLES_DEG, label_volume, small
from grainmotion.simulate.motion_fields import unmoved
from grainmotion.tracking.track import track

STEPS, STEP_VOXELS, STEP_DEG = 50, 0.3, 0.5
GRAINS = 6


def truth_of(case, step):
    """True motions after so many steps."""
    rng, angle = np.random.default_rng(5), np.pi * step / STEPS
    frames = np.linalg.qr(rng.normal(size=(GRAINS, 3, 3)))[0]
    axes = rng.normal(size=(GRAINS, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    radius = STEP_VOXELS * case.scanner.voxel_size * STEPS / np.pi
    way = radius * ((1 - np.cos(angle)) * frames[:, 0] + np.sin(angle) * frames[:, 1])
    return replace(unmoved(case.sample), translations=way, rotations=np.deg2rad(STEP_DEG) * step * axes)


def errors_by_step(steps):
    """Root mean square errors of all grains in each state, voxels and degrees, ``(steps, 2)``; and the motions."""
    case = small(n_grains=GRAINS)
    volume = reconstruct(case.reference(), case.scanner.grid).volume
    grains = grains_from_labels(volume, label_volume(case.sample, case.scanner.grid))
    before, last, errors, chain = None, None, [], []
    for step in range(1, steps + 1):
        truth = truth_of(case, step)
        start = None if last is None else (last, extrapolate(before, last))
        before, last = last, track(grains, case.state(truth, LATER_ANGLES_DEG[4], number=step), start)
        comparison = compare(last, truth, case.scanner.voxel_size)
        assert comparison.failures == 0, (step, last.reasons)
        errors.append([comparison.translation_rms_voxels, comparison.rotation_rms_deg])
        chain.append(last)
    return np.array(errors), chain


def rms(errors):
    return np.sqrt(np.mean(errors**2, axis=0))


def assert_no_drift(errors, first, last):
    """The errors of the last states are at most √2 times those of the first ones."""
    assert (rms(errors[-last:]) <= np.sqrt(2) * rms(errors[:first])).all(), errors


def test_errors_do_not_grow_over_steps():
    errors, _ = errors_by_step(8)
    assert_no_drift(errors, 4, 4)


@pytest.mark.slow
def test_errors_do_not_grow_over_fifty_steps():
    errors, chain = errors_by_step(STEPS)
    assert_no_drift(errors, 1, 1)
    assert_no_drift(errors, 5, 5)
    # most states start from the extrapolation, which is nearer on a smooth way
    assert np.mean([motions.fit.best_start for motions in chain[1:]]) > 0.5
