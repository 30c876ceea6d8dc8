"""The static page: what it knows of the robot, and that its trajectories are Python's."""

import copy
import functools
import http.server
import json
import math
import re
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from plat.errors import KeyframeError, StateError, StudioError
from plat.json_file import parse_json
from plat.keyframes import Keyframe, KeyframeSequence, standing
from plat.keyframes.files import read_keyframes, write_keyframes
from plat.keyframes.splits import unit_doubt
from plat.robots import G1
from plat.rotations_np import heading_pitch_roll, quat_from_heading_pitch_roll
from plat.spec.parts import Parts
from plat.spec.timing import Timing

pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")

import plat.studio.static
from plat.control import HOLD, Chase, Feasibility, KeyframeScorer, PolicyController, Simulator, lead_around
from plat.control.pose_errors import PoseComparison
from plat.runs import load_policy
from plat.studio.checker import Checker
from plat.studio.pins import chosen, mirrored_parts, preset, toggled
from plat.studio.player import Player, score
from plat.studio.poser import HANDLES, Poser
from plat.studio.poses import Floor, mirrored, placed
from plat.studio.static import LIBRARIES, site_facts, write_static
from plat.studio.templates import TEMPLATES, template
from plat.studio.timeline import Timeline
from tests.control.puppets import Kicking, Puppet
from tests.control.test_pose_errors import state
from tests.crossed import ABOVE, BELOW
from tests.studio.conftest import node_modules, squat

# Largest difference from Python that docs/studio.md promises (m, rad), for a motion of some seconds.
_NEAR = (1e-4, 5e-3)


@pytest.fixture(scope="module", autouse=True)
def _exported_once(tmp_path_factory) -> Iterator[None]:
    """The bundle of a policy is made once, which takes seconds, and copied for every further page."""
    export, made = plat.studio.static.export_bundle, dict[Path, Path]()

    def exported(run: Path, out: Path) -> None:
        if run not in made:
            made[run] = tmp_path_factory.mktemp("bundles") / "bundle"
            export(run, made[run])
        shutil.copytree(made[run], out)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plat.studio.static, "export_bundle", exported)
        yield


@pytest.fixture(scope="module")
def facts() -> dict:
    return json.loads(json.dumps(site_facts(G1, ("plat-g1", "nobody"), Timing())))


def test_the_description_is_the_robots_own(facts):
    model, own = mujoco.MjModel.from_xml_string(facts["xml"]), G1.shared_model
    assert (model.nq, model.nu, model.ngeom) == (own.nq, own.nu, own.ngeom)
    for name in ("body_mass", "body_inertia", "geom_size", "geom_friction", "jnt_range", "actuator_gainprm"):
        np.testing.assert_array_equal(getattr(model, name), getattr(own, name), err_msg=name)
    assert model.geom("floor").id == own.geom("floor").id, "contacts come in the same order"


def test_a_description_in_several_files_or_with_limits_read_otherwise_is_what_python_simulates(tmp_path):
    before, motors, after = re.split(r"(<actuator>.*</actuator>)", G1.asset_path.read_text(), flags=re.DOTALL)
    limited = motors.replace("<position ", "<position ctrlrange='-9 9' ", 1)
    (tmp_path / "motors.xml").write_text(f"<mujoco>{limited}</mujoco>")
    (tmp_path / "robot.xml").write_text(f'{before}<include file="motors.xml"/>{after}')
    robot = replace(G1, asset=str(tmp_path / "robot.xml"))
    model = mujoco.MjModel.from_xml_string(site_facts(robot, (), Timing())["xml"])
    assert (model.nu, model.actuator_ctrllimited.any()) == (29, False)
    assert model.geom("floor").id == G1.shared_model.geom("floor").id
    for name in ("body_mass", "jnt_range", "actuator_gainprm", "actuator_forcerange", "geom_size"):
        ours = getattr(G1.shared_model, name)
        np.testing.assert_allclose(getattr(model, name), ours, rtol=1e-5, atol=1e-7, err_msg=name)


@pytest.mark.parametrize("control_dt", [0.02, 1 / 60])
def test_the_page_simulates_a_whole_control_step(control_dt):
    """At 60 Hz it took three steps of the description's 5 ms: 15 ms of 17."""
    xml = site_facts(G1, (), Timing(control_dt=control_dt))["xml"]
    assert mujoco.MjModel.from_xml_string(xml).opt.timestep == pytest.approx(control_dt / 4)


def test_handles_and_soles_are_where_they_are_in_python(facts):
    data = mujoco.MjData(G1.shared_model)
    data.qpos[:] = facts["default_qpos"]
    mujoco.mj_kinematics(G1.shared_model, data)
    frames = Poser(G1).frames(G1.default_qpos)
    assert set(frames) == set(facts["handles"])
    for name in HANDLES:
        frame = frames[name]
        handle = facts["handles"][name]
        body = data.body(handle["body"])
        place = body.xpos + body.xmat.reshape(3, 3) @ np.array(handle["pos"])
        np.testing.assert_allclose(place, frame.pos, atol=1e-6, err_msg=name)
    assert [len(foot) for foot in facts["soles"]] == [4, 4]


def test_no_policy_is_called_otherwise_than_every_policy(facts):
    assert facts["nobody"] == "nobody else"


def test_a_folder_that_is_there_and_missing_libraries(tmp_path):
    with pytest.raises(StudioError, match="is there already"):
        write_static(tmp_path, G1, {}, Timing())
    with pytest.raises(StudioError, match="npm install @mujoco/mujoco@"):
        write_static(tmp_path / "page", G1, {}, Timing(), tmp_path / "node_modules")
    assert list(tmp_path.iterdir()) == [], "nothing half written stays"


def test_without_libraries_the_page_links_them(tmp_path):
    write_static(tmp_path / "page", G1, {}, Timing())
    page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    for name, (version, _) in LIBRARIES.items():
        assert f"{name}@{version}/" in page
    for name in ("studio.mjs", "dock.js", "site.json", "icon.svg"):
        assert (tmp_path / "page" / name).stat().st_size > 0


def test_libraries_keep_their_licenses(tmp_path):
    installed, copied = tmp_path / "node_modules", tmp_path / "page" / "libraries"
    for name, (version, files) in LIBRARIES.items():
        for file in (*files, "LICENSE", "README.md"):
            (installed / name / file).parent.mkdir(parents=True, exist_ok=True)
            (installed / name / file).touch()
        (installed / name / "package.json").write_text(json.dumps({"version": version}))
    write_static(tmp_path / "page", G1, {}, Timing(), installed)
    for name, (_, files) in LIBRARIES.items():
        found = {path.relative_to(copied / name).as_posix() for path in (copied / name).rglob("*") if path.is_file()}
        assert found == {*files, "LICENSE"}


def test_policies_of_all_names_are_written_and_nothing_beside_them(tmp_path, quick_exports):
    runs = {"a/plat": "plat-g1", "/b/plat": "imagined-g1", "..": "plat-g1", "#1 100%?": "plat-g1"}
    write_static(tmp_path / "page", G1, {name: Path(run) for name, run in runs.items()}, Timing())
    assert [path.name for path in tmp_path.iterdir()] == ["page"]
    bundles = sorted((tmp_path / "page" / "policies").rglob("bundle.json"))
    assert [path.parent.name for path in bundles] == ["0", "1", "2", "3"]
    assert len({path.with_name("policy.onnx").read_bytes() for path in bundles}) == 2
    assert json.loads((tmp_path / "page" / "site.json").read_text(encoding="utf-8"))["policies"] == list(runs)


@contextmanager
def _served(folder: Path) -> Iterator[str]:
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()


