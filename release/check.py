"""Check that a release can be published: build it, install it where nothing else is, and run its main job.

    python release/check.py [--quick] [--python python3.12 ...]

1. One version everywhere: `pyproject.toml`, `CITATION.cff` and the newest section of `CHANGELOG.md`.  The citation, the
   forms for issues and the settings of Read the Docs are valid by their schemas.  Public names of the last release that
   are gone were deprecated for as long as docs/versioning.md promises.
2. Source distribution and wheel build; the wheel is built from the source distribution, holds every file of the package
   and nothing else, and its description has no link that works in the repository only.
3. In a new environment of each Python that the package is declared for and that this machine has: the wheel installs,
   all public names import, the types are found, and the demo finds the motions.  Pythons that are missing are named.
4. The same with the oldest versions of all dependencies that `pyproject.toml` allows; a bound whose version is not the
   one installed is an error.

`--quick` ends after step 2.  Run by `make release-check`.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Iterable, Iterator
from datetime import date, timedelta
from email import message_from_bytes
from email.message import Message
from pathlib import Path

ROOT = Path(__file__).parents[1]
MAX_WHEEL_MB = 5
TOOLS = Path(sys.executable).parent
"""Where build, twine, uv and mypy are: the environment of this interpreter."""
DEPRECATED_FOR = timedelta(days=182)
"""Half a year, and one MINOR release: how long a former name goes on working."""
EXTRAS = "cluster,parquet,notebook,zarr,scanners"
"""Extras that are installed with the wheel; `gpu` and `viewer` need hardware or a screen."""
USE = """
import grainmotion as gm
for name in gm.__all__:
    getattr(gm, name)
print(gm.__version__)
"""
TYPED = """
import grainmotion as gm
motions: gm.Motions = gm.read_motions("motions.csv")
wrong: int = motions
"""


class ReleaseError(Exception):
    """What stands in the way of a release."""


def main() -> int:
    """Run all checks; the first one that fails ends them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="versions, build and contents only")
    parser.add_argument("--python", nargs="+", default=None, help="interpreters, instead of those that are found")
    options = parser.parse_args()
    try:
        with tempfile.TemporaryDirectory(prefix="grainmotion-release-") as name:
            check(Path(name), options)
    except ReleaseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def check(folder: Path, options: argparse.Namespace) -> None:
    """All checks, with files in a folder."""
    say(f"version {one_version()} in pyproject.toml, CITATION.cff and CHANGELOG.md")
    valid_by_schema()
    removed_names()
    wheel = build(folder / "dist")
    contents(wheel)
    say(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB, every file of the package and nothing else")
    description(metadata(wheel))
    if options.quick:
        return
    declared = declared_pythons()
    pythons = options.python or [path for path in map(interpreter, declared) if path]
    for python in pythons:
        environment = folder / f"environment-{len(list(folder.iterdir()))}"
        run([python, "-m", "venv", environment])
        run([environment / "bin" / "python", "-m", "pip", "install", "--quiet", f"{wheel}[{EXTRAS}]"])
        use(environment, folder)
    use(oldest(wheel, pythons[0], folder / "oldest"), folder, "oldest dependencies allowed")
    if options.python is None:
        missing = [version for version in declared if interpreter(version) is None]
        say(f"not tested, not on this machine: Python {', '.join(missing)}" if missing else "all Pythons tested")


def one_version() -> str:
    """The version, if all files agree on it and the changelog dates it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    dated = re.search(r"^## \[(\d[^\]]*)\] - (\d{4}-\d\d-\d\d)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    found = {
        "pyproject.toml": project["version"],
        "CITATION.cff": cited.group(1) if cited else None,
        "CHANGELOG.md": dated.group(1) if dated else None,
    }
    if len(set(found.values())) > 1:
        raise ReleaseError(f"versions differ: {found}; write one version, with its date in the changelog")
    return str(project["version"])


def removed_names() -> None:
    """Compare the public names with those of the last release, by its tag."""
    done = subprocess.run(
        ["git", "-C", ROOT, "describe", "--tags", "--abbrev=0", "--match", "v[0-9]*", "--exclude", f"v{one_version()}"],
        capture_output=True,
        text=True,
    )
    if done.returncode:
        say("no earlier release has a tag: no public names to compare with")
        return
    tag = done.stdout.strip()
    names, former = (
        (run(["git", "-C", ROOT, "show", f"{tag}:release/{file}"]).splitlines(), (ROOT / "release" / file).read_text())
        for file in ("public_api.txt", "former_names.csv")
    )
    gone = public_names(names[0]) - public_names(names[1].splitlines())
    gone |= {row["former"] for row in csv.DictReader(former[0])} - {
        row["former"] for row in csv.DictReader(former[1].splitlines())
    }
    if early := too_early(gone, list(csv.DictReader(former[0])), one_version(), date.today()):
        raise ReleaseError(f"public names of {tag} that are gone before their time (docs/versioning.md): {early}")
    say(f"every public name of {tag} is still there, or was deprecated for long enough")


def public_names(lines: Iterable[str]) -> set[str]:
    """Names in lines of `public_api.txt`, without the package's own and without parameters."""
    return {re.split(r"[(:]", line)[0].removeprefix("grainmotion.") for line in lines if line}


def too_early(gone: set[str], former: list[dict[str, str]], version: str, today: date) -> list[str]:
    """Names that are gone although they were not deprecated, or not for a MINOR release and half a year."""
    due = {
        row["former"]
        for row in former
        if minor(row["since"]) < minor(version) and date.fromisoformat(row["date"]) + DEPRECATED_FOR <= today
    }
    return sorted(gone - due)


def minor(version: str) -> tuple[int, int]:
    """MAJOR and MINOR of a version."""
    major, second, *_ = version.split(".")
    return int(major), int(second)


def valid_by_schema() -> None:
    """Files that other services read."""
    forms = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("[0-9]*.yml"))
    for schema, files in {
        "citation-file-format": [ROOT / "CITATION.cff"],
        "github-issue-forms": forms,
        "github-issue-config": [ROOT / ".github" / "ISSUE_TEMPLATE" / "config.yml"],
        "readthedocs": [ROOT / ".readthedocs.yaml"],
    }.items():
        run([TOOLS / "check-jsonschema", "--builtin-schema", f"vendor.{schema}", *files])
    say("the citation, the forms for issues and .readthedocs.yaml are valid by their schemas")


