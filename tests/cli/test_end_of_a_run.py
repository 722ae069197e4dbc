"""What the terminal tells of tracked states (`cli.summary`)."""

import dataclasses

import numpy as np

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
    line = "wet: attenuation of the liquid 0.05140 ± 0.00020 /mm; level of the liquid (z) 1.234 ± 0.011 mm"
    assert line in capsys.readouterr().out.splitlines()


def test_motions_of_bodies_are_told(capsys):
    motions = Motions.identity(np.array([1]), np.zeros((1, 3)))
    fits = {
        "one": StateFit(bodies=(moved_body([0, 0, 0.25, 0, 0, 0]),)),
        "two": StateFit(bodies=(moved_body([0] * 6),)),
    }
    print_states(Terminal(), {name: dataclasses.replace(motions, fit=fit) for name, fit in fits.items()})
    lines = capsys.readouterr().out.splitlines()
    assert "one: rest moved by 0.25 mm and 0 deg" in lines
    assert "two: rest did not move" in lines


def test_nothing_is_told_of_a_liquid_where_there_is_none(capsys):
    print_states(Terminal(), {"dry": Motions.identity(np.array([1]), np.zeros((1, 3)))})
    assert "liquid" not in capsys.readouterr().out