class Visitor:
    """Somebody with the static page open."""

    def __init__(self, page: Any, address: str):
        self.page = page
        page.set_default_timeout(60_000)
        page.goto(address)
        page.wait_for_function("window.platStudio !== undefined")

    def begin(self, name: str) -> None:
        """Begin with the keyframes of a template, the first of them selected."""
        self.page.evaluate(
            "async (name) => { const { Timeline, standing } = await import('./keyframes.mjs'), it = window.platStudio;"
            "it.stop(); it.edit(it.continued(name, new Timeline(it.site, standing(it.site))));"
            "Object.assign(it, { saved: it.timeline, name: `${name}.json`, past: [] }); it.show(); }",
            name,
        )
        self.page.evaluate("document.activeElement.blur()")

    def get(self, what: str) -> Any:
        return self.page.evaluate(f"window.platStudio.{what}")

    def until(self, what: str) -> None:
        self.page.wait_for_function(f"(() => {{ const studio = window.platStudio; return {what}; }})()")

    def pixel(self, point: str) -> np.ndarray:
        """Where an object of the scene, or a point on it, is on the screen."""
        return np.array(
            self.page.evaluate(
                f"(() => {{ const {{ scene }} = window.platStudio, place = {point}.project(scene.camera);"
                "const box = scene.renderer.domElement.getBoundingClientRect();"
                "return [box.left + (0.5 + place.x / 2) * box.width, box.top + (0.5 - place.y / 2) * box.height]; })()"
            )
        )

    def drag(self, begin: np.ndarray, end: np.ndarray) -> None:
        mouse = self.page.mouse
        mouse.move(*begin)
        self.page.wait_for_timeout(100)
        mouse.down()
        for share in np.linspace(0, 1, 5):
            mouse.move(*(begin + share * (end - begin)))
            self.page.wait_for_timeout(50)
        mouse.up()


@pytest.fixture(scope="module")
def visitor(browser, address) -> Iterator[Visitor]:
    page = browser.new_page(viewport={"width": 1000, "height": 560}, color_scheme="dark")
    yield Visitor(page, address)
    page.close()


@pytest.fixture
def page(browser) -> Iterator[Any]:
    """A page without an address yet."""
    page = browser.new_page(viewport={"width": 1000, "height": 560})
    page.set_default_timeout(180_000)
    yield page
    page.close()


@pytest.mark.slow
def test_libraries_that_do_not_arrive_are_named(page, tmp_path):
    write_static(tmp_path / "page", G1, {}, Timing())
    with _served(tmp_path / "page") as address:
        page.route("**/*", lambda route: route.continue_() if "127.0.0.1" in route.request.url else route.abort())
        page.goto(address)
        page.get_by_text("One of its libraries did not arrive.").wait_for()


def _libraries() -> Path:
    found = node_modules()
    for name, (version, _) in LIBRARIES.items():
        package = found / name / "package.json"
        if not package.exists() or json.loads(package.read_text(encoding="utf-8"))["version"] != version:
            pytest.skip(f"{name} {version} is not in {found}: npm install it, and name the folder in PLAT_NODE_MODULES")
    return found


@pytest.fixture(scope="module")
def address(tmp_path_factory, quick_exports) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("static") / "page"
    write_static(folder, G1, {"plat": Path("plat-g1"), "imagined": Path("imagined-g1")}, Timing(), _libraries())
    with _served(folder) as address:
        yield address


@pytest.mark.slow
@pytest.mark.parametrize("handle", ["right hand", "left foot", "pelvis", "whole robot"])
def test_balls_are_dragged(visitor, handle):
    visitor.begin("bow")
    qpos = np.array(visitor.get("timeline.pose.qpos"))
    ball = f"scene.balls['{handle}'].getWorldPosition(scene.camera.position.clone())"
    begin = visitor.pixel(ball)
    away = np.array([0.0, 15.0]) if handle == "pelvis" else np.array([20.0, -15.0])
    visitor.drag(begin, begin + away)
    visitor.until("studio.grip === null && studio.past.length > 0")
    np.testing.assert_allclose(visitor.pixel(ball) - begin, away, atol=4)
    change = np.array(visitor.get("timeline.pose.qpos")) - qpos
    assert np.abs(change[7:]).max() < 1e-9 if handle == "whole robot" else np.abs(change[7:]).max() > 0.01
    visitor.page.keyboard.press("Control+z")
    visitor.until("studio.past.length === 0")
    np.testing.assert_allclose(visitor.get("timeline.pose.qpos"), qpos)


@pytest.mark.slow
def test_a_joint_is_turned_by_its_ring(visitor):
    visitor.begin("bow")
    qpos, joint = np.array(visitor.get("timeline.pose.qpos")), G1.joint_names.index("left_knee")
    visitor.page.evaluate("window.platStudio.clickBody(window.platStudio.robot.bodies.left_knee_link)")
    visitor.page.wait_for_timeout(500)  # the ring is drawn
    around = (
        "(() => {{ const {{ axle, ring, camera }} = scene, out = camera.position.clone();"
        "const size = 0.5 * ring.size * out.distanceTo(axle.getWorldPosition(out.clone()))"
        " * Math.min(1.9 * Math.tan(Math.PI * camera.fov / 360), 7) / 4;"
        "return axle.localToWorld(out.set(Math.cos({0}), Math.sin({0}), 0).multiplyScalar(size)); }})()"
    )
    begin, end = (visitor.pixel(around.format(turn)) for turn in (0.6, 1.0))
    visitor.drag(begin, end)
    visitor.until("studio.gesture === null && studio.past.length > 0")
    change = np.array(visitor.get("timeline.pose.qpos")) - qpos
    assert 0.1 < abs(change[7 + joint]) < 0.9
    assert np.count_nonzero(np.abs(change) > 1e-9) == 1, "nothing else moves"


@pytest.mark.slow
def test_keyframes_are_timed_played_scored_saved_and_loaded(visitor, tmp_path):
    page = visitor.page
    visitor.begin("bow")
    page.keyboard.press("End")
    page.get_by_label("Held (s)").fill("0.2")
    page.keyboard.press("Enter")
    visitor.until("studio.timeline.holds[1] === 0.2")
    page.keyboard.press("Space")
    page.locator('#dock [data-key="1"][data-status="reached"]').wait_for()
    with page.expect_download() as saved:
        page.keyboard.press("Control+s")
    assert saved.value.suggested_filename == "bow.json"
    saved.value.save_as(tmp_path / "saved.json")
    _, frames = read_keyframes(tmp_path / "saved.json", G1)
    assert [frame.time for frame in frames] == [0.8, 1.4, 2.2, 2.4]
    visitor.begin("wave")
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Load").click()
    chooser.value.set_files(tmp_path / "saved.json")
    visitor.until("studio.timeline.keyframes.length === 2 && studio.timeline.holds[1] === 0.2")
    with page.expect_download() as again:
        page.keyboard.press("Control+s")
    assert again.value.suggested_filename == "saved.json"
    assert page.evaluate("window.platStudio.scene.scene.background.getHex()") < 0x404040, "it is dark, as the system is"


def _drop_file(visitor: Visitor, content: bytes, name: str) -> None:
    visitor.page.evaluate(
        "([bytes, name]) => { const it = window.platStudio;"
        "it.guarded(() => it.load(new Uint8Array(bytes).buffer, name)); }",
        [list(content), name],
    )


def _joints(content: dict) -> dict:
    return content["keyframes"][0]["joint_pos"]


def _drop(entry: dict, field: str) -> None:
    del entry[field]


# What is wrong with a keyframe file, by a word that the message must have: how it is made.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ('{"a": "#,]", // mine\n"b": 1}', "; JSON has no comments)"),
        ('{"a": "#//",\n}', "; JSON has no comma before a closing bracket)"),
        ('{"a": "#,]" "b": 1}', ""),
    ],
)
def test_what_json_has_not_is_told_as_in_python(visitor, text, advice):
    with pytest.raises(KeyframeError) as raised:
        parse_json(text.encode(), KeyframeError, "file")
    found = visitor.page.evaluate(
        "async (text) => { const { read } = await import('./keyframes.mjs');"
        "try { read(text, window.platStudio.site); } catch (error) { return error.message; } }",
        text,
    )
    assert found.startswith("not a readable JSON file (")
    for message in (found, str(raised.value)):
        told = "JSON has no" in message or "trailing comma" in message  # as Python 3.13 says by itself
        assert told == bool(advice)
    assert found.endswith(advice)


