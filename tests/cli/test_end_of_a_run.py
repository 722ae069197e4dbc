"""What the terminal tells of tracked states (`cli.summary`)."""

import dataclasses

import numpy as np
from rich.console import Console

from grainmotion.cli.summary import print_states
from grainmotion.cli.terminal import Terminal
from grainmotion.model.fluid import FluidFit
from grainmotion.model.motions import Motions
from grainmotion.model.state_fit import StateFit
from scenes import moved_body


def test_level_and_attenuation_of_a_liquid_are_told(capsys):
    motions = Motions.identity(np.array([1, 2]), np.zeros((2, 3)))
    fluid = FluidFit(0.0514, 1.234, attenuation_sd=2e-4, level_sd=0.011)
    print_states(Terminal(), {"wet": dataclasses.replace(motions, fit=StateFit(fluid=fluid))})
    line = "wet: attenuation of the liquid 0.05140 ± 0.00020 1/mm; level of the liquid (z) 1.234 ± 0.011 mm"
    assert line in capsys.readouterr().out.splitlines()


def test_motions_of_bodies_are_told(capsys):
    motions = Motions.identity(np.array([1]), np.zeros((1, 3)))
    fits = {
        "one": StateFit(bodies=(moved_body([0, 0, 0.25, 0, 0, 0]),)),
        "two": StateFit(bodies=(moved_body([0] * 6),)),
    }
    print_states(Terminal(), {name: dataclasses.replace(motions, fit=fit) for name, fit in fits.items()})
    lines = capsys.readouterr().out.splitlines()
    assert "one: rest moved by 0.25 mm and 0°" in lines
    assert "two: rest did not move" in lines


def test_nothing_is_told_of_a_liquid_where_there_is_none(capsys):
    print_states(Terminal(), {"dry": Motions.identity(np.array([1]), np.zeros((1, 3)))})
    assert "liquid" not in capsys.readouterr().out


def test_grains_of_one_status_are_one_line_whatever_their_reasons(capsys):
    count = 30
    motions = Motions.identity(np.arange(1, count + 1), np.zeros((count, 3)))
    statuses = np.array(["ambiguous"] * count, dtype="<U20")
    reasons = tuple(f"it also fits turned by {90 + k}°; take more views" for k in range(count))
    unclear = dataclasses.replace(
        motions,
        statuses=statuses,
        reasons=reasons,
        ok_translation=np.zeros(count, bool),
        ok_rotation=np.zeros(count, bool),
    )
    print_states(Terminal(), {"one": unclear})
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("one, grains")]
    assert lines == [
        "one, grains 1, 2, 3, 4, 5, 6, 7, 8, 9, 10 and 20 more: ambiguous; of grain 1: it also fits turned by 90°; "
        "take more views"
    ]


def test_names_of_states_are_not_cut_off_on_a_narrow_terminal(capsys, monkeypatch):
    monkeypatch.setattr(Terminal, "console", lambda _self, **_: Console(width=64))
    motions = Motions.identity(np.array([1]), np.zeros((1, 3)))
    name = "random-under-load"
    print_states(Terminal(), {name: motions})
    assert f"│ {name} │" in capsys.readouterr().out
