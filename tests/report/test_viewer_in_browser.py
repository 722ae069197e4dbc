"""The 3-D viewer in Chromium: choosing grains, motions, colours, cuts, keys, images, and pages without WebGL."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser_pages import clean
from many_grains_report import VOXEL_SIZE, many_grains_report
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from grainmotion.model.scene import Body
from grainmotion.model.state_fit import BodyMotion
from grainmotion.model.volume import Volume
from grainmotion.report import ReportData, surfaces, write_report
from grainmotion.rotations import rotation_matrix

pytestmark = pytest.mark.browser

COUNT = 60
SHOWN = "gm.viewer.shown"


@pytest.fixture(scope="module")
def data() -> ReportData:
    return many_grains_report(COUNT, states=2, across=10)


@pytest.fixture(scope="module")
def path(tmp_path_factory, data) -> Path:
    file = tmp_path_factory.mktemp("viewer") / "report.html"
    write_report(file, data)
    return file


@pytest.fixture
def page(chromium: Browser, path: Path) -> Iterator[Page]:
    with clean(chromium, path, width=1200, height=800) as opened:
        expect(opened.locator("#viewer[data-drawn=yes]")).to_be_visible()
        yield opened


def choose(page: Page, control: str, value: str) -> None:
    page.locator(f"#viewer [data-control={control}]").select_option(value)


def slide(page: Page, control: str, value: float) -> None:
    page.locator(f"#viewer [data-control={control}]").evaluate(
        f"(e) => {{ e.value = {value}; e.dispatchEvent(new Event('input')); }}"
    )
    page.wait_for_timeout(50)


def places(page: Page) -> np.ndarray:
    """Centres as they are drawn ``(n, 3)``, mm."""
    return np.array(page.evaluate(f"Array.from({SHOWN}.grains.places)")).reshape(-1, 3)


def colours(page: Page) -> np.ndarray:
    """Colours of the grains in the texture ``(n, 3)``, 0 to 1."""
    texels = page.evaluate(f"Array.from({SHOWN}.grains.uniforms.grains.value.image.data)")
    return np.array(texels).reshape(-1, 3, 4)[:COUNT, 2, :3]


def seen_at(page: Page, row: int) -> tuple[float, float]:
    """Pixel of the window at which the centre of a grain is, scrolled into view."""
    page.evaluate("document.querySelector('#viewer canvas').scrollIntoView({ behavior: 'instant', block: 'center' })")
    box = page.locator("#viewer canvas").bounding_box()
    x, y = page.evaluate(f"""(() => {{
        const {{ grains, view }} = {SHOWN};
        const v = new THREE.Vector3(...grains.places.subarray(3 * {row}, 3 * {row} + 3)).project(view.camera);
        return [v.x, v.y];
    }})()""")
    assert box is not None
    return box["x"] + (x + 1) / 2 * box["width"], box["y"] + (1 - y) / 2 * box["height"]


def nearest_row(page: Page) -> int:
    """The grain whose centre is nearest the eye: nothing hides it."""
    eye = np.array(page.evaluate(f"{SHOWN}.view.camera.position.toArray()"))
    return int(np.linalg.norm(places(page) - eye, axis=1).argmin())


class TestChoice:
    def test_click_chooses_the_grain_under_it(self, page):
        row = nearest_row(page)
        page.mouse.click(*seen_at(page, row))
        assert page.evaluate("gm.app.grain") == row + 1

    def test_click_beside_the_sample_lets_go(self, page):
        page.evaluate("gm.app.setGrain(5)")
        page.locator("#viewer canvas").click(position={"x": 12, "y": 12})
        assert page.evaluate("gm.app.grain") is None

    def test_pointer_shows_label_and_value(self, page, data):
        row = nearest_row(page)
        page.mouse.move(*seen_at(page, row))
        u = np.linalg.norm(data.states[-1].motions.translations[row])
        expect(page.locator(".viewer-tip")).to_contain_text(f"Grain {row + 1}")
        expect(page.locator(".viewer-tip")).to_contain_text(f"{u:.4f}")

    def test_drag_turns_and_chooses_nothing(self, page):
        before = page.evaluate(f"{SHOWN}.view.where()")
        x, y = seen_at(page, nearest_row(page))
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 80, y + 10, steps=4)
        page.mouse.up()
        after = page.evaluate(f"{SHOWN}.view.where()")
        assert abs(after[0] - before[0]) > 5
        assert page.evaluate("gm.app.grain") is None

    def test_weak_directions_of_a_poorly_determined_grain_are_drawn(self, page, data):
        weak = data.states[-1].motions.statuses.tolist().index("poorly-determined")
        page.evaluate(f"gm.app.setGrain({weak + 1})")
        expect(page.get_by_text("Orange: the directions")).to_be_visible()
        page.evaluate("gm.app.setGrain(null)")
        expect(page.get_by_text("Orange: the directions")).to_be_hidden()

    def test_keys_turn_zoom_and_step(self, page):
        canvas = page.locator("#viewer canvas")
        azimuth, elevation, distance = page.evaluate(f"{SHOWN}.view.where()")
        for key in ("ArrowRight", "ArrowUp", "+"):
            canvas.press(key)
        after = page.evaluate(f"{SHOWN}.view.where()")
        assert after[0] == pytest.approx(azimuth + 6, abs=1e-3)
        assert after[1] == pytest.approx(elevation + 6, abs=1e-3)
        assert after[2] == pytest.approx(distance / 1.15, rel=1e-3)
        canvas.press("]")
        canvas.press("]")
        assert page.evaluate("gm.app.grain") == 2
        canvas.press("[")
        canvas.press("[")
        assert page.evaluate("gm.app.grain") == COUNT
        canvas.press("Escape")
        assert page.evaluate("gm.app.grain") is None


class TestMotion:
    def test_slider_leads_from_reference_to_state(self, page, data):
        motions = data.states[-1].motions
        known = np.isfinite(motions.translations).all(axis=1)
        moved = (motions.centers + motions.translations)[known]
        np.testing.assert_allclose(places(page)[known], moved, atol=1e-4)
        slide(page, "share", 0)
        np.testing.assert_allclose(places(page), motions.centers, atol=1e-4)
        slide(page, "share", 0.5)
        choose(page, "magnification", "10")
        wanted = motions.centers + 5 * motions.translations
        np.testing.assert_allclose(places(page)[known], wanted[known], atol=1e-3)

    def test_other_state_moves_the_grains(self, page, data):
        page.evaluate("gm.app.setState(0)")
        page.wait_for_timeout(300)
        first = data.states[0].motions
        known = np.isfinite(first.translations).all(axis=1)
        np.testing.assert_allclose(places(page)[known], (first.centers + first.translations)[known], atol=1e-4)

    def test_rotations_are_those_of_the_motions(self, page, data):
        texels = np.array(page.evaluate(f"Array.from({SHOWN}.grains.uniforms.grains.value.image.data)"))
        x, y, z, w = texels.reshape(-1, 3, 4)[:COUNT, 1].T
        seen = np.array(
            [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
             [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
             [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
        ).transpose(2, 0, 1)  # fmt: skip
        motions = data.states[-1].motions
        known = np.isfinite(motions.rotations).all(axis=1)
        np.testing.assert_allclose(seen[known], motions.matrices[known], atol=1e-4)

    def test_rigid_motion_of_the_sample_can_be_taken_off(self, page):
        turn, shift = np.array([0.2, -0.5, 0.9]), np.array([1.0, -2.0, 0.5])
        centers = np.random.default_rng(0).normal(size=(9, 3))
        moved = centers @ rotation_matrix(turn).T + shift
        columns = [*(moved - centers).T, *np.tile(np.rad2deg(turn), (9, 1)).T]
        arguments = json.dumps([centers.ravel().tolist(), [column.tolist() for column in columns]])
        shifts, turns = page.evaluate(
            f"(() => {{ const m = gm.viewerMotion.motions(...{arguments}, true);"
            "return [Array.from(m.shifts), Array.from(m.turns)]; })()"
        )
        np.testing.assert_allclose(shifts, 0, atol=1e-5)
        np.testing.assert_allclose(turns, 0, atol=1e-5)


class TestLook:
    def test_colours_follow_the_quantity_and_its_range(self, page):
        first = colours(page)
        choose(page, "colour", "uz")
        page.wait_for_timeout(200)
        second = colours(page)
        assert np.abs(first - second).max() > 0.2
        low, high = page.get_by_label("Lowest value of the colours"), page.get_by_label("Highest value of the colours")
        low.fill("100")
        low.press("Enter")
        high.fill("200")
        high.press("Enter")
        page.wait_for_timeout(200)
        np.testing.assert_allclose(np.unique(colours(page).round(3), axis=0), [[0, 0.071, 0.38], [0.659, 0.682, 0.714]])
        page.get_by_role("button", name="automatic range").click()
        page.wait_for_timeout(200)
        np.testing.assert_allclose(colours(page), second)

    def test_statuses_have_their_own_colours_and_can_be_hidden(self, page, data):
        choose(page, "colour", "status")
        page.wait_for_timeout(200)
        assert len(np.unique(colours(page), axis=0)) == len(set(data.states[-1].motions.statuses))
        choose(page, "colour", "residual")
        expect(page.locator(".viewer-legend")).to_contain_text("measured minus simulated line integrals")
        page.locator("[data-status=converged]").click()
        page.wait_for_timeout(100)
        hidden = np.array(page.evaluate(f"Array.from({SHOWN}.grains.hidden)"), dtype=bool)
        np.testing.assert_array_equal(hidden, data.states[-1].motions.ok)

    def test_motions_that_are_no_results_are_grey_and_have_no_arrow(self, page, data):
        motions = data.states[-1].motions
        grey = [0.659, 0.682, 0.714]
        for quantity, ok in (
            ("u", motions.ok_translation),
            ("w", motions.ok_rotation),
            ("u_less_mean", motions.ok_translation),
        ):
            choose(page, "colour", quantity)
            page.wait_for_timeout(200)
            np.testing.assert_array_equal((np.abs(colours(page) - grey) < 0.01).all(axis=1), ~ok)
            expect(page.locator(".viewer-legend")).to_contain_text("Grey: no result to use.")
        u = np.linalg.norm(motions.translations, axis=1)[motions.ok_translation]
        choose(page, "colour", "u")
        page.wait_for_timeout(200)
        top = float(page.get_by_label("Highest value of the colours").input_value())
        assert top <= 1.1 * u.max()  # of the results alone
        choose(page, "arrows", "u")
        page.wait_for_timeout(200)
        arrows = page.evaluate(f"""(() => {{
            let most = 0;
            const count = ({{ geometry }}) => {{ most = Math.max(most, geometry?.attributes.along?.count ?? 0); }};
            {SHOWN}.scene.traverse(count);
            return most;
        }})()""")
        assert arrows == motions.ok_translation.sum()

    def test_cut_hides_what_is_in_front(self, page):
        row = nearest_row(page)
        spot = seen_at(page, row)
        page.mouse.click(*spot)
        assert page.evaluate("gm.app.grain") == row + 1
        choose(page, "cut", "y")
        slide(page, "cut-place", 0.6)
        page.mouse.click(*spot)
        assert page.evaluate("gm.app.grain") != row + 1

    def test_cut_grains_are_flat_and_in_their_own_colour(self, page):
        """Looked at along y and cut through the sample's middle: where one grain is cut, its colour and no shade."""
        page.locator("#viewer [data-control=view-front]").click()
        choose(page, "cut", "y")
        slide(page, "cut-place", 0.5)
        page.wait_for_timeout(200)
        plane = page.evaluate(f"{SHOWN}.grains.uniforms.cutRange.value.x")
        centers, radii = places(page), np.array(page.evaluate(f"Array.from({SHOWN}.grains.radii)"))
        row = int(np.argmin(np.abs(centers[:, 1] - plane) / radii))
        around = page.evaluate(f"""(() => {{
            const {{ grains, view, canvas }} = {SHOWN}, [x, , z] = grains.places.subarray(3 * {row}, 3 * {row} + 3);
            const v = new THREE.Vector3(x, {plane}, z).project(view.camera), {{ width, height }} = canvas.canvas;
            canvas.draw();
            const copy = Object.assign(document.createElement("canvas"), {{ width, height }}).getContext("2d");
            copy.drawImage(canvas.canvas, 0, 0);
            return [...copy.getImageData((v.x + 1) / 2 * width - 3, (1 - v.y) / 2 * height - 3, 7, 7).data];
        }})()""")
        seen = np.array(around, float).reshape(-1, 4)[:, :3] / 255
        assert np.ptp(seen, axis=0).max() < 0.02
        np.testing.assert_allclose(seen.mean(axis=0) ** 2.2, 0.9 * colours(page)[row] ** 2.2, atol=0.02)

    def test_a_view_from_behind_the_cut_shows_whole_grains(self, page):
        page.locator("#viewer [data-control=view-side]").click()
        choose(page, "cut", "x")  # the eye is on the side that is shown
        page.wait_for_timeout(200)
        assert not page.evaluate(f"{SHOWN}.grains.cap.face.visible")

    def test_arrows_are_drawn_and_their_length_told(self, page):
        choose(page, "arrows", "u")
        expect(page.locator(".viewer-note[aria-live]")).to_contain_text("as long as the displacements")
        page.wait_for_timeout(200)
        assert page.evaluate(f"{SHOWN}.canvas.renderer.info.render.calls") <= 4

    def test_nothing_is_drawn_while_nothing_changes(self, page):
        page.wait_for_timeout(300)
        before = page.evaluate(f"{SHOWN}.canvas.frames()")
        page.wait_for_timeout(400)
        assert page.evaluate(f"{SHOWN}.canvas.frames()") == before

    def test_image_is_saved_with_grains_on_it(self, page, tmp_path):
        with page.expect_download() as download:
            page.locator("#viewer [data-control=save]").click()
        assert download.value.suggested_filename == "grains-load-02-u.png"
        download.value.save_as(tmp_path / "grains.png")
        image = np.asarray(Image.open(tmp_path / "grains.png").convert("RGB"), dtype=int)
        middle = image[image.shape[0] // 2, image.shape[1] // 2]
        assert np.ptp(middle) > 30  # coloured, not the grey of the page

    def test_all_grains_take_one_draw_call(self, page):
        page.evaluate(f"{SHOWN}.scene.children[1].visible = false; {SHOWN}.canvas.request()")
        page.wait_for_timeout(200)
        assert page.evaluate(f"{SHOWN}.canvas.renderer.info.render.calls") == 1


class TestOtherPages:
    def test_no_webgl_is_told_in_words(self, chromium, path):
        context = chromium.new_context()
        try:
            page = context.new_page()
            page.add_init_script(
                "const given = HTMLCanvasElement.prototype.getContext;"
                "HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {"
                "  return kind.startsWith('webgl') ? null : given.call(this, kind, ...rest); };"
            )
            page.goto(path.as_uri())
            expect(page.locator("#viewer .viewer-lost")).to_contain_text("no 3-D graphics")
            page.evaluate("gm.app.setGrain(7)")
            expect(page.locator("#grain-panel")).to_contain_text("7")
        finally:
            context.close()

    def test_without_labels_balls_are_drawn(self, chromium, tmp_path, data):
        write_report(tmp_path / "balls.html", replace(data, labels=None, volume=None))
        with clean(chromium, tmp_path / "balls.html") as page:
            expect(page.locator("#viewer[data-drawn=yes]")).to_be_visible()
            assert page.evaluate(f"{SHOWN}.grains.triangles") == COUNT * 320

    def test_very_many_grains_are_ellipsoids_of_their_size(self, chromium, tmp_path, data, monkeypatch):
        monkeypatch.setattr(surfaces, "MAX_MESHES", COUNT - 1)
        write_report(tmp_path / "ellipsoids.html", data)
        with clean(chromium, tmp_path / "ellipsoids.html") as page:
            expect(page.locator("#viewer[data-drawn=yes]")).to_be_visible()
            assert page.evaluate(f"{SHOWN}.grains.triangles") == COUNT * 320
            radii = np.array(page.evaluate(f"Array.from({SHOWN}.grains.radii)"))
            assert data.labels is not None
            balls = np.cbrt(np.bincount(data.labels.ravel())[1:] * 3 / (4 * np.pi)) * VOXEL_SIZE
            assert (radii > balls).all()
            assert (radii < 1.6 * balls).all()

    def test_reference_alone_is_drawn(self, chromium, tmp_path, data):
        write_report(tmp_path / "reference.html", replace(data, states=()))
        with clean(chromium, tmp_path / "reference.html") as page:
            expect(page.locator("#viewer[data-drawn=yes]")).to_be_visible()
            centers = data.states[0].motions.centers
            assert np.abs(places(page) - centers).max() < 0.3

    def test_no_grains_at_all(self, chromium, tmp_path):
        volume = Volume(np.zeros((4, 5, 6), np.float32), 0.1)
        empty = ReportData("empty", volume=volume, labels=np.zeros((4, 5, 6), np.int32))
        write_report(tmp_path / "empty.html", empty)
        with clean(chromium, tmp_path / "empty.html") as page:
            expect(page.locator("#viewer[data-drawn=yes]")).to_be_visible()


class TestBodies:
    """A plate above the grains, which moves down and tilts in the second of two states."""

    MOTION = (0.1, 0.0, -0.4, 0.0, 0.05, 0.0)

    @pytest.fixture
    def plate(self, data) -> Body:
        top = data.volume.center[2] + data.volume.shape[0] * VOXEL_SIZE / 2
        return Body("upper piston", "piston", Volume(np.full((8, 60, 70), 0.5), VOXEL_SIZE, (0.0, 0.0, top)))

    @pytest.fixture
    def page(self, chromium, tmp_path, data, plate) -> Iterator[Page]:
        u, w = np.array(self.MOTION[:3]), np.array(self.MOTION[3:])
        moved = BodyMotion(plate.name, plate.kind, "free", plate.center, u, w, np.eye(6), True)
        first, last = data.states
        last = replace(last, motions=replace(last.motions, fit=replace(last.motions.fit, bodies=(moved,))))
        write_report(tmp_path / "bodies.html", replace(data, states=(first, last), bodies=(plate,)))
        with clean(chromium, tmp_path / "bodies.html", width=1200, height=800) as opened:
            expect(opened.locator("#viewer[data-drawn=yes]")).to_be_visible()
            yield opened

    def corners(self, page: Page) -> np.ndarray:
        """Vertices of the body as they are drawn ``(n, 3)``, mm."""
        points = page.evaluate(f"""(() => {{
            const [mesh] = {SHOWN}.bodies.group.children, v = new THREE.Vector3();
            mesh.updateMatrixWorld();
            return Array.from({{ length: mesh.geometry.attributes.position.count }}, (_, i) =>
              v.fromBufferAttribute(mesh.geometry.attributes.position, i).applyMatrix4(mesh.matrixWorld).toArray());
        }})()""")
        return np.array(points)

    def test_surfaces_move_with_the_body(self, page, data, plate):
        expect(page.locator(".viewer-note[aria-live]")).to_contain_text("Translucent bodies: upper piston.")
        page.evaluate("gm.app.setState(0)")
        page.wait_for_timeout(200)
        half = np.array([7.0, 6.0, 0.8]) / 2
        still = self.corners(page) - plate.center
        np.testing.assert_allclose([still.min(axis=0), still.max(axis=0)], [-half, half], atol=VOXEL_SIZE)
        page.evaluate("gm.app.setState(1)")
        page.wait_for_timeout(200)
        turn = rotation_matrix(np.array(self.MOTION[3:]))
        np.testing.assert_allclose(self.corners(page), still @ turn.T + plate.center + self.MOTION[:3], atol=1e-3)

    def test_grains_are_seen_and_chosen_through_it(self, page):
        page.locator("#viewer [data-control=view-top]").click()
        page.wait_for_timeout(200)
        row = int(np.argmin(np.hypot(*places(page)[:, :2].T) - places(page)[:, 2]))
        page.mouse.click(*seen_at(page, row))
        assert page.evaluate("gm.app.grain") is not None
        with_plate, without = self.picture(page, True), self.picture(page, False)
        changed = np.abs(with_plate - without).max(axis=-1)[without[..., 3] == 255]  # where grains are
        assert np.median(changed) > 4
        assert np.percentile(changed, 98) < 128

    def picture(self, page: Page, bodies: bool) -> np.ndarray:
        """The canvas ``(rows, columns, 4)``, with or without bodies."""
        values = page.evaluate(f"""(() => {{
            const {{ canvas, bodies }} = {SHOWN}, {{ width, height }} = canvas.canvas;
            bodies.group.visible = {str(bodies).lower()};
            canvas.draw();
            const copy = Object.assign(document.createElement("canvas"), {{ width, height }}).getContext("2d");
            copy.drawImage(canvas.canvas, 0, 0);
            return [width, height, ...copy.getImageData(0, 0, width, height).data];
        }})()""")
        return np.array(values[2:], int).reshape(values[1], values[0], 4)


def test_slow_machines_draw_fewer_triangles_while_the_view_turns(page):
    page.evaluate(f"{SHOWN}.grains.setCoarse(true); {SHOWN}.canvas.request()")
    page.wait_for_timeout(200)
    assert page.evaluate(f"{SHOWN}.canvas.renderer.info.render.triangles") < 60 * COUNT
    row = nearest_row(page)
    page.mouse.click(*seen_at(page, row))
    assert page.evaluate("gm.app.grain") == row + 1