_FAULTS: dict[str, list[Callable[[dict], object]]] = {
    "JSON": [lambda content: '{"format": "plat-key'],
    "format": [lambda content: "[]", lambda content: content.update(format="bvh")],
    "version": [lambda content: content.update(version=3), lambda content: _drop(content, "version")],
    "comes twice in one object": [
        lambda content: json.dumps(content).replace('"time": ', '"time": 0.1, "time": ', 1),
        lambda content: json.dumps(content).replace('"robot": ', '"r\\u006fbot": "g1", "robot": '),
    ],
    "are one joint": [lambda content: _joints(content).update(left_knee_joint=0.1)],
    "surrogate": [
        lambda content: content["keyframes"][0].update(name="\ud83d"),
        lambda content: content["keyframes"][0].update({"\ude00": 1}),
    ],
    "nested too deeply": [lambda content: "[" * 100_000 + "]" * 100_000],
    "robot": [lambda content: content.update(robot="h1"), lambda content: _drop(content, "robot")],
    "quaternion_order": [lambda content: content.update(quaternion_order="zyxw")],
    "keyframes": [lambda content: content.update(keyframes=[]), lambda content: content.update(keyframes={})],
    "unknown field": [
        lambda content: content.update(author="me"),
        lambda content: content["start"].update(time=0.0),
        lambda content: content["keyframes"][0].update(speed=1.0),
        lambda content: content["start"].update(commands={"root": ["height"]}),
    ],
    "commands is a field of version 2, and version is 1": [
        lambda content: content.update(version=1) or content["keyframes"][0].update(commands={"root": ["height"]}),
    ],
    "expected an object": [lambda content: content["keyframes"].insert(0, 3)],
    "name": [lambda content: content["keyframes"][0].update(name=3)],
    "root_pos": [
        lambda content: content["keyframes"][0].update(root_pos=[0.0, 0.0]),
        lambda content: content["keyframes"][0].update(root_pos=[0.0, 0.0, 76.0]),
        lambda content: content["keyframes"][0].update(root_pos=[0.0, -1e9, 0.76]),
        lambda content: _drop(content["start"], "root_pos"),
    ],
    "root_quat": [
        lambda content: content["keyframes"][0].update(root_quat=[2.0, 0.0, 0.0, 0.0]),
        lambda content: content["keyframes"][0].update(root_quat=["1", 0.0, 0.0, 0.0]),
    ],
    "joint_pos": [
        lambda content: content["keyframes"][0].update(joint_pos=[0.0] * 29),
        lambda content: _drop(_joints(content), "left_knee"),
        lambda content: _joints(content).update(tail=0.0),
        lambda content: _joints(content).update(left_knee=9.0),
        lambda content: _joints(content).update(left_knee=None),
    ],
    "time": [
        lambda content: content["keyframes"][0].update(time="soon"),
        lambda content: content["keyframes"][0].update(time=0.0),
        lambda content: content["keyframes"][1].update(time=0.1),
        lambda content: content["keyframes"][-1].update(time=1e6),
        lambda content: _drop(content["keyframes"][0], "time"),
    ],
    "time is nan, expected a finite number": [
        lambda content: content["keyframes"][0].update(time=math.nan, name='NaN "Infinity'),
    ],
    "root_pos[2] is -inf, expected a finite number": [
        lambda content: content["keyframes"][0].update(root_pos=[0.0, 0.0, -math.inf]),
    ],
    "joint_pos: 'left_knee' is inf, expected a finite number": [
        lambda content: _joints(content).update(left_knee=math.inf)
    ],
    "commands": [
        lambda content: content["keyframes"][0].update(commands=3),
        lambda content: content["keyframes"][0].update(commands={"hands": []}),
        lambda content: content["keyframes"][0].update(commands={"bodies": "all"}),
        lambda content: content["keyframes"][0].update(commands={"bodies": ["nose"]}),
        lambda content: content["keyframes"][0].update(commands={"root": []}),
    ],
}


@pytest.mark.slow
def test_doubts_about_units_are_pythons(visitor, tmp_path):
    frames = (standing(G1).at(0.5), standing(G1).at(0.9))
    write_keyframes(tmp_path / "stand.json", G1, standing(G1), frames)
    stand = json.loads((tmp_path / "stand.json").read_text(encoding="utf-8"))
    changes: list[Callable[[dict], object]] = [
        lambda first: _joints(stand).update(left_knee=45.0),
        lambda first: _joints(stand).update(left_knee=4.5, left_elbow=-1.94159265),
        lambda first: first.update(time=1e9),
        lambda first: first.update(time=123456.7),
        lambda first: first.update(root_pos=[0.0, 0.0, 793.25]),
        lambda first: first.update(root_pos=[0.0, -12345678.9, 0.8]),
    ]
    texts, expected, path = [], [], tmp_path / "keyframes.json"
    original = copy.deepcopy(stand)
    for change in changes:
        stand = copy.deepcopy(original)
        change(stand["keyframes"][0])
        path.write_text(json.dumps(stand), encoding="utf-8")
        with pytest.raises(KeyframeError) as raised:
            read_keyframes(path, G1)
        texts.append(path.read_text(encoding="utf-8"))
        expected.append(str(raised.value).removeprefix(f"keyframe file {str(path)!r}: "))
    assert ["degrees?" in message for message in expected] == [True, False, False, False, False, False]
    said = visitor.page.evaluate(
        "async (texts) => { const { read } = await import('./keyframes.mjs'), { site } = window.platStudio;"
        "return texts.map((text) => { try { read(text, site); } catch (error) { return error.message; } }); }",
        texts,
    )
    assert said == expected
    content = copy.deepcopy(original)
    for frame, time in zip(content["keyframes"], (500, 900), strict=True):
        frame["time"] = time
    _drop_file(visitor, json.dumps(content).encode(), "ms.json")
    told = f"ms.json: 2 keyframes; {unit_doubt([frame.at(1000 * frame.time) for frame in frames])}"
    assert visitor.get("notes.at(-1).text") == told


@pytest.mark.slow
def test_files_that_python_refuses_are_refused(visitor, tmp_path):
    timeline = template("bow", Timeline.empty(G1), Poser(G1))
    write_keyframes(tmp_path / "bow.json", G1, timeline.start, timeline.to_keyframes())
    bow = json.loads((tmp_path / "bow.json").read_text(encoding="utf-8"))
    texts, words = [], []
    for word, changes in _FAULTS.items():
        for change in changes:
            content = copy.deepcopy({**bow, "version": 2})
            changed = change(content)
            texts.append(changed if isinstance(changed, str) else json.dumps(content))
            words.append(word)
    path = tmp_path / "keyframes.json"
    for text, word in zip(texts, words, strict=True):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(KeyframeError, match=re.escape(word)):
            Timeline.of(*_read(path), G1, Timing())
    said = visitor.page.evaluate(
        "async (texts) => { const { read } = await import('./keyframes.mjs'), { site } = window.platStudio;"
        "const said = (text) => { try { read(text, site); return 'read'; } catch (error) { return error.message; } };"
        "return texts.map(said); }",
        texts,
    )
    assert [word for word, message in zip(words, said, strict=True) if word not in message] == [], said
    bow["keyframes"][0]["commands"] = {"joints": ["left_knee_joint"]}
    commands = visitor.page.evaluate(
        "async (text) => { const { read } = await import('./keyframes.mjs');"
        "return JSON.stringify(read(text, window.platStudio.site)); }",
        json.dumps({**bow, "version": 2}),
    )
    assert '"commands":{"joints":["left_knee"]}' in commands


@pytest.mark.slow
def test_files_are_decoded_as_in_python(visitor, tmp_path):
    path, stand = tmp_path / "stand.json", standing(G1)
    write_keyframes(path, G1, stand, (replace(stand.at(0.5), name="größer"),))
    text = json.dumps(json.loads(path.read_text(encoding="utf-8")), ensure_ascii=False)
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"):
        path.write_bytes(text.encode(encoding))
        assert read_keyframes(path, G1)[1][0].name == "größer"
        visitor.begin("bow")
        _drop_file(visitor, path.read_bytes(), "stand.json")
        assert visitor.get("timeline.labels") == ["start", "1 größer"], encoding
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(KeyframeError, match="no UTF-8"):
        read_keyframes(path, G1)
    _drop_file(visitor, path.read_bytes(), "stand.json")
    assert visitor.get("notes.at(-1).text") == "stand.json: not a readable JSON file (its bytes are no UTF-8)"


