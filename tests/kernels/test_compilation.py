"""Cache of compiled kernels where neither package nor home can be written, as in containers or service accounts."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import grainmotion
from grainmotion.kernels import compilation

NOWHERE = "/dev/null/nowhere"  # not even root can create a folder there


@pytest.fixture(scope="module")
def read_only(tmp_path_factory) -> Path:
    """A copy of the package in which no __pycache__ folders can be created."""
    folder = tmp_path_factory.mktemp("read_only")
    copy = folder / "grainmotion"
    shutil.copytree(Path(grainmotion.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for package_folder in [copy, *(p for p in copy.rglob("*") if p.is_dir())]:
        (package_folder / "__pycache__").write_text("a file, so that no folder of this name can be made")
    return folder


def without_home(package: Path, temporary: Path) -> dict[str, str]:
    """Environment variables of a user without a home folder who runs this copy of the package."""
    kept = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "MPLCONFIGDIR")}
    return kept | {
        "HOME": NOWHERE, "XDG_CACHE_HOME": NOWHERE, "PYTHONPATH": str(package), "PYTHONDONTWRITEBYTECODE": "1",
        "TMPDIR": str(temporary),
    }  # fmt: skip


def run_command(package: Path, temporary: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command ``grainmotion`` of this copy of the package, without a home folder."""
    program = "import grainmotion.__main__ as program; program.main()"
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, env=without_home(package, temporary), capture_output=True, text=True)


def test_help_needs_no_kernels_and_prints_no_warning(read_only, tmp_path):
    done = run_command(read_only, tmp_path, "--help")
    assert done.returncode == 0
    assert "run" in done.stdout
    assert not done.stderr


def test_commands_print_one_line_of_warning(read_only, tmp_path):
    (tmp_path / "x.toml").write_text("[reference]\nno_such_key = 1\n")
    done = run_command(read_only, tmp_path, "run", str(tmp_path / "x.toml"))
    warning, error = done.stderr.splitlines()
    assert "compiled kernels cannot be kept" in warning
    assert str(tmp_path) in warning
    assert done.returncode == 2
    assert "no_such_key" in error


def test_a_missing_file_is_told_before_kernels_are_needed(read_only, tmp_path):
    done = run_command(read_only, tmp_path, "run", "no-such.toml")
    (error,) = done.stderr.splitlines()
    assert "no-such.toml" in error
    assert done.returncode == 2


def test_kernels_are_cached_in_a_private_folder(read_only, tmp_path):
    program = (
        "import grainmotion, numpy as np; from grainmotion.kernels import filters;"
        "filters.filter_images(np.ones((1, 4, 4)), np.ones(2)); print(grainmotion.__file__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=without_home(read_only, tmp_path),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip().startswith(str(read_only))
    (folder,) = tmp_path.glob("grainmotion-kernels-*")
    assert not folder.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    assert list(folder.rglob("*.nbi"))


def refuse_caches(monkeypatch, allowed=()):
    """Make every cache folder unusable except those in ``allowed``."""
    monkeypatch.setattr(compilation, "_can_be_kept", lambda: compilation.nb.config.CACHE_DIR in allowed)
    monkeypatch.setitem(vars(compilation.nb.config), "CACHE_DIR", "")
    monkeypatch.setitem(os.environ, "NUMBA_CACHE_DIR", "")
    monkeypatch.setitem(os.environ, "MPLCONFIGDIR", "")


def test_kernels_are_compiled_in_memory_without_any_cache_folder(monkeypatch, caplog):
    refuse_caches(monkeypatch)
    assert not compilation.cache_available()
    assert "compiles them anew" in caplog.text
    assert not compilation.nb.config.CACHE_DIR


def test_unwritable_cache_folder_of_the_user_is_named(monkeypatch, caplog):
    refuse_caches(monkeypatch, allowed=(compilation._temporary_folder(),))
    monkeypatch.setitem(vars(compilation.nb.config), "CACHE_DIR", NOWHERE)
    assert compilation.cache_available()
    assert f"NUMBA_CACHE_DIR ({NOWHERE})" in caplog.text


@pytest.mark.skipif(os.name != "posix", reason="owners and modes of files are those of POSIX")
def test_folder_that_others_can_write_is_not_used(monkeypatch, tmp_path):
    monkeypatch.setattr(compilation.tempfile, "gettempdir", lambda: str(tmp_path))
    folder = Path(compilation._temporary_folder())
    folder.chmod(0o777)
    assert compilation._temporary_folder() is None
    folder.rmdir()
    folder.symlink_to(tmp_path)
    assert compilation._temporary_folder() is None
    folder.unlink()
    folder.write_text("a file")
    assert compilation._temporary_folder() is None
