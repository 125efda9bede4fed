"""The page in a real browser: what it shows is where the flight was."""

from __future__ import annotations

import base64
import html
import io
import json
import logging
import re
import socket
import urllib.request
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rans.errors import ConfigError
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.show.scene.scene import BODIES
from rans.show.scene.view import View
from tests.support.browser import chromium
from tests.support.processes import PATIENCE
from tests.support.reference_flights import TRACKING, drifting, lqr_flight

TIMES = (0.0, 2.5, 6.0)
"""s; 2.5 lies in the middle of a control period."""

PROBE = """<script>
viewer.animate = () => {};  // nothing is drawn but what is asked for
// The animation comes with the last message of the page.
function probe() {
  if (!viewer.animator.actions.length) return setTimeout(probe, 100);
  const at = (...path) => viewer.scene_tree.find(["flights", ...path]).object;
  const found = TIMES.map(t => {
    rans.seek(t);
    viewer.scene.updateMatrixWorld(true);
    viewer.renderer.render(viewer.scene, viewer.camera);
    const craft = at("0 LQR", "episode 0", "craft"), trail = at("0 LQR", "episode 0", "trail");
    const world = craft.getWorldPosition(new MeshCat.THREE.Vector3());
    const seen = world.clone().project(viewer.camera);
    return {place: at().worldToLocal(world.clone()).toArray(), pixel: [(1 + seen.x) / 2, (1 - seen.y) / 2],
            plumes: craft.children.filter(c => c.visible).map(c => c.name).filter(n => n.startsWith("plume")),
            clock: document.querySelector("#rans-clock").textContent, title: document.title,
            label: document.querySelector(".rans-label").innerText,
            legend: [...document.querySelectorAll("#rans-legend li")].map(x => x.textContent),
            trail: trail.children.filter(c => c.visible).length,
            picture: viewer.renderer.domElement.toDataURL()};
  });
  document.body.innerHTML = `<pre id="found">${JSON.stringify(found).replaceAll("<", "\\\\u003c")}</pre>`;
}
probe();
</script></body>"""


def browse(page: Path) -> str:
    """The page after its scripts have run, without any network."""
    return chromium(
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--host-resolver-rules=MAP * ~NOTFOUND",
        "--virtual-time-budget=10000",
        "--window-size=640,480",
        "--dump-dom",
        page.as_uri(),
        profile=page.parent / "profile",
    )