def _read(path: Path) -> tuple[Keyframe, tuple[Keyframe, ...]]:
    start, keyframes = read_keyframes(path, G1)
    return start or standing(G1), keyframes


@pytest.mark.slow
def test_the_pelvis_is_put_by_numbers_and_policies_compared(visitor):
    page = visitor.page
    visitor.begin("bow")
    qpos = np.array(visitor.get("timeline.pose.qpos"))
    page.get_by_label("heading", exact=True).fill("90")
    page.keyboard.press("Enter")
    visitor.until("studio.past.length === 1")
    turned = np.array(visitor.get("timeline.pose.qpos"))
    np.testing.assert_allclose(turned[[0, 1, 2]], qpos[[0, 1, 2]], atol=1e-9)
    np.testing.assert_allclose(np.degrees(heading_pitch_roll(turned[3:7]))[0], 90.0, atol=0.1)
    page.keyboard.press("Control+z")
    visitor.until("studio.past.length === 0")
    page.get_by_role("button", name="Compare all policies").click()
    visitor.until("Object.keys(studio.scores).length === 2 && !studio.busy.length")
    assert page.locator("aside table").count() == 2


def _leaning() -> np.ndarray:
    """The default pose somewhere else, turned, leaning both ways, with the left elbow bent."""
    qpos = G1.default_qpos.copy()
    qpos[:3] = 1.0, 2.0, 0.7
    qpos[3:7] = quat_from_heading_pitch_roll(np.array([1.2, 0.3, 0.2]))
    qpos[7 + G1.joint_names.index("left_elbow")] = 0.9
    return qpos


@pytest.mark.slow
@pytest.mark.parametrize("name", TEMPLATES)
def test_templates_continue_the_selected_pose_as_in_python(visitor, name):
    base = _leaning()
    base[3:7] = quat_from_heading_pitch_roll(np.array([1.2, 0.0, 0.0]))
    base[2] = 0.76
    expected = template(name, Timeline.empty(G1).inserted(base, 1.0), Poser(G1))
    found = visitor.page.evaluate(
        "async ([name, qpos]) => { const { Timeline, standing } = await import('./keyframes.mjs');"
        "const it = window.platStudio, begin = new Timeline(it.site, standing(it.site));"
        "const made = it.continued(name, begin.inserted({ ...standing(it.site), qpos }, 1.0));"
        "return { keyframes: made.keyframes, holds: made.holds, selected: made.selected }; }",
        [name, base.tolist()],
    )
    assert found["selected"] == expected.selected == 2
    assert found["holds"] == list(expected.holds)
    for frame, own in zip(found["keyframes"], expected.keyframes, strict=True):
        assert (frame["name"], frame["time"]) == (own.name, own.time)
        np.testing.assert_allclose(frame["qpos"][:7], own.qpos[:7], atol=2e-3, err_msg=own.name or "")
        np.testing.assert_allclose(frame["qpos"][7:], own.qpos[7:], atol=2e-2, err_msg=own.name or "")


@pytest.mark.slow
def test_a_leaning_pose_stands_and_is_mirrored_as_in_python(visitor):
    commands = {"joints": ["left_elbow", "waist_pitch"], "bodies": ["left_wrist_yaw_link"], "root": ["height"]}
    found = visitor.page.evaluate(
        "([qpos, commands]) => { const it = window.platStudio, result = {};"
        "const own = it.timeline.select(1), past = it.past.length;"
        "for (const name of ['stand', 'mirror']) {"
        "  it.timeline = own.withPose({ ...own.pose, qpos, commands }); it.actions[name]();"
        "  result[name] = it.timeline.pose; }"
        "return { ...result, steps: it.past.length - past }; }",
        [_leaning().tolist(), commands],
    )
    assert found["steps"] == 2, "each is one step to undo"
    standing_there = placed(G1.default_qpos, G1.default_qpos, _leaning())
    np.testing.assert_allclose(found["stand"]["qpos"], standing_there, atol=1e-6)
    np.testing.assert_allclose(found["mirror"]["qpos"], mirrored(_leaning(), G1), atol=1e-6)
    expected = mirrored_parts(Parts.only(G1, **commands), G1)
    assert Parts.only(G1, **found["mirror"]["commands"]) == expected
    assert found["stand"]["commands"] == commands


@pytest.mark.slow
def test_numbers_in_several_boxes_and_edits_with_a_pause_are_undone_apart(visitor):
    page = visitor.page
    visitor.begin("bow")
    for steps, (label, value) in enumerate((("x", "0.1"), ("y", "0.2"), ("heading", "30")), 1):
        page.get_by_label(label, exact=True).fill(value)
        page.keyboard.press("Enter")
        visitor.until(f"studio.past.length === {steps}")
    page.keyboard.press("Control+z")
    visitor.until("studio.past.length === 2")
    np.testing.assert_allclose(visitor.get("timeline.pose.qpos.slice(0, 2)"), [0.1, 0.2], atol=1e-3)
    steps = page.evaluate(
        "() => { const it = window.platStudio, nudge = () => it.receive({ do: 'nudge', value: 1 });"
        "const later = window.setTimeout, steps = [], did = () => steps.push(it.past.length);"
        "nudge(); nudge(); did(); window.setTimeout = (work) => { work(); };"  # as after a pause
        "nudge(); nudge(); did(); const drag = (time) => it.receive({ do: 'retime', number: 1, time });"
        "it.receive({ do: 'drag' }); drag(0.5); drag(0.6); it.receive({ do: 'end' }); did(); nudge(); nudge(); did();"
        "const press = (name) => it.at.slider.dispatchEvent(new PointerEvent(name));"
        "press('pointerdown'); it.setJoint(0.1); it.setJoint(0.2); press('pointerup'); did();"
        "window.setTimeout = later; return steps; }"
    )
    assert steps == [3, 4, 5, 7, 8]


@pytest.mark.slow
def test_lists_and_buttons_of_the_panel_are_used_with_the_keyboard(visitor):
    page = visitor.page
    visitor.begin("bow")
    for element in (page.get_by_label("template"), page.get_by_role("button", name="Standing")):
        element.focus()
        page.keyboard.press("Tab")
        page.keyboard.press("Shift+Tab")
        for _ in range(2):
            page.keyboard.press("ArrowDown" if element.get_attribute("aria-label") else "Space")
        assert element.evaluate("(element) => element === document.activeElement")
    assert page.get_by_label("template").input_value() == list(TEMPLATES)[2]
    visitor.until("studio.past.length === 2")
    assert (visitor.get("players.length"), visitor.get("timeline.selected")) == (0, 1)
    page.get_by_label("template").click()
    page.get_by_label("template").select_option("wave")
    assert page.evaluate("document.activeElement === document.body"), "the keys are the studio's again"


@pytest.mark.slow
def test_a_file_is_dropped_onto_the_page(visitor, tmp_path):
    write_keyframes(tmp_path / "stand.json", G1, standing(G1), (replace(standing(G1).at(0.5), name="dropped"),))
    visitor.begin("bow")
    left = visitor.page.evaluate(
        "(text) => { const dataTransfer = new DataTransfer(); dataTransfer.items.add(new File([text], 'stand.json'));"
        "return ['dragover', 'drop'].map((kind) => document.querySelector('#root canvas').dispatchEvent("
        "new DragEvent(kind, { dataTransfer, bubbles: true, cancelable: true }))); }",
        (tmp_path / "stand.json").read_text(encoding="utf-8"),
    )
    assert left == [False, False], "the browser does not leave for the file"
    visitor.until("studio.timeline.labels[1] === '1 dropped'")


@pytest.mark.slow
def test_a_name_is_cut_between_characters(visitor):
    visitor.begin("bow")
    visitor.page.evaluate("window.platStudio.receive({ do: 'rename', value: 'x'.repeat(59) + '🤖🤖' })")
    assert visitor.get("timeline.pose.name") == "x" * 59 + "🤖"
    visitor.page.evaluate("window.platStudio.receive({ do: 'rename', value: '🤖'.repeat(20) })")
    visitor.page.locator('#dock [data-key="1"] text', has_text="1 " + "🤖" * 11 + "…").wait_for()


