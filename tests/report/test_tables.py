"""Formatting of numbers in the report's tables, and their columns."""

from dataclasses import replace

import numpy as np
import pytest
from example import motions

from grainmotion.model.state_fit import BodyMotion, NewGrain, PieceMotion
from grainmotion.report import StateReport, tables


class TestNumbers:
    @pytest.mark.parametrize(
        ("value", "text"),
        [
            (0.00412, "0.0041"),
            (0.07, "0.070"),
            (12.3, "12"),
            (123.4, "123"),
            (0, "0"),
            (-0.5, "−0.50"),
            (3e-7, "3.0e−07"),
        ],
    )
    def test_significant_digits(self, value, text):
        assert tables.significant(value, 2) == text

    @pytest.mark.parametrize(("value", "text"), [(-1.23456, "−1.235"), (-0.0001, "0.000"), (np.nan, "–")])
    def test_fixed_decimals(self, value, text):
        assert tables.number(value, 3) == text

    @pytest.mark.parametrize(("voxel_size", "decimals"), [(0.112, 4), (1.0, 3), (0.01, 5), (20.0, 2), (5000.0, 0)])
    def test_lengths_show_a_thousandth_of_a_voxel(self, voxel_size, decimals):
        assert tables.length_decimals(voxel_size) == decimals


def test_medians_of_a_state_are_over_the_results_to_use():
    images, all_grains = np.zeros((1, 2, 2)), motions()
    wrong = replace(
        all_grains, translations=np.where(all_grains.ok_translation[:, None], all_grains.translations, 99.0)
    )
    values = tables.summary_row(StateReport("a", images, images, wrong, 0.1)).values
    u = np.linalg.norm(wrong.translations[wrong.ok_translation], axis=1)
    w = np.rad2deg(np.linalg.norm(wrong.rotations[wrong.ok_rotation], axis=1))
    sd = np.sqrt(np.diagonal(wrong.covariances, axis1=1, axis2=2)[wrong.ok_translation, :3].mean(axis=1))
    assert values[0] == tables.number(np.median(u), 4)
    assert values[2] == tables.number(np.median(w), 3)
    assert values[3] == tables.significant(np.median(sd), 2)


def test_bodies_have_motions_with_standard_deviations():
    images, covariance = np.zeros((1, 2, 2)), np.diag([0.01, 0.01, 0.02, *np.deg2rad([0.1, 0.1, 104.0])]) ** 2
    moved = BodyMotion(
        "upper piston", "piston", "free", np.zeros(3), np.array([0, 0, -0.25]), np.zeros(3), covariance, True
    )
    still = replace(moved, name="wall", moved=False)
    with_bodies = replace(motions(), fit=replace(motions().fit, bodies=(moved, still)))
    first, second = tables.body_rows(StateReport("a", images, images, with_bodies, 0.1))
    assert first[:2] == ("upper piston", "moved")
    assert first[2][2] == "−0.2500 ± 0.020"
    assert first[2][5] == "not determined"
    assert second == ("wall", "did not move", ["–"] * 6)


def test_a_round_pistons_turn_about_its_axis_is_not_told_as_if_it_were_measured():
    covariance = np.diag([0.01, 0.01, 0.0031, *np.deg2rad([0.07, 0.07, 104.0])]) ** 2
    turned = np.deg2rad([0.3, 0.4, 20.0])
    piston = BodyMotion(
        "upper piston", "piston", "free", np.zeros(3), np.array([0, 0, -0.2517]), turned, covariance, True
    )
    sentences = tables.scene_sentences(replace(motions().fit, bodies=(piston, replace(piston, moved=False))))
    told = "upper piston moved by 0.2517 ± 0.0031 mm and 0.500 ± 0.070°, its turn about z not determined"
    assert sentences == [told, "upper piston did not move"]


def test_new_grains_and_pieces_have_rows_and_sentences():
    images, covariance = np.zeros((1, 2, 2)), np.diag([0.01, 0.01, 0.02, *np.deg2rad([0.1, 0.1, 0.2])]) ** 2
    new = NewGrain(np.array([1.0, -2.0, 0.5]), np.full(3, 0.02), 0.9, 0.03, 0.11)
    piece = PieceMotion(5, 1, 0.6, np.zeros(3), np.array([0, 0, 0.25]), np.zeros(3), covariance, "converged")
    pieces = (piece, replace(piece, piece=2, share=0.4))
    state = StateReport(
        "a", images, images, replace(motions(), fit=replace(motions().fit, appeared=(new,), pieces=pieces)), 0.1
    )
    ((name, values),) = tables.appeared_rows(state)
    assert (name, values[1], values[3]) == ("1", "−2.0000 ± 0.020", "0.9000 ± 0.030")
    first, second = tables.piece_rows(state)
    assert first[:2] == ("5, piece 1", "converged")
    assert first[2][:1] + first[2][3:4] == ["60%", "0.2500 ± 0.020"]
    assert second[0] == "5, piece 2"
    sentences = tables.scene_sentences(state.motions.fit)
    assert sentences[0].startswith("a grain has appeared that the reference does not have: x = 1, y = -2")
    assert sentences[1] == "1 broken grain in 2 pieces"
