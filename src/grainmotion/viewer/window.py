"""Windows of napari with the results of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from grainmotion.errors import InputError
from grainmotion.viewer.layers import LayerData, ResultsLike, layers, residual_layers, stored_results

if TYPE_CHECKING:
    import napari
    from napari.components import ViewerModel

INSTALL = "pip install 'grainmotion[viewer]'"
DISPLAYED = ("y", "z", "x")
"""Axes into the screen, upwards and to the right, as the beam sees the sample at 0°; of 2-D views the last two."""
ORIENTATION = ("away", "up", "right")
"""Where they point.  napari's own choice, z y x towards the eye, down and right, shows x y z mirrored."""
LOOK, UP = (1.0, -0.35, 0.25), (0.0, 1.0, 0.0)
"""Direction in which the camera looks, and which way is up, along `DISPLAYED`: from the front, a little from above."""


def open(results: ResultsLike, *, value: str = "u", state: str | None = None) -> napari.Viewer:
    """Open the results of a run in napari, in space, with the states on one slider.

    Parameters
    ----------
    results : ResultsFolder, RunResult or path
        What `read_results` or `run` returned, or the folder of the results.
    value : str
        What grains are coloured by, see `layers`.
    state : str, optional
        The state that is shown first and that the labels tell; the last one unless given.

    Returns
    -------
    napari.Viewer
        The window.  In a script, ``napari.run()`` keeps it open.

    Raises
    ------
    InputError
        If napari is not installed, or there are no such results, no such state or no such value.

    Examples
    --------
    >>> viewer = gm.viewer.open("results", value="residual")  # doctest: +SKIP
    """
    napari = _napari()
    stored = stored_results(results)
    made = layers(stored, value=value, state=state)
    viewer = napari.Viewer(title=f"grainmotion: {stored.folder}", ndisplay=3)
    fill(viewer, made, ("reference", *stored.motions), state)
    return viewer


def open_residuals(results: ResultsLike) -> napari.Viewer:
    """Open the residual radiographs of a run in a window of napari, one image a state, the views on a slider.

    Parameters
    ----------
    results : ResultsFolder, RunResult or path
        As in `open`.

    Returns
    -------
    napari.Viewer
        The window.

    Raises
    ------
    InputError
        If napari is not installed, or there are no such results or no residual radiographs among them.

    Examples
    --------
    >>> viewer = gm.viewer.open_residuals("results")  # doctest: +SKIP
    """
    napari = _napari()
    stored = stored_results(results)
    made = residual_layers(stored)
    if not made:
        raise InputError(str(stored.folder), "it has no residual radiographs", "finish the run: grainmotion run")
    viewer = napari.Viewer(title=f"grainmotion: residual radiographs of {stored.folder}")
    for data in made:
        viewer.add_layer(napari.layers.Layer.create(*data))
    return viewer


def fill(viewer: ViewerModel, made: list[LayerData], names: tuple[str, ...], state: str | None = None) -> None:
    """Put layers into a viewer, seen from the front, with the name of the state (of ``names``, by step) on top."""
    from napari.layers import Layer

    for data in made:
        viewer.add_layer(Layer.create(*data))
    labels = viewer.dims.axis_labels
    viewer.dims.order = (*range(len(labels) - 3), *(labels.index(axis) for axis in DISPLAYED))
    viewer.dims.ndisplay = 3
    viewer.scene.camera.orientation = ORIENTATION
    viewer.scene.camera.set_view_direction(LOOK, UP)
    viewer.canvas.overlays.scale_bar.visible = True
    viewer.scene.overlays.axes.visible = True

    def tell_state() -> None:
        step = viewer.dims.current_step[0]
        viewer.canvas.overlays.text.text = names[step] if viewer.dims.ndim > 3 and step < len(names) else ""

    viewer.canvas.overlays.text.visible = True
    viewer.dims.events.current_step.connect(tell_state)
    if viewer.dims.ndim > 3:
        viewer.dims.set_current_step(0, len(names) - 1 if state is None else names.index(state))
    tell_state()


def _napari():  # type: ignore[no-untyped-def]  # the module itself
    try:
        import napari
        import qtpy  # noqa: F401  # fails where there is no Qt
    except Exception as error:
        fact = f"napari cannot be used ({error})"
        raise InputError("viewer", fact, f"install it with its windows: {INSTALL}") from error
    return napari