@pytest.mark.slow
def test_the_lowest_point_comes_onto_the_floor_as_in_python(visitor):
    rng, poses = np.random.default_rng(0), []
    for _ in range(5):
        quat = rng.normal(size=4)
        joints = rng.uniform(*G1.joint_range.double().numpy().T)
        poses.append(np.concatenate(([1.0, 2.0, rng.uniform(-1, 2)], quat / np.linalg.norm(quat), joints)))
    found = visitor.page.evaluate(
        "(poses) => poses.map((qpos) => window.platStudio.robot.dropped(qpos))", [pose.tolist() for pose in poses]
    )
    np.testing.assert_allclose(found, [Floor(G1).dropped(pose) for pose in poses], atol=1e-6)


@pytest.mark.slow
def test_a_start_deep_in_the_floor_is_refused_as_in_python(visitor):
    low = Keyframe.from_qpos(0.0, G1.default_qpos - 0.5 * np.eye(36)[2])
    with pytest.raises(StateError, match="^start: ") as raised:
        Chase(Puppet(), KeyframeSequence(G1, low, (low.at(1.0),)), Simulator(G1.shared_model))
    visitor.begin("bow")
    visitor.page.evaluate(
        "(qpos) => { const it = window.platStudio; it.select(0); it.edit(it.timeline.posed(qpos));"
        "it.show(); window.platChannel.send({ do: 'toggle' }); }",
        low.qpos.tolist(),
    )
    assert visitor.get("notes.at(-1).text") == str(raised.value)
    assert visitor.get("players.length") == 0
    words = visitor.page.locator("#dock .words").inner_text()
    assert [words] == list(Checker(G1).start(low).words) == ["the robot is 50 cm inside the floor"]
    assert "▲!" in visitor.page.locator("#key-0").text_content()


@pytest.mark.slow
def test_a_policy_of_whole_poses_names_the_keyframe_that_it_refuses(visitor):
    visitor.begin("bow")
    visitor.page.evaluate("window.platStudio.pin('left hand'); window.platChannel.send({ do: 'toggle' })")
    assert visitor.get("notes.at(-1).text").startswith("the keyframe at 0.8 s ('bow') commands a part of its pose, but")


@pytest.mark.slow
def test_a_root_that_no_file_may_hold_is_refused_in_the_box(visitor):
    page = visitor.page
    visitor.begin("bow")
    height = visitor.get("timeline.pose.qpos[2]")
    page.get_by_label("z", exact=True).fill("76")
    page.keyboard.press("Enter")
    page.get_by_text("puts the root at a height of 76").wait_for()
    assert visitor.get("timeline.pose.qpos[2]") == height
    assert visitor.get("past.length") == 0
    assert page.get_by_label("z", exact=True).input_value() == f"{height:.3f}"


@pytest.mark.slow
def test_a_drag_to_where_no_robot_can_be_is_refused_once(visitor):
    visitor.begin("bow")
    told = visitor.page.evaluate(
        "() => { const it = window.platStudio, told = []; it.note = (title, text) => told.push(text);"
        "it.handle = 'whole robot'; it.grab();"
        "for (const z of [6, 7, 0, 8]) it.drag({ pos: [0.5, 0, z], quat: [1, 0, 0, 0] });"
        "it.grip = null; delete it.note; return told; }"
    )
    assert len(told) == 1
    assert "at a height of" in told[0]
    np.testing.assert_allclose(visitor.get("timeline.pose.qpos")[0], 0.5, atol=0.2)


@pytest.mark.slow
def test_a_keyframe_that_is_cut_and_pasted_keeps_its_hold(visitor):
    visitor.begin("bow")
    for do in ("cut", "last", "paste"):
        visitor.page.evaluate("what => window.platStudio.receive({ do: what })", do)
    assert visitor.get("timeline.labels") == ["start", "1 rise", "2 bow"]
    assert visitor.get("timeline.holds") == [0, 0.6]


@pytest.mark.slow
def test_keyframes_are_added_where_the_timeline_is_clicked_twice(visitor):
    visitor.begin("bow")  # at 0.8 s, held until 1.4 s, and at 2.2 s
    for time, times, selected in (
        (3.0, [0.8, 2.2, 3.0], 3),
        (1.0, [0.8, 2.2, 3.0], 1),
        (0.4, [0.4, 0.8, 2.2, 3.0], 1),
    ):
        visitor.page.evaluate("time => window.platStudio.receive({ do: 'add', time })", time)
        found = visitor.get("timeline.keyframes.map((frame) => frame.time)")
        assert (found, visitor.get("timeline.selected")) == (pytest.approx(times), selected)
    assert visitor.get("past.length") == 2
    assert visitor.get("timeline.labels") == ["start", "1", "2 bow", "3 rise", "4"]
    visitor.page.evaluate("window.platStudio.receive({ do: 'select', number: 3 }); window.platStudio.pin('left hand')")
    for time, bodies in ((1.8, ["left_wrist_yaw_link"]), (0.2, None)):  # of what the next one commands
        visitor.page.evaluate("time => window.platStudio.receive({ do: 'add', time })", time)
        assert visitor.get("timeline.pose.commands?.bodies ?? null") == bodies
    for name, kept in (("up (hold)", "up"), ("(hold) (hold)", None), (" on ", "on")):
        assert visitor.get(f"timeline.renamed({name!r}).pose.name") == kept, (
            "as in Python: only ends of holds are so named"
        )


@pytest.mark.slow
def test_keyframes_are_kept_while_they_are_edited_and_when_the_page_is_left(page, address):
    visitor = Visitor(page, address)
    kept = page.evaluate(
        "async () => { const it = window.platStudio; for (let count = 0; count < 20; count++) {"
        "  it.setJoint(0.01 * count); await new Promise((done) => setTimeout(done, 100)); }"
        "return localStorage.getItem('plat-keyframes'); }"
    )
    assert kept, "after a second, although the edits went on"
    visitor.begin("squat")
    visitor.get("setJoint(0.1)")
    page.reload()
    page.wait_for_function("window.platStudio !== undefined")
    assert visitor.get("timeline.labels") == ["start", "1 down", "2 up"]
    assert visitor.get("unsaved"), "no file holds them"
    visitor.get("name = 'squat.json'")
    visitor.get("save()")
    page.reload()
    page.wait_for_function("window.platStudio !== undefined")
    assert (visitor.get("unsaved"), visitor.get("name")) == (False, "squat.json")


@pytest.mark.slow
def test_two_tabs_each_keep_their_own_keyframes(browser, address):
    context = browser.new_context(viewport={"width": 1000, "height": 560})

    def labels(page: Any) -> list[str]:
        page.wait_for_function("window.platStudio !== undefined")
        return page.evaluate("window.platStudio.timeline.labels")

    drawn = Visitor(context.new_page(), address)
    drawn.begin("squat")
    drawn.get("keep()")
    drawn.page.close()
    again = context.new_page()  # a later visit, in which nothing is edited
    again.goto(address)
    assert labels(again) == ["start", "1 down", "2 up"]
    edited = {name: Visitor(context.new_page(), address) for name in ("bow", "weight")}
    for visitor, name in zip(edited.values(), ("bow", "side step"), strict=True):
        visitor.begin(name)
    for page, name in ((edited["bow"].page, "bow"), (edited["weight"].page, "weight"), (again, "down")):
        page.reload()
        assert labels(page)[1] == f"1 {name}"
    assert Visitor(context.new_page(), address).get("timeline.labels")[1] == "1 weight", "the last that was edited"
    context.close()


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1024, 700), (390, 844), (844, 390)])
def test_the_scene_and_the_help_are_there_in_windows_of_all_sizes(visitor, width, height):
    page = visitor.page
    before = page.viewport_size
    page.set_viewport_size({"width": width, "height": height})
    try:
        scene, bar = page.locator("#root .view").bounding_box(), page.locator("#dock .bar")
        assert scene["width"] >= 300, "the panel does not cover it"
        assert scene["height"] >= 150
        assert page.get_by_label("Help: all keys").evaluate(
            "help => { const box = help.getBoundingClientRect();"
            "return document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2) === help; }"
        )
        assert width < 1000 or bar.evaluate("bar => bar.scrollWidth <= bar.clientWidth")
    finally:
        page.set_viewport_size(before)


