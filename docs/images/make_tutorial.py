"""Draw the pictures of the tutorial from its finished run:  python docs/images/make_tutorial.py SHEAR_FOLDER."""

from __future__ import annotations

import shutil
import sys
from io import BytesIO
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image
from playwright.sync_api import sync_playwright

import grainmotion as gm

FOLDER = Path(__file__).with_name("tutorial")
STATE = "shear-band-4"
ENLARGEMENT = 4
"""Of displacements in the picture of arrows."""
CHOSEN = 13
"""Label of the grain that is chosen in the report: it is in the middle of the band."""
CONTRAST = 10
"""Of the residual radiograph over that of the measured one."""


def draw(folder: Path) -> None:
    """All pictures, from the folder of the experiment."""
    plt.rcParams |= {"font.size": 9, "savefig.dpi": 110, "figure.constrained_layout.use": True}
    FOLDER.mkdir(exist_ok=True)
    results = gm.read_results(folder / "results")
    motions, truth = results.motions[STATE], gm.read_motions(folder / f"{STATE}-truth.csv")
    reference, state = _scan(folder, "reference"), _scan(folder, STATE)
    pictures = {
        "radiographs": _radiographs(reference, state),
        "labels": _labels(results),
        "residual": _residual(state, results.grains, motions),
        "motions": _motions(motions),
        "strain": _strain(motions, truth),
    }
    for name, figure in pictures.items():
        figure.savefig(FOLDER / f"{name}.png")
        plt.close(figure)
    if shutil.which("chromium"):
        _report(folder / "results" / "report.html")


def _report(page: Path) -> None:
    """The report's grains in 3-D, of the state with 4 radiographs, with one grain chosen."""
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        tab = browser.new_page(viewport={"width": 1250, "height": 1000})
        tab.goto(page.resolve().as_uri())
        tab.wait_for_selector("#viewer canvas")
        tab.evaluate(f"gm.app.setState(0); gm.app.setGrain({CHOSEN})")
        tab.wait_for_timeout(5000)  # drawing without a graphics card takes its time
        image = Image.open(BytesIO(tab.locator("#explore .explorer").first.screenshot()))
        browser.close()
    image.convert("RGB").save(FOLDER / "report.jpg", quality=88, optimize=True)


def _scan(folder: Path, name: str) -> gm.Scan:
    beam = {kind: str(folder / kind / "*.tif") for kind in ("flats", "darks")}
    return gm.read_scan(str(folder / name / "*.tif"), folder / f"{name}.csv", **beam)


def _images(titles: list[str], images: list[np.ndarray], limits: list[tuple[float, float]], maps: list[str]) -> Figure:
    """Images beside each other, each with its scale."""
    figure, axes = plt.subplots(1, len(images), figsize=(3.0 * len(images), 3.3))
    for axis, title, image, (low, high), colours in zip(axes, titles, images, limits, maps, strict=True):
        shown = axis.imshow(image, cmap=colours, origin="lower", vmin=low, vmax=high)
        figure.colorbar(shown, ax=axis, shrink=0.8)
        axis.set_title(title)
        axis.axis("off")
    return figure


def _radiographs(reference: gm.Scan, state: gm.Scan) -> Figure:
    top = float(reference.line_integrals.max())
    images = [reference.line_integrals[0], state.line_integrals[0]]
    return _images(["before loading", "after loading"], images, [(0, top)] * 2, ["gray_r"] * 2)


def _residual(state: gm.Scan, grains: gm.GrainSet, motions: gm.Motions) -> Figure:
    measured = state.line_integrals[0]
    simulated = gm.simulate_radiographs(grains, motions, state.geometry)[0]
    top = float(measured.max())
    small = top / CONTRAST
    return _images(
        ["measured", "simulated", f"measured − simulated, × {CONTRAST}"],
        [measured, simulated, measured - simulated],
        [(0, top), (0, top), (-small, small)],
        ["gray_r", "gray_r", "RdBu_r"],
    )