def build(folder: Path) -> Path:
    """Source distribution and the wheel that is built from it, both with a valid description."""
    run([sys.executable, "-m", "build", "--outdir", folder, ROOT])
    run([sys.executable, "-m", "twine", "check", "--strict", *folder.iterdir()])
    return next(folder.glob("*.whl"))


def contents(wheel: Path) -> None:
    """The wheel holds every file of the package that git knows, and beside it only its metadata."""
    tracked = run(["git", "-C", ROOT, "ls-files", "src/grainmotion"]).split()
    wanted = {name.removeprefix("src/") for name in tracked}
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
        licensed = [name for name in archive.namelist() if name.endswith("LICENSE")]
    if held != wanted:
        raise ReleaseError(f"{wheel.name}: missing {sorted(wanted - held)}, not of the package {sorted(held - wanted)}")
    if "grainmotion/py.typed" not in held or not licensed:
        raise ReleaseError(f"{wheel.name}: py.typed or LICENSE is missing")
    if wheel.stat().st_size > MAX_WHEEL_MB * 1e6:
        raise ReleaseError(f"{wheel.name}: larger than {MAX_WHEEL_MB} MB; what has grown?")


def metadata(wheel: Path) -> Message:
    """The wheel's metadata; the description is its payload."""
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return message_from_bytes(archive.read(name))


def description(told: Message) -> None:
    """The page that an index shows: links and images of the repository lead nowhere there."""
    text = re.sub(r"```.*?```", "", str(told.get_payload()), flags=re.DOTALL)
    if not text.strip():
        raise ReleaseError("the wheel has no description")
    if relative := re.findall(r"\]\((?!https?://|#)([^)]*)\)", text):
        raise ReleaseError(f"the description links to files that an index does not have: {relative}")


def required(wheel: Path) -> list[str]:
    """What the wheel needs by itself and for the tested extras: ``numpy>=2.0``."""
    for_extra = {f'extra == "{extra}"' for extra in EXTRAS.split(",")}
    parts = [line.partition(";") for line in metadata(wheel).get_all("Requires-Dist", [])]
    return [name.strip() for name, _, when in parts if not when or when.strip().replace("'", '"') in for_extra]