@pytest.mark.slow
def test_a_keyframe_is_copied_after_its_name_was_marked_and_left(visitor):
    page = visitor.page
    visitor.begin("bow")
    page.evaluate("window.platStudio.clipboard = null")
    name = page.get_by_label("Name", exact=True)
    name.click()
    page.keyboard.press("Control+a")
    page.keyboard.press("Enter")
    page.keyboard.press("Control+c")
    visitor.until("studio.clipboard?.pose.name === 'bow'")


@pytest.mark.slow
def test_pins_change_nothing_else_and_choices_are_exact(visitor):
    visitor.begin("bow")
    hands = ["left_wrist_yaw_link", "right_wrist_yaw_link"]
    for commands, handle, shown in (
        ({"joints": ["left_elbow"]}, "left hand", "what is pinned"),
        ({"bodies": hands, "joints": ["waist_pitch"]}, "chest", "what is pinned"),
        ({"bodies": hands, "root": ["height"]}, "head", "what is pinned"),
        ({"root": ["height"]}, "pelvis", "what is pinned"),
        ({"root": ["height"]}, "left hand", "what is pinned"),
        ({"bodies": hands}, "whole robot", "hands"),
        ({"bodies": hands}, "left hand", "hands"),
        ({"root": ["horizontal", "height", "orientation"]}, "pelvis", "place"),
        (None, "right foot", "whole pose"),
    ):
        found = visitor.page.evaluate(
            "([commands, handle]) => { const it = window.platStudio;"
            "it.edit(it.timeline.commanding(commands)); it.show();"
            "const shown = it.at.commands.value; it.pin(handle); return [shown, it.timeline.pose.commands]; }",
            [commands, handle],
        )
        frame = replace(standing(G1).at(1.0), commands=commands and Parts.only(G1, **commands))
        expected = toggled(frame, handle, G1)
        assert found[0] == shown == (chosen(frame, G1) or "what is pinned"), commands
        assert (found[1] and Parts.only(G1, **found[1])) == expected, (commands, handle)


@pytest.mark.slow
def test_doubts_are_pythons(visitor):
    feasibility, stand, joints = Feasibility(G1), standing(G1), G1.joint_names
    names = ("far", "folded", "sunk", "buried", "floating", "tipping", "turned", "turning", "high")
    poses = {name: G1.default_qpos.copy() for name in names}
    poses["far"][0] += 3
    poses["folded"][7 + joints.index("left_shoulder_roll")] = -1.2
    poses["sunk"][2] -= 0.2
    poses["floating"][2] += 0.2
    poses["high"][2] += 3.0
    poses["tipping"][7 + joints.index("waist_pitch")] = 0.5
    poses["tipping"][[7 + joints.index(f"{side}_hip_pitch") for side in ("left", "right")]] = -1.5
    poses["turned"][3:7] = [0.0, 0.0, 0.0, 1.0]
    poses["turning"][3:7] = [np.cos(0.751), 0.0, 0.0, np.sin(0.751)]  # 6.008 rad/s, of 6
    poses["buried"][2] = -0.2
    poses |= {"above": ABOVE.qpos, "below": BELOW.qpos}
    circle = KeyframeSequence.load(Path(__file__).parents[2] / "recipes" / "examples" / "hands.json", G1).keyframes
    poses |= {f"circle {number}": circle[number].qpos for number in (3, 4)}
    checker, said = Checker(G1), []
    arms = Parts.only(G1, joints=[name for name in joints if "left" in name or "waist" in name])
    for name, qpos in poses.items():
        before, held = ABOVE.at(0.0) if name == "below" else stand, name != "high"
        for parts in (None, preset("hands", G1), arms, Parts.only(G1, root=["height"])):
            frame = replace(Keyframe.from_qpos(0.5, qpos), commands=parts)
            words = [concern.words for concern in feasibility(before, frame, held=held)]
            commands = parts and parts.names(G1)
            found = visitor.page.evaluate(
                "async ([before, qpos, commands, held]) => (await import('./feasibility.mjs'))"
                ".verdict(window.platStudio.robot, { qpos: before }, { qpos, commands }, 0.5, held)",
                [before.qpos.tolist(), qpos.tolist(), commands, held],
            )
            assert found["words"] == words, (name, commands)
            if not held:
                assert bool(words) == (parts is not arms)
                said += words
                continue
            own = checker.timeline(Timeline(G1, before, (frame,)))[0]
            assert found["joint"] == own.joint
            assert found["share"] == pytest.approx(own.share)
            assert parts is None or parts is arms or not own.share, "no joint is commanded"
            said += words
    assert len(said) >= 8
    assert sum("straight way" in words for words in said) == 2
    assert "root is 20 cm inside the floor" in said
    assert said.count("3.0 m up in 0.50 s takes 12.0 m/s") == 2
    assert "the turn would need 6.01 rad/s, expected at most 6" in said
    assert sum("higher than a jump" in words for words in said) == 2


@pytest.mark.slow
def test_a_repeated_pose_is_doubted_as_one_that_is_held_as_in_python(visitor):
    high = standing(G1).qpos + 0.2 * np.eye(36)[2]
    hands = preset("hands", G1)
    poses = [(high, None), (high, None), (high, hands), (high, hands), (high + 1e-3, hands), (high, None)]
    frames = tuple(
        replace(Keyframe.from_qpos(1.0 + at, qpos), commands=parts) for at, (qpos, parts) in enumerate(poses)
    )
    timeline = Timeline(G1, standing(G1), frames)
    found = visitor.page.evaluate(
        "async (frames) => { const { Timeline, standing } = await import('./keyframes.mjs'), it = window.platStudio;"
        "it.edit(new Timeline(it.site, standing(it.site), frames, frames.map(() => 0), 1));"
        "return it.verdicts().map(({ words }) => words); }",
        [
            {"time": frame.time, "name": None, "qpos": qpos.tolist(), "commands": parts and parts.names(G1)}
            for frame, (qpos, parts) in zip(frames, poses, strict=True)
        ],
    )
    assert found == [list(verdict.words) for verdict in Checker(G1).timeline(timeline)]
    assert [bool(words) for words in found] == [True, False, False, False, False, True]


@pytest.mark.slow
def test_arms_are_led_around_as_in_python(visitor, tmp_path):
    file = tmp_path / "crossed.json"
    write_keyframes(file, G1, standing(G1), (ABOVE, BELOW))
    led = lead_around(KeyframeSequence.load(file, G1))
    visitor.begin("bow")
    visitor.page.set_input_files("input[type=file]", file)
    visitor.page.wait_for_function("window.platStudio.timeline.keyframes.length === 2")
    visitor.page.evaluate("window.platStudio.select(2)")
    button = visitor.page.get_by_role("button", name="Lead around", exact=True)
    button.click()
    visitor.until("studio.timeline.keyframes.length === 3 && studio.timeline.selected === 3")
    button.click()
    visitor.page.get_by_text("the straight way to this keyframe is clear: there is nothing to lead around").wait_for()
    found = visitor.page.evaluate("window.platStudio.timeline.keyframes.map(({ time, qpos }) => [time, ...qpos])")
    np.testing.assert_allclose(found, [[frame.time, *frame.qpos] for frame in led.keyframes], atol=1e-5)


@pytest.mark.slow
def test_trajectories_and_scores_are_pythons(visitor, tmp_path):
    """The same keyframe file, in a headless Chromium and here."""
    for name, run, motion, pins, stretch in (
        ("plat", "plat-g1", "bow", None, 1.0),
        ("plat", "plat-g1", "bow", None, 1.0375),  # arrivals are between control steps, one in the middle of two
        ("imagined", "imagined-g1", "wave", "hands", 1.0),
    ):
        timeline = template(motion, Timeline.empty(G1), Poser(G1))
        frames = tuple(frame.at(round(stretch * frame.time, 6)) for frame in timeline.keyframes)
        timeline = replace(timeline, keyframes=frames)
        if pins:
            for number in range(1, len(timeline.poses)):
                timeline = timeline.select(number).commanding(preset(pins, G1))
        file = tmp_path / "keyframes.json"
        write_keyframes(file, G1, timeline.start, timeline.to_keyframes())
        player = Player(G1, PolicyController(load_policy(run).deployed(), G1), timeline.sequence())
        while not player.finished:
            player.take_step()
        played = visitor.page.evaluate(
            "async ([name, text]) => (await import('./studio.mjs')).play(window.platStudio, name, text)",
            [name, file.read_text(encoding="utf-8")],
        )
        poses, expected = np.array(played["poses"]), np.array(player._poses)
        assert poses.shape == expected.shape
        assert np.abs(poses[:, :3] - expected[:, :3]).max() < _NEAR[0]
        assert np.abs(poses[:, 7:] - expected[:, 7:]).max() < _NEAR[1]
        distances = [error.keypoint for error in player.errors]
        np.testing.assert_allclose(played["distances"], distances, atol=_NEAR[0])
        scores = player.scores
        assert scores is not None
        assert [score["words"] for score in played["scores"]] == [score.words for score in scores]


