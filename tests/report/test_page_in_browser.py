"""The page's own controls in Chromium: states, theme, grains that need a look, panel, table, download, settings."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import example
import numpy as np
import pandas as pd
import pytest
from browser_pages import clean
from playwright.sync_api import Browser, Page, expect

from grainmotion.model.motions import Motions, Status
from grainmotion.report import ReportData, StateReport, write_report
from grainmotion.report.data import RunRecord
from grainmotion.report.tables import significant

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def report_path(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    first, second = example.data().states
    moved = replace(second.motions, translations=second.motions.translations + 1.0)
    run = RunRecord("grainmotion run 'my file.toml' --force", "[volume]\nshape = [9, 8, 7]")
    write_report(path, replace(example.data(), states=(first, replace(second, motions=moved)), run=run))
    return path


@pytest.fixture(scope="module")
def long_names_path(tmp_path_factory) -> Path:
    """As `report_path`, with names of hundreds of letters and no place to break them."""
    path, long = tmp_path_factory.mktemp("page") / "long.html", 300 * "x"
    (first, _), run = example.data().states, RunRecord(f"grainmotion run {long}", long, folder=f"/{long}")
    states = tuple(replace(first, name=f"{long}{k}", views=(long, long)) for k in range(2))
    write_report(path, replace(example.data(), title=long, facts=((long, long),), states=states, run=run))
    return path


@pytest.fixture
def report(chromium: Browser, report_path: Path) -> Iterator[Page]:
    with clean(chromium, report_path) as page:
        expect(page.locator("#grain-table tbody tr[data-label]")).to_have_count(6)
        yield page


def cells(page: Page, key: str) -> list[str]:
    """Texts of a column of the table, in the order shown."""
    keys = page.locator("#grain-table thead [data-key]").evaluate_all("all => all.map((head) => head.dataset.key)")
    return page.locator(f"#grain-table tr[data-label] td:nth-child({keys.index(key) + 1})").all_text_contents()


def numbers(texts: list[str]) -> list[float]:
    return [float(text.replace("−", "-")) for text in texts if text != "–"]


def test_slider_of_states_changes_all_of_the_page(report):
    assert report.evaluate("gm.app.state") == 1
    last = numbers(cells(report, "ux"))
    report.get_by_label("State", exact=True).locator("input").press("ArrowLeft")
    expect(report.locator("#grains-title")).to_contain_text("step-01")
    expect(report.locator("#state-control output")).to_have_text("step-01")
    expect(report.locator(".summary tr[aria-current] button")).to_have_text("step-01")
    expect(report.locator("#grain-table tr[data-label='1']")).to_contain_text(
        f"{example.motions().translations[0, 0]:.4f}"
    )
    np.testing.assert_allclose(numbers(cells(report, "ux")), np.array(last) - 1, atol=2e-4)
    report.locator(".summary button").nth(1).click()
    expect(report.locator("#state-control output")).to_contain_text("step-02")


def test_figures_are_those_of_the_state(report):
    motions = example.motions()
    text = report.locator("#figures").inner_text()
    assert f"{int(motions.ok_translation.sum())}\ntranslations to use" in text
    assert "33 % of 6" in text
    u = np.linalg.norm(motions.translations + 1.0, axis=1)[motions.ok_translation]
    w = np.rad2deg(np.linalg.norm(motions.rotations, axis=1))[motions.ok_rotation]
    assert f"{significant(np.median(u))} mm\nmedian displacement" in text
    assert f"{significant(np.median(w))} °\nmedian rotation" in text
    expect(report.locator("#status-bar .chip")).to_have_count(5)
    assert report.evaluate("[0.0099996, 0.00998, 999.6].map(v => gm.significant(v))") == ["0.0100", "0.00998", "1000"]


def test_numbers_that_are_no_results_to_use_look_otherwise(report):
    motions = example.motions()
    unused = report.locator("#grain-table td.unused")
    columns = 5  # length, three components and sd
    expect(unused).to_have_count(int(columns * ((~motions.ok_translation).sum() + (~motions.ok_rotation).sum())))


def test_theme_follows_the_system_and_the_button(chromium, report_path):
    with clean(chromium, report_path, dark=True) as page:
        root = page.locator("html")
        expect(root).to_have_attribute("data-theme", "dark")
        page.locator("#theme").click()
        expect(root).to_have_attribute("data-theme", "light")
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(245, 246, 248)"


def test_grains_that_need_a_look_are_chosen_by_their_labels(report):
    attention = report.locator("#attention")
    expect(attention.locator("li")).to_have_count(4)
    expect(attention).to_contain_text("not-converged, because </script><img src=x onerror=alert(1)>")
    attention.get_by_role("button", name="Grain 11").click()
    assert report.evaluate("gm.app.grain") == 11
    expect(report.locator("#grain-panel h3")).to_have_text("Grain 11")
    expect(report.locator("tr[data-label='11']")).to_have_attribute("aria-selected", "true")
    expect(attention.get_by_role("button", name="Grain 11")).to_have_attribute("aria-pressed", "true")
    expect(report.locator("#chosen-grain")).to_have_text("Grain 11 ↑")


def test_panel_shows_motion_deviations_and_weak_directions(report):
    panel, motions = report.locator("#grain-panel"), example.motions()
    panel.get_by_label("Label of a grain").fill("51")
    panel.get_by_label("Label of a grain").press("Enter")
    expect(panel.locator("h3")).to_have_text("Grain 51")
    translation = panel.locator(".motion tbody tr").first.inner_text().replace("−", "-")
    assert f"{motions.translations[5, 0] + 1:.4f}" in translation
    assert f"± {np.sqrt(motions.covariances[5, 0, 0]):.3f}" in translation
    expect(panel).to_contain_text("Translation is known about equally well in all directions")
    expect(report.locator("#history svg.chart")).to_have_count(2)
    report.locator("#history .hit").first.click()
    assert report.evaluate("gm.app.state") == 0
    panel.get_by_label("Previous grain").click()
    assert report.evaluate("gm.app.grain") == 41
    panel.get_by_label("Choose no grain").click()
    expect(panel.get_by_label("Label of a grain")).to_be_visible()
    panel.get_by_label("Label of a grain").fill("7")
    panel.get_by_role("button", name="Show").click()
    expect(panel).to_contain_text("There is no grain 7.")


def test_table_is_sorted_up_and_down_by_its_headings(report):
    head = report.locator("#grain-table [data-key='wx']")
    for turn, order in (("ascending", 1), ("descending", -1)):
        head.get_by_role("button").press("Enter")
        expect(head).to_have_attribute("aria-sort", turn)
        shown = cells(report, "wx")
        assert numbers(shown) == sorted(numbers(shown), reverse=order < 0)
        assert (len(numbers(shown)), shown[-1]) == (5, "–")
    report.locator("#grain-table [data-key='status'] button").click()
    assert cells(report, "status") == sorted(cells(report, "status"))


def test_table_is_searched_and_filtered_and_saved_as_shown(report, tmp_path):
    search = report.get_by_label("Search grains by label, status or reason")
    for text, labels in (("11, 31-51", ["11", "31", "41", "51"]), ("not-converged, because", ["11"]), ("nothing", [])):
        search.fill(text)
        assert cells(report, "label") == labels
    search.fill("")
    report.locator("#grain-table .chip", has_text="converged").first.click()
    assert set(cells(report, "status")) == {"converged"}
    with report.expect_download() as waiting:
        report.get_by_role("button", name="Download CSV").click()
    assert waiting.value.suggested_filename == "step-02_script_img_src_x_onerror_alert_1_x_-grains.csv"
    waiting.value.save_as(tmp_path / "grains.csv")
    saved = pd.read_csv(io.StringIO((tmp_path / "grains.csv").read_text(encoding="utf-8")), keep_default_na=True)
    read, motions = Motions.from_table(saved), example.motions()
    rows = np.flatnonzero(motions.statuses == Status.CONVERGED.value)
    np.testing.assert_array_equal(read.labels, motions.labels[rows])
    np.testing.assert_allclose(read.translations, motions.translations[rows] + 1, rtol=1e-6, atol=0.5e-6)
    np.testing.assert_allclose(read.rotations, motions.rotations[rows], rtol=1e-6, atol=np.deg2rad(0.5e-5))
    np.testing.assert_allclose(saved["sd_wx"], np.rad2deg(np.sqrt(motions.covariances[rows, 3, 3])), rtol=1.2e-3)
    np.testing.assert_allclose(saved["residual"], motions.residuals[rows], rtol=1.5e-4)
    np.testing.assert_array_equal(read.ok_rotation, motions.ok_rotation[rows])
    np.testing.assert_allclose(read.centers, motions.centers[rows], rtol=1e-5)


def test_arrows_walk_through_the_table_and_columns_are_shown_on_demand(report):
    region = report.get_by_role("region", name="Rows of the table")
    region.focus()
    for _ in range(3):
        report.keyboard.press("ArrowDown")
    assert report.evaluate("gm.app.grain") == 21
    heads = report.locator("#grain-table thead [data-key]")
    before = heads.count()
    report.get_by_role("button", name="Reasons").click()
    expect(heads).to_have_count(before + 1)
    assert "not-converged, because" in cells(report, "reason")[1]


def test_keyboard_keeps_its_place_where_controls_are_drawn_anew(report):
    """The focus stays on what was pressed, or goes to what takes its place."""
    focused = "document.activeElement.dataset.focus ?? document.activeElement.getAttribute('aria-label')"
    report.locator("#grain-table [data-key='sd_u'] button").focus()
    for turn in ("ascending", "descending"):
        report.keyboard.press("Enter")
        expect(report.locator("#grain-table [data-key='sd_u']")).to_have_attribute("aria-sort", turn)
        assert report.evaluate(focused) == "sd_u"
    report.evaluate("gm.app.setGrain(1)")
    report.get_by_label("Next grain", exact=True).focus()
    for label in (11, 21):
        report.keyboard.press("Enter")
        expect(report.locator("#grain-panel h3")).to_have_text(f"Grain {label}")
        assert report.evaluate(focused) == "Next grain"
    report.get_by_label("Choose no grain").press("Enter")
    expect(report.locator("#grain-panel h3")).to_have_text("Choose a grain")
    assert report.evaluate(focused) == "The chosen grain"
    report.get_by_label("Previous state").press("Enter")
    assert report.evaluate(focused) == "State"  # there is no state before the first


def test_thousands_of_grains_take_few_elements(chromium, tmp_path):
    many = Motions.identity(np.arange(1, 5001), np.random.default_rng(0).normal(size=(5000, 3)))
    images = np.zeros((1, 4, 5))
    write_report(tmp_path / "many.html", ReportData("many", states=(StateReport("s", images, images, many, 0.1),)))
    with clean(chromium, tmp_path / "many.html") as page:
        rows = page.locator("#grain-table tr[data-label]")
        expect(rows.first).to_be_visible()
        assert rows.count() < 80
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        expect(page.locator("#grain-table .nothing")).to_have_text(
            "4500 more grains are on the page and in motions.csv."
        )
        page.evaluate("dispatchEvent(new Event('afterprint'))")
        page.evaluate("gm.app.setGrain(4321)")
        expect(page.locator("tr[data-label='4321']")).to_have_attribute("aria-selected", "true")
        assert rows.count() < 80
        expect(page.locator("#attention .labels button")).to_have_count(25)


def test_command_and_settings_are_there_to_copy(report):
    run = report.locator("#run")
    expect(run.locator("pre").first).to_have_text("grainmotion run 'my file.toml' --force")
    run.get_by_role("button", name="Copy").first.click()
    expect(run.get_by_role("button", name="Copied").or_(run.get_by_role("button", name="Selected"))).to_be_visible()


@pytest.mark.parametrize("width", [360, 800, 1200, 2560])
def test_nothing_is_cut_off(chromium, report_path, long_names_path, width):
    with clean(chromium, long_names_path if width == 360 else report_path, width=width) as page:
        page.evaluate("gm.app.setGrain(11)")
        expect(page.locator("#history svg.chart")).to_have_count(2)
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_every_control_and_picture_has_a_name(report):
    nameless = report.evaluate(
        """() => [...document.querySelectorAll("button, input, select, img, svg[role=img], canvas")].filter((e) =>
          !(e.textContent.trim() || e.getAttribute("aria-label") || e.title || e.alt || e.labels?.length
            || e.getAttribute("alt") === "" || e.getAttribute("aria-hidden"))).map((e) => e.outerHTML.slice(0, 120))"""
    )
    assert nameless == []


def test_paper_has_all_rows_and_no_controls(report):
    report.emulate_media(media="print")
    expect(report.locator("#bar")).to_be_hidden()
    expect(report.get_by_role("button", name="Download CSV")).to_be_hidden()
    expect(report.locator("tr[data-label='51']")).to_be_visible()
    report.evaluate("dispatchEvent(new Event('beforeprint'))")
    head = report.locator("#grain-table [data-key='ux']")
    assert (
        head.evaluate("head => getComputedStyle(head, '::before').content") == '"x"'
    )  # on each sheet, as no button is
    shown = report.locator(".viewer-still").evaluate(
        "c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.filter((v, k) => k % 4 === 3 && v).length"
    )
    assert shown > 500  # pixels of grains
    report.evaluate("dispatchEvent(new Event('afterprint'))")
    expect(report.locator(".viewer-still")).to_have_count(0)


@pytest.mark.parametrize("states", [(), (0,)])
def test_reference_alone_and_a_state_without_grains(chromium, tmp_path, states):
    nothing = Motions.identity(np.zeros(0, int), np.zeros((0, 3)))
    images = np.full((1, 4, 5), np.nan)
    data = replace(example.data(), states=tuple(StateReport("s", images, images, nothing, 0.1) for _ in states))
    write_report(tmp_path / "report.html", data)
    with clean(chromium, tmp_path / "report.html") as page:
        expect(page.locator("html")).to_have_attribute("data-ready", "yes")
        expect(page.locator("#summary")).to_be_visible()
        expect(page.locator("#reconstruction-curve svg")).to_be_visible()
        page.evaluate("gm.app.setGrain(gm.app.data.grains.labels[0] ?? null)")
        expect(page.locator("#grain-panel h3")).to_have_count(1)
