import logging
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import generate_motions, generation
from plat.motions.checks import validate_motion
from plat.motions.generation import DT, FAMILIES, GROUPS, WIDE_FAMILIES, Solver, generate_named
from plat.motions.generation.families import ON_QUICK_FEET
from plat.motions.generation.script import MotionScript
from plat.motions.generation.soundness import QUICK_FEET, SoundnessLimits, contact_points, measure_soundness
from plat.motions.generation.whole_body import WholeBody
from plat.robots import G1


@pytest.fixture(scope="module", params=sorted(FAMILIES))
def clip(request):
    """One clip of each family."""
    return generate_motions("train", seconds=0.1, families=(request.param,))[0]


def test_clips_are_sound(clip):
    assert measure_soundness(G1, clip.qpos, DT).faults() == []


def test_clips_begin_and_end_at_rest_in_one_posture(clip):
    for end in (clip.qpos[:3], clip.qpos[-3:]):
        assert np.abs(np.diff(end[:, 7:], axis=0)).max() / DT < 0.15
    np.testing.assert_allclose(clip.qpos[0, 19:], clip.qpos[-1, 19:], atol=1e-3)


def test_something_happens(clip):
    assert 3 < clip.duration < 60
    assert np.ptp(clip.qpos[:, 7:], axis=0).max() > 0.1


@pytest.fixture(scope="module")
def twenty_seconds():
    return generate_motions("val", seconds=20)


def test_same_seed_same_motion(twenty_seconds):
    again = generate_motions("val", seconds=20)
    assert all(np.array_equal(a.qpos, b.qpos) for a, b in zip(twenty_seconds, again, strict=True))


def test_a_longer_set_holds_the_same_clips(twenty_seconds):
    short, long = generate_motions("val", seconds=6), twenty_seconds
    assert len(long) > len(short)
    assert all(np.array_equal(a.qpos, b.qpos) for a, b in zip(short, long, strict=False))


def test_a_family_that_two_names_ask_for_comes_once():
    names = [clip.name for clip in generate_named("generated:val/hop+bow+hop@8")]
    assert len(names) == len(set(names)) > 1


def test_links_may_have_names_of_their_own(tmp_path):
    spec = G1.spec()
    spec.delete(spec.geom("floor"))
    spec.compile()
    (tmp_path / "robot.xml").write_text(re.sub(r"([a-z_]+)_link\b", r"\1_body", spec.to_xml()))
    named = {
        field: tuple(body.replace("_link", "_body") for body in getattr(G1, field))
        for field in ("keypoints", "end_effectors", "feet")
    }
    anchor = G1.anchor.replace("_link", "_body")
    renamed = replace(G1, name="renamed", asset=str(tmp_path / "robot.xml"), anchor=anchor, **named)
    (clip,), (same,) = (generate_motions("val", 0.1, ("bow",), robot) for robot in (renamed, G1))
    np.testing.assert_allclose(clip.qpos, same.qpos, atol=1e-5)


def test_splits_share_no_motion():
    train, val = (generate_motions(split, seconds=5, families=("bow",)) for split in ("train", "val"))
    assert not any(a.qpos.shape == b.qpos.shape and np.allclose(a.qpos, b.qpos) for a in train for b in val)


def test_a_short_set_holds_many_families():
    families = [clip.name.split("_")[0] for clip in generate_motions("train", seconds=30)]
    assert families == list(FAMILIES)[: len(families)]
    assert len(families) >= 5


def test_unsound_draws_are_drawn_anew(monkeypatch, caplog):
    draft = Solver.poses
    calls = []

    def limp(self, script):
        calls.append(script)
        qpos = draft(self, script)
        if len(calls) == 1:
            qpos[:, 2] -= 0.02  # into the floor
        return qpos

    monkeypatch.setattr(Solver, "poses", limp)
    with caplog.at_level(logging.DEBUG, "plat.motions.generation"):
        (clip,) = generate_motions("train", seconds=0.1, families=("bow",))
    assert len(calls) == 2
    assert "'bow_train_000' rejected and drawn again: penetration 0.0200 (limit 0.005)" in caplog.text
    assert measure_soundness(G1, clip.qpos, DT).penetration < 1e-6


def test_a_family_that_is_never_sound_is_an_error(monkeypatch):
    def sink(script, rng):
        script.shift({"pelvis_height": -0.55}, 1.0)
        script.wait(1.0)

    monkeypatch.setitem(FAMILIES, "sink", sink)
    monkeypatch.setattr(generation, "_ATTEMPTS", 2)
    with pytest.raises(MotionError, match="motion 'sink_train_000': 2 draws and none is sound; the last: the"):
        generate_motions("train", families=("sink",))