# A page of another control step, and a policy that tells the motors the keyframe's joints.
_PUPPET = """async ([text, control_dt]) => {
  const { Chase } = await import("./chase.mjs"), { Timeline, read } = await import("./keyframes.mjs");
  const { Robot } = await import("./robot.mjs"), it = window.platStudio, site = { ...it.site, control_dt };
  const robot = new Robot(it.robot.mujoco, site), told = (_, keyframe) => keyframe.qpos.slice(7);
  const puppet = { observation: told, targets: async (joints) => joints, action: () => [], window: 3, maxSteps: 50 };
  const timeline = Timeline.of(site, read(text, site)), commands = [], references = [];
  const chase = new Chase(robot, puppet, timeline.start, timeline.sequence(puppet.maxSteps));
  const add = chase.scorer.add.bind(chase.scorer);
  chase.scorer.add = (command, qpos, time, reference, place, ...rest) => {
    commands.push([command.index, command.left, command.holding]);
    references.push([...reference.qpos, ...place.qpos.slice(0, 7)]);
    add(command, qpos, time, reference, place, ...rest);
  };
  while (!chase.finished) await chase.step();
  return { commands, references, poses: chase.poses, scores: chase.scorer.scores() };
}"""


@pytest.mark.slow
@pytest.mark.parametrize("steps", [0, 30, 55])
def test_a_simulation_that_diverges_is_told_as_in_python(visitor, tmp_path, steps):
    timeline = Timeline.empty(G1).inserted(squat(), 0.5, "squat").inserted(G1.default_qpos, 0.5)
    file = tmp_path / "kicked.json"
    write_keyframes(file, G1, timeline.start, timeline.to_keyframes())
    scores, ended = score(G1, Kicking(steps), timeline.sequence())
    found = visitor.page.evaluate(
        "async ([text, steps]) => { const studio = window.platStudio, { site, policies } = studio, { plat } = policies;"
        "const { Timeline, read } = await import('./keyframes.mjs');"
        "let asked = 0; const told = (_, keyframe) => keyframe.qpos.slice(7);"
        "const targets = async (joints) => {"
        " const kick = asked++ < steps ? 0 : 1e12; return joints.map((angle) => angle + kick); };"
        "policies.plat = { observation: told, targets, action: () => [], window: 3, maxSteps: 50, seesParts: true };"
        "studio.edit(Timeline.of(site, read(text, site)));"
        "await studio.compare(); const { scores, told: { plat: ended } } = studio; policies.plat = plat;"
        "return { ended, words: scores.plat.map(({ words }) => words), text: studio.at.scores.textContent }; }",
        [file.read_text(encoding="utf-8"), steps],
    )
    assert found["words"] == [keyframe.words for keyframe in scores]
    assert found["ended"] == ended
    assert f"plat {ended}" in found["text"]


@pytest.mark.slow
@pytest.mark.parametrize("control_dt", [0.01, 0.02, 0.05, 0.1])
def test_keyframes_between_control_steps_are_chased_as_in_python(visitor, tmp_path, control_dt):
    times = np.array([2.5, 6.5, 9.4, 14.6, 20.5, 27.5, 99.3]) * control_dt
    names = ("a", "b", "c", "d", "d (hold)", "e", "f")
    poses = {name: squat() if name[0] in "bd" else G1.default_qpos.copy() for name in names}
    for name in ("e", "f"):
        poses[name][0] += 0.3  # out of reach: off, or late
    frames = [Keyframe.from_qpos(time, poses[name], name) for time, name in zip(times.tolist(), names, strict=True)]
    file = tmp_path / "between.json"
    write_keyframes(file, G1, standing(G1), frames)
    timing = Timing(control_dt)
    sequence = Timeline.of(*_read(file), G1, timing).sequence()
    assert sequence.arrival_steps[:6] == (2, 6, 9, 15, 20, 28), "in the middle the even one"
    scorer, simulator = KeyframeScorer(G1), Simulator(G1.shared_model, control_dt)
    steps = list(Chase(Puppet(timing), sequence, simulator, hold=HOLD))
    for step in steps:
        scorer.add(step)
    found = visitor.page.evaluate(_PUPPET, [file.read_text(encoding="utf-8"), control_dt])
    assert found["commands"] == [[step.command.index, step.command.steps_left, step.holding] for step in steps]
    references = [np.concatenate((step.reference.qpos, step.root.qpos[:7])) for step in steps if step.root]
    np.testing.assert_allclose(found["references"], references, atol=1e-6)
    np.testing.assert_allclose(found["poses"][:20], [step.before.qpos for step in steps[:20]], atol=5e-3)
    assert [score["words"] for score in found["scores"]] == [score.words for score in scorer.scores()]


@pytest.mark.slow
def test_who_is_down_is_down_as_in_python(visitor):
    def pose(height: float, lean: float) -> Keyframe:
        turned = np.array([np.cos(lean / 2), 0.0, np.sin(lean / 2), 0.0])
        return replace(standing(G1), root_pos=np.array([0.0, 0.0, height]), root_quat=turned)

    low, stand, lying = pose(0.3, 0.0), pose(0.76, 0.0), pose(0.76, 1.5)
    cases = [
        (there, place, ends)
        for there in (low, stand, lying)
        for place in (low, stand, lying)
        for ends in ((), (low, stand), (stand, lying), (pose(0.44, 0.0), pose(0.46, 0.0)))
    ]
    found = visitor.page.evaluate(
        "async (cases) => { const { compare } = await import('./chase.mjs'), { robot } = window.platStudio;"
        "const pose = (qpos) => ({ qpos });"
        "return cases.map(([there, place, ends]) =>"
        "  compare(robot, there, pose(place), null, pose(place), ends.map(pose)).down); }",
        [
            [there.qpos.tolist(), place.qpos.tolist(), [end.qpos.tolist() for end in ends]]
            for there, place, ends in cases
        ],
    )
    compare = PoseComparison(G1)
    expected = [compare(state(there), place, None, place, ends).down for there, place, ends in cases]
    assert found == expected
    assert any(expected)
    assert not all(expected)


@pytest.mark.slow
def test_a_drag_leaves_a_pose_alone_that_was_selected_meanwhile(visitor):
    visitor.begin("bow")
    same = visitor.page.evaluate(
        "() => { const it = window.platStudio, [, other] = it.timeline.keyframes;"
        "it.grab(); it.receive({ do: 'next' });"
        "const { pos, quat } = it.robot.frames(it.timeline.pose.qpos)[it.handle];"
        "it.drag({ pos: pos.map((value) => value + 0.05), quat }); it.grip = null;"
        "return [it.timeline.selected, it.timeline.keyframes[1] === other]; }"
    )
    assert same == [2, True]


@pytest.mark.slow
def test_a_root_that_sinks_where_nothing_says_so_is_told_as_in_python(visitor):
    visitor.begin("bow")
    words = visitor.page.evaluate(
        "async () => { const { Chase } = await import('./chase.mjs'), it = window.platStudio, { timeline } = it;"
        "const chase = new Chase(it.robot, it.policies[it.policy], timeline.start, timeline.sequence(150));"
        "const near = { root: 0, joint: 0, bodies: 0, turn: 0, height: 0, near: true, down: false, keypoint: null };"
        "chase.scorer.steps[0] = [{ ...near, offPose: true, fallen: true, inWindow: true, arrival: true }];"
        "const [{ words }] = chase.scorer.scores(); chase.end(); return words; }"
    )
    assert words == "late or off: the root too low or tilted"