def oldest(wheel: Path, python: str, environment: Path) -> Path:
    """An environment with the oldest versions allowed; an error where a bound names another one than is installed.

    The requirements are given one by one: `uv` takes those of a wheel for indirect ones and installs the newest.
    """
    wanted = required(wheel)
    run([TOOLS / "uv", "venv", "--quiet", "--python", python, environment])
    run([TOOLS / "uv", "pip", "install", "--quiet", "--python", environment / "bin" / "python", "--resolution",
         "lowest-direct", "--only-binary", ":all:", *wanted, wheel])  # fmt: skip
    listed = run([TOOLS / "uv", "pip", "list", "--format", "json", "--python", environment / "bin" / "python"])
    not_tested = untested_bounds(wanted, {item["name"]: item["version"] for item in json.loads(listed)})
    if not_tested:
        raise ReleaseError(f"bounds that no installation reaches, raise them: {'; '.join(not_tested)}")
    return environment


def untested_bounds(wanted: list[str], installed: dict[str, str]) -> list[str]:
    """Requirements whose lower bound is not the installed version (2.1 stands for 2.1.3, but not for 2.10)."""
    found = []
    for requirement in wanted:
        name, _, bound = requirement.partition(">=")
        version = installed[re.sub(r"\[.*", "", name).lower().replace("_", "-")]
        if not f"{version}.".startswith(f"{bound}."):
            found.append(f"{requirement}, installed is {version}")
    return found


def use(environment: Path, folder: Path, about: str = "newest dependencies") -> None:
    """Use the wheel as a user does: import it, check types against it, run the demo."""
    python = environment / "bin" / "python"
    version = run([python, "--version"]).strip()
    run([TOOLS / "uv", "pip", "check", "--quiet", "--python", python])
    run([python, "-c", USE], cwd=folder)
    script = folder / "typed.py"
    script.write_text(TYPED)
    typed = subprocess.run(
        [TOOLS / "mypy", "--python-executable", python, "--cache-dir", folder / "mypy", script],
        capture_output=True,
        text=True,
        cwd=folder,
    )
    if 'expression has type "Motions"' not in typed.stdout or "Found 1 error" not in typed.stdout:
        raise ReleaseError(f"{version}, {about}: mypy does not see the package's types:\n{typed.stdout}")
    demo = folder / f"demo-{environment.name}"
    run([environment / "bin" / "grainmotion", "demo", demo, "--quiet"], cwd=folder)
    if not (demo / "results" / "report.html").exists():
        raise ReleaseError(f"{version}, {about}: the demo wrote no report")
    say(f"{version}, {about}: installs, imports, is typed, and the demo finds the motions")


def declared_pythons() -> list[str]:
    """Versions of Python in the classifiers: ``3.11``, ``3.12``..."""
    classifiers = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["classifiers"]
    return [found.group(1) for text in classifiers if (found := re.search(r"Python :: (3\.\d+)$", text))]


def interpreter(version: str) -> str | None:
    """An interpreter of this version that works: on the PATH, or among those of pyenv."""
    return next((path for path in candidates(version) if answers(path, version)), None)


def candidates(version: str) -> Iterator[str]:
    """Where an interpreter of this version may be."""
    if path := shutil.which(f"python{version}"):
        yield path
    yield from map(str, sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python")))


def answers(path: str, version: str) -> bool:
    """Whether an interpreter starts, is of this version and can make environments (pyenv's stand-ins may not)."""
    done = subprocess.run([path, "-c", "import ensurepip, sys; print(sys.version)"], capture_output=True, text=True)
    return done.returncode == 0 and done.stdout.startswith(f"{version}.")


def run(command: list[object], cwd: Path | None = None) -> str:
    """Output of a command that must succeed."""
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, cwd=cwd)
    if done.returncode:
        text = f"{done.stdout}\n{done.stderr}".strip()
        raise ReleaseError(f"`{' '.join(map(str, command))}` ended with {done.returncode}:\n{text[-3000:]}")
    return done.stdout


def say(text: str) -> None:
    """Print a line at once."""
    print(text, flush=True)


if __name__ == "__main__":
    sys.exit(main())