@pytest.mark.slow
def test_the_browser_finds_the_body_where_it_flew(tmp_path: Path) -> None:
    flight = lqr_flight(episodes=1)
    page = tmp_path / "replay.html"
    view = View()
    assert view.show([flight], "Flight <of> LQR") == ["grey"]
    view.save(page)
    assert page.stat().st_size < 5e6
    page.write_text(page.read_text().replace("</body>", PROBE.replace("TIMES", str(list(TIMES)))))
    found = json.loads(
        html.unescape(re.findall('<pre id="found">(.*?)</pre>', browse(page), re.DOTALL)[-1])
    )
    for time, frame in zip(TIMES, found, strict=True):
        before = int(time / 0.2)
        after = -int(-time // 0.2)
        p = np.array(leaves(flight.states.p))[:, :, 0]
        # The browser moves it straight through a period, and counts in float32.
        np.testing.assert_allclose(frame["place"], (p[:, before] + p[:, after]) / 2, atol=1e-5)
        firing = np.flatnonzero(flight.commands[before, 0])
        assert {int(name.split()[1]) for name in frame["plumes"]} == set(firing)
        errors = {name: error[int(time / 0.2), 0] for name, error in flight.errors().items()}
        place = 100.0 * errors["position"]
        turn = np.degrees(errors["attitude"])
        said = [float(word) for word in re.findall(r"([\d.]+) (?:cm|deg)", frame["label"])]
        assert said == pytest.approx(
            [place, turn], abs=0.51
        )  # rounded to a whole number from 10 on
        assert frame["label"].startswith("LQR")
        assert (frame["clock"], frame["title"]) == (f"{time:.1f} s of 25 s", "Flight <of> LQR")
    assert found[0]["legend"] == [
        "LQR",
        "goal",
        "open thruster, as long as its command",
        "way flown",
        "x axis",
        "y axis",
        "z axis",
    ]
    trails = [frame["trail"] for frame in found]
    assert trails[0] == 0 < trails[1] < trails[2]
    check_pictures(found)


PLAYED = """<script>
viewer.animate = () => {};
function probe() {
  if (!viewer.animator.actions.length) return setTimeout(probe, 100);
  if (!window.ready) return setTimeout(probe, 200, window.ready = true);  // the page looks every 50 ms
  const shown = () => {
    const found = [];
    viewer.scene.traverse(x => { if (/^(plume|trail) /.test(x.name) && x.visible) found.push(x.name); });
    return found;
  };
  const pairs = TIMES.map(t => {
    rans.seek(t);
    const sought = shown();
    viewer.animator.reset();
    viewer.animator.play();
    viewer.animator.mixer.update(t);
    return [sought, shown()];
  });
  document.body.innerHTML = `<pre id="found">${JSON.stringify(pairs)}</pre>`;
}
probe();
</script></body>"""


@pytest.mark.slow
def test_who_watches_sees_what_who_pulls_the_slider_sees(tmp_path: Path) -> None:
    """The way flown and the plumes; Meshcat plays every part by itself."""
    view = View()
    page = tmp_path / "replay.html"
    view.show([lqr_flight(episodes=1)])
    view.save(page)
    page.write_text(
        page.read_text().replace("</body>", PLAYED.replace("TIMES", "[2.5, 6.0, 20.1]"))
    )
    found = json.loads(
        html.unescape(re.findall('<pre id="found">(.*?)</pre>', browse(page), re.DOTALL)[-1])
    )
    for sought, played in found:
        assert sum(name.startswith("trail") for name in sought) > 5
        assert played == sought


LABELS = """<script>
viewer.animate = () => {};
function probe() {
  if (!viewer.animator.actions.length) return setTimeout(probe, 100);
  const sides = (x) => { const box = x.getBoundingClientRect();
    return [box.left, box.top, box.right, box.bottom]; };
  const found = TIMES.map(t => {
    rans.seek(t);
    return [...document.querySelectorAll("#rans-head h1, .rans-label, #rans-bar")].map(sides);
  });
  document.body.innerHTML = `<pre id="found">${JSON.stringify(found)}</pre>`;
}
probe();
</script></body>"""


@pytest.mark.slow
def test_no_label_hides_another(tmp_path: Path) -> None:
    """Nor the title, nor the bar: of seven craft in a window of 640 pixels, where their places would."""
    view = View()
    flight = lqr_flight(steps=20)
    planar = lqr_flight(load_spacecraft("floating-platform"), steps=20)
    view.show([flight, drifting(TRACKING), flight, planar])
    page = tmp_path / "many.html"
    view.save(page)
    text = page.read_text()
    for entry in (
        '["x","x axis"]',
        '["z","z axis"]',
        '["grid","lines 1 m apart"]',
    ):  # in space, in the plane
        assert entry in text
    page.write_text(text.replace("</body>", LABELS.replace("TIMES", "[0, 2, 4]")))
    for boxes in json.loads(re.findall('<pre id="found">(.*?)</pre>', browse(page), re.DOTALL)[-1]):
        assert len(boxes) == 2 + 7
        for (left, top, right, bottom), (x0, y0, x1, y1) in combinations(boxes, 2):
            assert left >= x1 or x0 >= right or top >= y1 or y0 >= bottom


def check_pictures(found: list[dict[str, Any]]) -> None:
    """The body is where the camera must see it: what is seen there changes as it comes and goes."""
    colours = np.array(
        [[colour_at(frame["picture"], other["pixel"]) for other in found] for frame in found]
    )
    for place in range(len(found)):
        for shown in {0, 1, 2} - {place}:
            assert np.abs(colours[shown, place] - colours[place, place]).max() > 20.0, colours


def colour_at(picture: str, pixel: tuple[float, float]) -> np.ndarray:
    image = Image.open(io.BytesIO(base64.b64decode(picture.partition(",")[2]))).convert("RGB")
    x, y = (round(share * size) for share, size in zip(pixel, image.size, strict=True))
    return np.asarray(image)[y - 1 : y + 2, x - 1 : x + 2].mean(axis=(0, 1))


@pytest.mark.slow
def test_several_flights_and_episodes_are_on_one_page(tmp_path: Path) -> None:
    """Flights of any tasks; the page is also served. Names are in the messages that build the scene."""
    view = View()
    flight = lqr_flight(steps=20)
    assert view.show([flight, drifting(TRACKING), flight]) == ["grey", "orange", "green"]
    view.save(tmp_path / "three.html")
    messages = re.findall(r'base64,([^"]*)"', (tmp_path / "three.html").read_text())
    text = b"".join(base64.b64decode(message) for message in messages)
    for path in (
        b"/flights/0 LQR/episode 1/craft",
        b"/flights/1 nobody/episode 0/target velocity",
        b"/flights/2 LQR/episode 1/goal",
        b"/flights/ground",
    ):
        assert path in text
    assert b"/flights/0 LQR/episode 0/velocity" not in text
    served = view.serve()
    for address, said in (("", b"MeshCat"), ("/version", b"1")):
        with urllib.request.urlopen(f"{served.url}{address}", timeout=PATIENCE) as answer:
            assert said in answer.read()
    served.renew()
    with urllib.request.urlopen(f"{served.url}/version", timeout=PATIENCE) as answer:
        assert answer.read() == b"2"


class Told:
    """What a page is told, as it is told."""

    def __init__(self, meshcat: Any) -> None:
        self.meshcat = meshcat
        self.places = {}
        self.colours = {}
        self.camera: Any = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.meshcat, name)

    def SetTransform(self, path: str, pose: Any) -> None:
        self.places[path] = pose.translation()

    def SetCameraPose(self, place: Any, target: Any) -> None:
        self.camera = place, target

    def SetObject(self, path: str, shape: Any, colour: Any) -> None:
        self.colours[path] = colour


