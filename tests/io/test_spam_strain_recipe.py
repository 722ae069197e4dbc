"""The line of docs/how-to/from-spam.md that strains our motions by spam; marked `spam`, run by `make test-spam`."""

from __future__ import annotations

import os
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest

import grainmotion as gm
from converged_motions import converged
from documented_blocks import ROOT, blocks_of

pytestmark = pytest.mark.spam
PAGE = ROOT / "docs" / "how-to" / "from-spam.md"
VOXEL = 0.05
GRADIENT = np.array([[1.02, 0.03, 0.0], [0.0, 0.98, -0.01], [0.0, 0.02, 0.95]])


def line() -> list[str]:
    """The words of the command on the page."""
    return shlex.split(next(b.text for b in blocks_of(PAGE) if b.text.startswith("python -c")))


def test_the_line_gives_the_strain_that_grainmotion_gives(tmp_path):
    python = Path(os.environ.get("GRAINMOTION_SPAM_PYTHON", ROOT / ".venv-spam" / "bin" / "python"))
    centers = np.array([[x, y, z] for x in range(3) for y in range(3) for z in range(3)]) * 12.0
    centers += np.random.default_rng(1).uniform(-2, 2, centers.shape)
    shape = np.ceil(centers.max(axis=0)[::-1] + 5).astype(int)
    labels = np.zeros(shape, np.int32)
    for label, (x, y, z) in enumerate(np.round(centers).astype(int), start=1):
        labels[max(z - 2, 0) : z + 3, max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3] = label
    volume = gm.Volume((labels > 0).astype(np.float32), VOXEL)
    grains = gm.grains_from_labels(volume, labels)
    motions = converged(
        grains.labels, grains.centers, grains.centers @ (GRADIENT - np.eye(3)).T, np.tile([5.0, -3.0, 8.0], (27, 1))
    )
    (tmp_path / "results" / "step-01").mkdir(parents=True)
    gm.write_ddic_tsv(tmp_path / "results" / "step-01" / "grains-ddic.tsv", motions, volume, labels)
    subprocess.run([str(python), *line()[1:]], cwd=tmp_path, check=True, timeout=300)
    found = np.load(tmp_path / "F.npy")
    found = found[np.isfinite(found).all(axis=(1, 2))][:, ::-1, ::-1]  # z y x to x y z
    assert len(found) > 30
    assert np.allclose(np.median(found, axis=0), GRADIENT, atol=1e-4)
    assert np.allclose(np.median(found, axis=0), gm.strains(motions).mean_gradient, atol=1e-4)
    strains = np.loadtxt(tmp_path / "strains.csv", delimiter=",", skiprows=1)
    assert np.nanmedian(strains[:, 0]) == pytest.approx(np.linalg.det(GRADIENT) - 1, abs=1e-4)