@pytest.mark.slow
def test_a_time_that_is_sought_while_it_plays_is_kept(visitor):
    visitor.begin("bow")
    visitor.page.keyboard.press("Space")
    visitor.until("studio.simulated > 0.3")
    cursor, later = visitor.page.evaluate(
        "async () => { const it = window.platStudio; it.receive({ do: 'seek', time: 0.1 }); const cursor = it.cursor;"
        "for (let frame = 0; frame < 5; frame++) await new Promise(requestAnimationFrame);"
        "return [cursor, it.cursor]; }"
    )
    assert cursor == later == pytest.approx(0.1)
    visitor.page.evaluate("window.platStudio.stop()")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("statuses", "status"), [("late reached", "reached"), ("fell reached", "fell"), ("reached late fell", "fell")]
)
def test_poses_on_the_way_count_where_the_robot_falls(visitor, statuses, status):
    visitor.begin("bow")
    visitor.page.evaluate(
        "(statuses) => { const it = window.platStudio; it.edit(it.timeline.select(1).stretched(2));"
        "it.scores = { [it.policy]: statuses.split(' ').map((status, index) => "
        "({ number: 1, time: index + 1, status, words: status, joint: 0, keypoint: 0 })) }; it.show(); }",
        statuses,
    )
    visitor.page.locator(f'#dock [data-key="1"][data-status="{status}"]').wait_for()
    assert "way to 1 " in visitor.page.locator(".scores").inner_text()


@pytest.mark.slow
def test_a_robot_that_has_walked_away_is_seen_when_it_stops(visitor):
    visitor.begin("bow")
    robot, world, looked = visitor.page.evaluate(
        "async () => { const it = window.platStudio, { timeline } = it, ahead = [...timeline.start.qpos];"
        "ahead[0] += 0.6; it.edit(timeline.select(1).posed(ahead)); it.receive({ do: 'first' });"
        "await it.stepBy(40); const place = it.scene.world.position.toArray(); it.receive({ do: 'look' });"
        "const robot = it.players[0].poseAt(it.cursor).slice(0, 2), looked = it.scene.orbit.target.toArray();"
        "it.stop(); return [robot, place.slice(0, 2), looked.slice(0, 2)]; }"
    )
    assert robot[0] > 0.2
    np.testing.assert_allclose(world, np.negative(robot), atol=1e-6)
    np.testing.assert_allclose(looked, [0.0, 0.0], atol=1e-6)


@pytest.mark.slow
def test_pausing_and_going_on_within_a_frame_is_one_run(visitor):
    visitor.begin("bow")
    steps = visitor.page.evaluate(
        "async () => { const it = window.platStudio, forward = it.forward; let within = 0, most = 0;"
        "it.forward = async () => { within += 1; most = Math.max(most, within);"
        "  await forward.call(it); await new Promise((done) => setTimeout(done, 5)); within -= 1; };"
        "it.toggle(); it.toggle(); it.toggle(); it.toggle(); it.toggle();"
        "for (let frame = 0; frame < 20; frame++) await new Promise(requestAnimationFrame);"
        "it.stop(); it.forward = forward; return most; }"
    )
    assert steps == 1


@pytest.mark.slow
def test_edits_of_two_keyframes_are_undone_apart(visitor):
    visitor.begin("bow")
    times = visitor.page.evaluate(
        "() => { const it = window.platStudio, times = () => it.timeline.keyframes.map(({ time }) => time);"
        "const before = times(); it.receive({ do: 'nudge', value: 1 }); const between = times();"
        "it.receive({ do: 'seek', time: it.timeline.keyframes[1].time }); it.receive({ do: 'nudge', value: 1 });"
        "const after = times(); it.receive({ do: 'undo' }); return [before, between, after, times()]; }"
    )
    before, between, after, undone = times
    assert before != between != after
    assert undone == between


@pytest.mark.slow
def test_a_keyframe_between_control_steps_is_nudged_by_one(visitor):
    times = visitor.page.evaluate(
        "async () => { const { Timeline, standing } = await import('./keyframes.mjs'), it = window.platStudio;"
        "const frame = { ...standing(it.site), time: 0.05 };"
        "return [1, -1].map((value) => { it.edit(new Timeline(it.site, standing(it.site), [frame], [0], 1));"
        "it.receive({ do: 'nudge', value }); return it.timeline.keyframes[0].time; }); }"
    )
    assert times == [0.06, 0.02], "of 0.04, where it arrives"


@pytest.mark.slow
def test_partial_roots_and_holds_are_pythons(visitor, tmp_path):
    stand, lying = standing(G1), np.concatenate(([0.3, 0.0, 0.12, 0.5**0.5, 0.0, 0.5**0.5, 0.0], G1.default_joint_pos))
    hands, elbow = preset("hands", G1), Parts.only(G1, joints=["left_elbow"])
    way = Keyframe.from_qpos(1.0, stand.qpos + 2 * np.eye(36)[0], "way")
    frames = [
        replace(way, commands=Parts.only(G1, root=["horizontal"])),
        replace(stand.at(2.0), name="arm", commands=elbow),
        replace(way.at(4.0), name="on", commands=Parts.only(G1, root=["horizontal"])),
        replace(way.at(4.5), name="on (hold)", commands=hands),
        replace(Keyframe.from_qpos(5.0, lying, "down"), commands=hands),
        replace(Keyframe.from_qpos(5.5, lying, "down (hold)"), commands=hands),
    ]
    file = tmp_path / "partial.json"
    write_keyframes(file, G1, replace(stand, commands=hands), frames)
    timeline = Timeline.of(*_read(file), G1, Timing())
    played = timeline.sequence()
    found = visitor.page.evaluate(
        "async (text) => { const { Timeline, asArrived, between, following, read, withCommandedRoot, write } ="
        " await import('./keyframes.mjs'); const { compare } = await import('./chase.mjs');"
        "const { site, robot } = window.platStudio, timeline = Timeline.of(site, read(text, site));"
        "const frames = timeline.sequence(50), at = (change) => {"
        "  const poses = following(change, timeline.start, frames, site);"
        "  return [0.5, 1.5, 3.0, 4.9, 9.0].map((time) => between(poses, time).qpos.slice(0, 7)); };"
        "const last = frames[frames.length - 1], flags = [...Array(29).fill(0), ...site.keypoints.map((name) =>"
        "  Number(last.commands.bodies.includes(name))), 0, 0, 0];"
        "const place = { qpos: at(withCommandedRoot)[4] };"
        "return { holds: timeline.holds, split: frames.map((frame) => [frame.time, ...frame.qpos.slice(0, 3)]),"
        "  sample: at(asArrived), commanded: at(withCommandedRoot),"
        "  down: compare(robot, last.qpos, last, flags, place).down,"
        "  start: Object.keys(JSON.parse(write(timeline)).start) }; }",
        file.read_text(encoding="utf-8"),
    )
    assert found["holds"] == list(timeline.holds) == [0.0, 0.0, 0.0, 0.0, 0.5]
    split = [[frame.time, *frame.root_pos] for frame in played.keyframes]
    np.testing.assert_allclose(found["split"], split, atol=1e-9)
    for name in ("sample", "commanded"):
        poses = [getattr(played, name)(time).qpos[:7] for time in (0.5, 1.5, 3.0, 4.9, 9.0)]
        np.testing.assert_allclose(found[name], poses, atol=1e-9, err_msg=name)
    assert found["down"], "only the hands are commanded to be there"
    assert found["start"] == ["root_pos", "root_quat", "joint_pos"]


@pytest.mark.slow
def test_a_policy_that_refuses_is_left_out_of_a_comparison_and_says_why(visitor):
    page = visitor.page
    visitor.begin("bow")
    page.evaluate("window.platStudio.pin('left hand')")
    page.get_by_role("button", name="Compare all policies").click()
    visitor.until("Object.keys(studio.scores).length > 0 && !studio.busy.length")
    assert visitor.get("scores.imagined")
    assert visitor.get("scores.plat") is None
    page.get_by_text("plat did not play: the keyframe at").wait_for()
    page.keyboard.press("Control+z")
    visitor.until("studio.past.length === 0 && !Object.keys(studio.told).length")