@pytest.mark.slow
def test_every_episode_has_a_tile_of_its_own() -> None:
    """A row along x for every agent, the first farthest from the viewer, who stands at negative y."""
    view = View()
    flights = [lqr_flight(steps=20), drifting(TRACKING), lqr_flight(steps=20)]
    told = view._meshcat = Told(view._meshcat)  # type: ignore[assignment]
    colours = view.show(flights)
    names = [
        [f"/flights/{r} {flight.controller}/episode {k}" for k in range(flight.commands.shape[1])]
        for r, flight in enumerate(flights)
    ]
    rows = [np.array([told.places[name] for name in row]) for row in names]
    np.testing.assert_array_equal(rows[0][0], 0.0)
    first, second = rows[0]
    assert (first[0] < second[0], first[1], second[1]) == (True, 0.0, 0.0)
    assert 0.0 > rows[1][0, 1] > rows[2][0, 1] == 2.0 * rows[1][0, 1]
    # no way of one tile, with the craft's radius around it, comes into another
    boxes = []
    for flight, row in zip(flights, rows, strict=True):
        p = np.array(leaves(flight.states.p))[:2]
        boxes += [
            (
                p[:, :, k].min(axis=1) + tile[:2] - flight.craft.radius,
                p[:, :, k].max(axis=1) + tile[:2] + flight.craft.radius,
            )
            for k, tile in enumerate(row)
        ]
    for (low, high), (other_low, other_high) in combinations(boxes, 2):
        assert ((high < other_low) | (low > other_high)).any()
    for row, colour in zip(names, colours, strict=True):
        assert all(told.colours[f"{name}/craft/bus"] is BODIES[colour] for name in row)


@pytest.mark.slow
@pytest.mark.parametrize("episodes", [1, 4])
def test_the_camera_sees_whole_flights_however_many(episodes: int) -> None:
    """Meshcat's camera sees 40 degrees upright here, and 1.6 times as wide as high."""
    view = View()
    flight = lqr_flight(episodes=episodes, steps=25)
    told = view._meshcat = Told(view._meshcat)  # type: ignore[assignment]
    view.show([flight, flight])
    place, target = told.camera
    back = (place - target) / np.linalg.norm(place - target)
    right = np.cross([0.0, 0.0, 1.0], back) / np.hypot(*back[:2])
    tangent = np.tan(np.radians(20.0))
    edge = 0.0
    for row in range(2):
        for k in range(episodes):
            tile = told.places[f"/flights/{row} LQR/episode {k}"]
            way = np.array(leaves(flight.states.p))[:, :, k].T + tile - place
            depth = -way @ back
            x = way @ right / (1.6 * tangent * depth)
            y = way @ np.cross(back, right) / (tangent * depth)
            edge = max(edge, np.abs([x, y]).max())
    assert 0.3 < edge < 1.0  # near, and with room for what surrounds the centres


@pytest.mark.slow
def test_showing_again_replaces(tmp_path: Path) -> None:
    view = View()
    view.show([lqr_flight(steps=20)])
    view.show([drifting(TRACKING)])
    view.save(tmp_path / "page.html")
    messages = re.findall(r'base64,([^"]*)"', (tmp_path / "page.html").read_text())
    assert not any(b"LQR" in base64.b64decode(message) for message in messages)


def test_a_taken_port_is_a_sentence() -> None:
    with socket.create_server(("localhost", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"port {port} of this computer, it is taken"):
            View().serve(port)


def test_the_page_announces_itself_once(caplog: pytest.LogCaptureFixture) -> None:
    """The command names the page; Drake's own message would repeat it."""
    with caplog.at_level(logging.INFO):
        View()
    assert not caplog.records
