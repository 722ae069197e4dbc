"""Public names of `grainmotion.simulate`: lazy loading, deprecated names."""

import subprocess
import sys

import pytest

from grainmotion import simulate

HEAVY = ("matplotlib", "pandas", "h5py", "skimage", "dask")


def test_every_public_name_exists():
    assert "small" in simulate.__all__
    assert all(hasattr(simulate, name) for name in simulate.__all__)


def test_names_are_functions_and_classes_and_not_modules():
    simulate.hard_case("near-spherical")  # imports nearly all modules of the package
    modules = [name for name in simulate.__all__ if type(getattr(simulate, name)).__name__ == "module"]
    assert modules == []


def test_a_simulation_imports_no_plots_no_tables_and_no_file_formats():
    code = f"from grainmotion.simulate import small; import sys; print([m for m in {HEAVY} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_deprecated_names_still_work():
    case = simulate.hard_case("misaligned")
    with pytest.warns(DeprecationWarning, match="nominal_geometry"):
        assert case.told_geometry().shape == case.nominal_geometry().shape
    with pytest.warns(DeprecationWarning, match="misalignment"):
        assert case.slip == case.misalignment
    with pytest.warns(DeprecationWarning, match="Misalignment"):
        assert simulate.Slip is simulate.Misalignment