def test_unknown_names():
    with pytest.raises(MotionError, match="no family \\['fly'\\]"):
        generate_motions("train", families=("fly",))
    with pytest.raises(MotionError, match="no set 'dev'"):
        generate_motions("dev")
    for seconds in ("8", float("nan"), None):
        with pytest.raises(MotionError, match="generated motions: .* s, expected above 0 and at most 100,000 s"):
            generate_motions("val", seconds)


def test_a_foot_that_cannot_get_there_names_the_joint():
    script = MotionScript(np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]]), {})
    script.shift({"pelvis_height": -0.5}, 0.5)
    script.wait(0.6)
    with pytest.raises(MotionError, match="foot is out of reach at frame \\d+, with .*ankle_pitch.* at their limits"):
        Solver(WholeBody(G1)).poses(script.draft(DT))


@pytest.fixture(scope="module", params=sorted(WIDE_FAMILIES))
def wide_clip(request):
    """One clip of each wide family, and its family."""
    return generate_named(f"generated:train/{request.param}@0.1")[0], request.param


def test_wide_clips_are_sound_and_pass_inspection(wide_clip):
    clip, family = wide_clip
    limits = QUICK_FEET if family in ON_QUICK_FEET else SoundnessLimits()
    found = measure_soundness(G1, clip.qpos, DT, limits)
    assert found.faults(limits) == []
    assert found.slip < 0.005
    assert validate_motion(clip).verdict == "use"
    for end in (clip.qpos[:3], clip.qpos[-3:]):
        assert np.abs(np.diff(end[:, 7:], axis=0)).max() / DT < 0.3
    if family in ("run", "jump", "hop"):
        assert _aloft(clip.qpos) >= 4


def test_plain_sets_are_as_they_were(twenty_seconds):
    # published scores rest on them
    middles = {
        "stand_val_000": (247, -0.0013, 0.004, 0.7543, 0.6831, 0.7435),
        "reach_val_000": (222, -0.0486, -0.0257, 0.759, 0.6203, 0.2318),
        "walk_val_000": (299, 0.4426, -0.0545, 0.7567, 1.0586, 0.5443),
        "squat_val_000": (190, -0.0659, -0.0001, 0.5861, 1.6096, 0.5036),
        "wave_val_000": (264, -0.0171, 0.0024, 0.7381, 0.8276, -0.0642),
    }
    for clip in twenty_seconds:
        frames, *numbers = middles[clip.name]
        assert len(clip.qpos) == frames
        np.testing.assert_allclose(clip.qpos[frames // 2, [0, 1, 2, 10, 25]], numbers, atol=2e-4)


def test_groups_stand_for_their_families():
    assert GROUPS["wide"] == tuple(WIDE_FAMILIES)
    assert not set(WIDE_FAMILIES) & set(FAMILIES)
    clips = generate_motions("val", seconds=9, families=("wide",))
    assert [clip.name.split("_")[0] for clip in clips] == list(WIDE_FAMILIES)[: len(clips)]


def test_running_is_fast():
    (clip,) = generate_motions("val", seconds=1, families=("run",))
    assert np.linalg.norm(np.diff(clip.qpos[:, :2], axis=0), axis=1).max() / DT > 2.2


def _aloft(qpos: np.ndarray) -> int:
    """Return the number of frames in which neither foot touches the floor."""
    points, _ = contact_points(G1, G1.model(), qpos.astype(np.float64))
    return int((points[..., 2].min((-1, -2)) > 0.003).sum())


@pytest.mark.parametrize("feet", ["spheres", "capsules"])
def test_points_of_soles_of_any_shape_are_their_lowest(feet):
    model = G1.model(feet)
    data, floor, soles = mujoco.MjData(model), model.geom("floor").id, G1.sole_geoms(model)
    qpos = np.stack((G1.default_qpos, G1.default_qpos))
    qpos[:, 2] += 0.1
    qpos[1, 3:7] = 0.98, 0.1, 0.17, 0.0
    points, _ = contact_points(G1, model, qpos)
    for pose, found in zip(qpos, points[..., 2].min(-1), strict=True):
        data.qpos[:] = pose / np.concatenate((np.ones(3), np.full(4, np.linalg.norm(pose[3:7])), np.ones(29)))
        mujoco.mj_kinematics(model, data)
        for foot, low in zip(soles, found, strict=True):
            exact = min(mujoco.mj_geomDistance(model, data, floor, geom, 9.0, None) for geom in foot)
            assert low == pytest.approx(exact, abs=1e-6)


def test_names_choose_families_and_length():
    clips = generate_named("generated:val/bow+stand@12")
    assert [clip.name for clip in clips] == ["bow_val_000", "stand_val_000", "bow_val_001"]


@pytest.mark.parametrize("name", ["generated:val@long", "generated:val/tango", "generated:"])
def test_other_names_are_refused(name):
    with pytest.raises(MotionError, match="expected"):
        generate_named(name)