def _labels(results: gm.ResultsFolder) -> Figure:
    volume, labels = results.volume.array, results.labels
    middle = volume.shape[1] // 2
    figure, axes = plt.subplots(1, 2, figsize=(6.4, 3.7))
    for axis in axes:
        axis.imshow(volume[:, middle], cmap="gray", origin="lower", vmin=0)
        axis.axis("off")
    shown = np.ma.masked_equal(labels[:, middle], 0)
    axes[1].imshow(shown % 20, cmap="tab20", origin="lower", alpha=0.6, interpolation="nearest", vmin=0, vmax=19)
    axes[0].set_title("reconstructed volume")
    axes[1].set_title("labels")
    return figure


def _band(truth: gm.Motions) -> tuple[np.ndarray, np.ndarray]:
    """Unit normal of the band, and the unit direction of slip."""
    spread = truth.translations - truth.translations.mean(axis=0)
    slip = np.linalg.svd(spread)[2][0]
    axis = np.linalg.svd(truth.rotations)[2][0]
    slip *= np.sign(slip[2])
    return np.cross(axis, slip) / np.linalg.norm(np.cross(axis, slip)), slip


def _motions(motions: gm.Motions) -> Figure:
    normal, slip = _band(motions)
    across = np.cross(normal, slip)
    side = np.cross([0, 0, 1.0], across)
    side /= np.linalg.norm(side)
    x, u = motions.centers @ side, motions.translations @ side
    z, w = motions.centers[:, 2], motions.translations[:, 2]
    angles = np.rad2deg(np.linalg.norm(motions.rotations, axis=1))
    figure, axis = plt.subplots(figsize=(4.6, 4.6))
    dots = axis.scatter(x, z, s=700, c=angles, cmap="viridis", alpha=0.6, linewidths=0)
    axis.quiver(x, z, ENLARGEMENT * u, ENLARGEMENT * w, angles="xy", scale_units="xy", scale=1, width=0.006)
    figure.colorbar(dots, ax=axis, label="rotation, degrees", shrink=0.8)
    axis.set(aspect="equal", xlabel="along the slope, mm", ylabel="z, mm")
    axis.margins(0.3, 0.15)
    return figure


def _strain(motions: gm.Motions, truth: gm.Motions) -> Figure:
    normal, slip = _band(truth)
    figure, axes = plt.subplots(1, 2, figsize=(8.6, 3.9))
    across = np.cross(normal, slip)
    side = np.cross([0, 0, 1.0], across)
    side /= np.linalg.norm(side)
    field = gm.strains(motions).to_dataframe()
    shown = axes[0].scatter(
        motions.centers @ side, motions.centers[:, 2], s=600, c=field["deviatoric"], cmap="magma_r", linewidths=0
    )
    figure.colorbar(shown, ax=axes[0], label="deviatoric strain", shrink=0.9)
    axes[0].set(aspect="equal", xlabel="along the slope, mm", ylabel="z, mm")
    axes[0].margins(0.15)
    _rotation_profile(axes[1], motions, truth, normal)
    return figure


def _rotation_profile(axis: Axes, motions: gm.Motions, truth: gm.Motions, normal: np.ndarray) -> None:
    distances = truth.centers @ normal
    order = np.argsort(distances)
    angles = np.rad2deg(np.linalg.norm(truth.rotations, axis=1))
    axis.plot(distances[order], angles[order], "-", color="0.6", label="true")
    measured = np.rad2deg(np.linalg.norm(motions.rotations, axis=1))
    sd = np.rad2deg(np.sqrt(np.trace(motions.covariances[:, 3:, 3:], axis1=1, axis2=2) / 3))
    axis.errorbar(motions.centers @ normal, measured, 2 * sd, fmt="o", ms=4, label="measured, ± 2 sd")
    axis.set(xlabel="distance from the middle of the band, mm", ylabel="rotation, degrees")
    axis.legend(frameon=False)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
