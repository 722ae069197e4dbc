"""Commands in the documentation exist: those of grainmotion are read by its own command line, others looked up."""

from __future__ import annotations

import itertools
import re
import shlex
import tomllib
from importlib.util import find_spec

import pytest
import typer
from packaging.requirements import Requirement

from documented_blocks import PAGES, ROOT, blocks_in, inline_code
from grainmotion.cli.app import app

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
FOREIGN = {"nvidia-smi"}
"""Programs of others, without options."""
FIRST_WORDS = ("grainmotion", "make", "pip", "python", "pytest", ".venv/bin/python")


def commands_in(text: str) -> list[str]:
    """The commands of a block, without comments."""
    lines = (shlex.split(line, comments=True) for line in text.splitlines())
    return [shlex.join(words) for words in lines if words]


def inline_commands() -> list[tuple[str, str]]:
    """Commands in the text of the pages, with their page."""
    return [
        (page.relative_to(ROOT).as_posix(), code)
        for page in PAGES
        for code in dict.fromkeys(inline_code(page))
        if code.split()[0] in FIRST_WORDS
    ]


def ended(_context, _parameter, value):
    """Do nothing but end the program, if the option is given."""
    if value:
        raise typer.Exit


def command_line():
    """The program's own commands, which do nothing."""

    def silenced(command):
        command.callback = lambda **_: None
        for parameter in command.params:
            if parameter.callback is not None:  # an option that tells or installs something and ends the program
                parameter.callback = ended
        for inner in getattr(command, "commands", {}).values():
            silenced(inner)
        return command

    return silenced(typer.main.get_command(app))


def check_grainmotion(words: list[str]) -> None:
    """The command and its options exist, and the number and the kinds of its arguments are right."""
    command_line().main(words, prog_name="grainmotion", standalone_mode=False)


def is_name_of_command(words: list[str]) -> bool:
    """Whether the words name a command, or a group of them, without arguments."""
    command = command_line()
    for word in words:
        command = getattr(command, "commands", {}).get(word)
    return command is not None


def check_pip(words: list[str]) -> None:
    """What is installed is grainmotion with extras that it has, or what it depends on."""
    assert words[0] == "install"
    known = {Requirement(text).name for text in (*PROJECT["dependencies"], *(t for e in EXTRAS.values() for t in e))}
    for text in words[1:]:
        if text != ".":
            requirement = Requirement(text)
            assert requirement.name in known | {"grainmotion"}
            assert requirement.extras <= (EXTRAS.keys() if requirement.name == "grainmotion" else requirement.extras)


def check_python(words: list[str]) -> None:
    """The module or script exists, and paths of tests do; code in the command is Python."""
    if words[0] == "-c":
        compile(words[1], "-c", "exec")
        assert len(words) == 2
    elif words[0] == "-m":
        assert find_spec(words[1]) is not None, words[1]
        assert [word for word in words[2:] if word.startswith("tests/") and not (ROOT / word).exists()] == []
    else:
        assert any(ROOT.glob(words[0])) or any((ROOT / "examples").rglob(words[0])), words[0]


def check_activation(words: list[str]) -> None:
    """An environment of Python is activated as `venv` makes it on Linux and macOS."""
    (script,) = words
    assert script.endswith("/bin/activate")


def check_make(words: list[str]) -> None:
    """The Makefile has the targets."""
    assert not {word for word in words if not word.startswith("PYTHON=")} - TARGETS, words


def check_dask(words: list[str]) -> None:
    """The command of Dask takes the options."""
    from distributed.cli import dask_scheduler, dask_worker

    main = {"scheduler": dask_scheduler.main, "worker": dask_worker.main}[words[0]]
    main.make_context(words[0], words[1:])


CHECKS = {
    "grainmotion": check_grainmotion,
    "pip": check_pip,
    "python": check_python,
    "python3": check_python,
    "source": check_activation,
    ".venv/bin/python": check_python,
    "pytest": lambda words: check_python(["-m", "pytest", *words]),
    "make": check_make,
    "dask": check_dask,
}


def check(command: str) -> None:
    """Check one command by its first word; where its output goes does not matter."""
    first, *words = itertools.takewhile(lambda word: word != ">", shlex.split(command))
    if first in FOREIGN:
        assert not words
    else:
        CHECKS[first](words)


@pytest.mark.parametrize("block", blocks_in("sh"), ids=lambda b: b.place)
def test_commands_of_blocks_exist(block):
    commands = commands_in(block.code)
    assert commands
    for command in commands:
        check(command)


@pytest.mark.parametrize("command", inline_commands(), ids=lambda c: f"{c[0]} {c[1]}")
def test_commands_in_the_text_exist(command):
    """They may be the name of a command alone."""
    first, *words = shlex.split(command[1])
    if not (first == "grainmotion" and is_name_of_command(words)):
        check(command[1])


def helps(command=None, path=()) -> dict[str, str]:
    """The text of ``--help`` of each command, by its name."""
    command = command or command_line()
    inner = getattr(command, "commands", {})
    found = {" ".join(path): command.help} if path else {}
    return found | {name: text for word, sub in inner.items() for name, text in helps(sub, (*path, word)).items()}


@pytest.mark.parametrize("name", helps())
def test_help_of_each_command_has_an_example(name):
    examples = re.findall(r"^Example: (.*)$", helps()[name], re.MULTILINE)
    assert examples
    for example in examples:
        assert example.startswith(f"grainmotion {name.removesuffix(' files')}")
        check(example)


@pytest.mark.parametrize(
    "command",
    [
        "grainmotion run",
        "grainmotion run a.toml b.toml",
        "grainmotion run a.toml --fast",
        "grainmotion export a.toml --format stl",
        "grainmotion export dem a.toml --spheres many",
        "grainmotion runs",
        "grainmotion export dems",
        "pip install grainmotion[every]",
        "pip install napari-nothing",
        "make tea",
        "python -m validation.nothing",
        "python nothing.py",
        "python -c 'import'",
        "dask worker tcp://a:1 --threads 3",
        "nvidia-smi -r",
        "rm -r results",
    ],
)
def test_wrong_commands_are_refused(command):
    with pytest.raises(Exception):  # noqa: B017, PT011  # of typer, click, pytest or a look-up
        check(command)
