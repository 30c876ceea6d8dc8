import dataclasses
import os
import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest
import torch
from safetensors.torch import save

from plat.baselines import tuned_robot
from plat.errors import MotionError
from plat.motions import MotionClip, MotionLibrary, cache_dir, load_motions, save_motions
from plat.robots import G1
from tests.conftest import standing_clip
from tests.motions.formats.test_sonic import write as write_sonic
from tests.motions.formats.writers import WITHOUT_WRISTS, bowing_clip, write_csv


def test_velocities_of_a_known_motion():
    library = MotionLibrary.from_clips([standing_clip()])
    states = library.states(torch.arange(10, 40))
    torch.testing.assert_close(
        states["keypoint_lin_vel"][:, 0, :2], torch.tensor([0.3, 0.0]).expand(30, 2), atol=2e-3, rtol=0
    )
    torch.testing.assert_close(
        states["keypoint_ang_vel"], torch.tensor([0, 0, 0.5]).expand(30, 14, 3), atol=2e-3, rtol=0
    )
    assert states["joint_vel"].abs().max() < 1e-4


def test_a_clip_does_not_leak_into_the_next():
    far = standing_clip("far")
    far.qpos[:, 0] += 100
    library = MotionLibrary.from_clips([standing_clip(), far])
    assert library.frames["keypoint_lin_vel"].norm(dim=-1).max() < 1.0


def test_clips_are_found_again(library):
    for clip in range(library.num_clips):
        start, length = int(library.clip_start[clip]), int(library.clip_length[clip])
        assert (library.clip_of_frame[start : start + length] == clip).all()
        assert (library.last_frame[start : start + length] == start + length - 1).all()
    assert len(library) == int(library.clip_length.sum())


def test_lookup_equals_the_table(library):
    frame = torch.randint(len(library), (3, 4))
    states = library.states(frame)
    assert states.shape == (3, 4)
    for name, value in states.items():
        assert torch.equal(value, library.frames[name][frame])
    for name, value in library.poses(frame).items():
        assert torch.equal(value, states[name])


def test_only_is_the_clip(library):
    one = library.only(2)
    assert one.clip_names == [library.clip_names[2]]
    start = int(library.clip_start[2])
    assert torch.equal(one.frames["joint_pos"], library.frames["joint_pos"][start : start + len(one)])


def test_a_clip_comes_back(library):
    clip = library.clip(2)
    assert (clip.name, clip.fps) == (library.clip_names[2], pytest.approx(50.0))
    again = MotionLibrary.from_clips([clip])
    torch.testing.assert_close(again.frames["keypoint_pos"], library.only(2).frames["keypoint_pos"], atol=1e-5, rtol=0)


def test_cache_gives_the_same_table(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    save_motions(tmp_path / "a.npz", [standing_clip()])
    first = MotionLibrary.load(tmp_path / "a.npz")
    assert len(list((cache_dir() / "motions").glob("*.safetensors"))) == 1
    monkeypatch.setattr("plat.motions.library.load_motions", lambda *_: pytest.fail("the cache was not used"))
    second = MotionLibrary.load(tmp_path / "a.npz")
    assert torch.equal(first.frames["keypoint_pos"], second.frames["keypoint_pos"])
    assert second.clip_names == ["standing"]


def test_clips_that_would_be_repaired_are_told_of_each_time(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    floating, short = bowing_clip(), bowing_clip(frames=5)
    floating.qpos[:, 2] += 0.1
    clips = [bowing_clip(), *(MotionClip(name, clip.qpos, 50.0) for name, clip in (("b", floating), ("c", short)))]
    save_motions(tmp_path / "a.npz", clips)
    for _ in range(2):
        caplog.clear()
        MotionLibrary.load(tmp_path / "a.npz")
        (line,) = [record.message for record in caplog.records if record.levelname == "WARNING"]
        assert line.startswith("of 3 clips 1 would be dropped and 1 would be repaired: run plat motions inspect")
        monkeypatch.setattr("plat.motions.library.MotionValidator", lambda *_: pytest.fail("measured again"))


def test_clips_that_would_be_dropped_are_left_out_on_request(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    floating, short = bowing_clip(), bowing_clip(frames=5)
    floating.qpos[:, 2] += 0.1
    save_motions(
        tmp_path / "a.npz", [bowing_clip(), MotionClip("b", floating.qpos, 50.0), MotionClip("c", short.qpos, 50.0)]
    )
    assert MotionLibrary.load(tmp_path / "a.npz").num_clips == 3
    for _ in range(2):  # made, and from the cache
        caplog.clear()
        assert MotionLibrary.load(tmp_path / "a.npz", drop_bad=True).clip_names == [bowing_clip().name, "b"]
        (line,) = [record.message for record in caplog.records if record.levelname == "WARNING"]
        assert line.startswith("of 3 clips 1 were left out and 1 would be repaired: run plat motions inspect")
    save_motions(tmp_path / "c.npz", [MotionClip("c", short.qpos, 50.0)])
    with pytest.raises(MotionError, match="no clip is left of 1, all would be dropped"):
        MotionLibrary.load(tmp_path / "c.npz", drop_bad=True)


def test_small_excesses_over_joint_limits_are_clipped_and_large_ones_told_of(tmp_path, monkeypatch, caplog):
    elbow = G1.joint_names.index("left_elbow")
    high = float(G1.joint_range[elbow, 1])
    for excess, loaded, told in ((0.1, 0.0, 0), (0.3, 0.3, 1)):
        clip = bowing_clip()
        clip.qpos[:, 7 + elbow] = high + excess
        save_motions(tmp_path / f"{told}.npz", [clip])
        caplog.clear()
        library = MotionLibrary.load(tmp_path / f"{told}.npz", cache=False)
        assert float(library.frames["joint_pos"][:, elbow].max()) == pytest.approx(high + loaded, abs=1e-5)
        assert len([record for record in caplog.records if record.levelname == "WARNING"]) == told


def test_clips_that_need_nothing_are_not_spoken_of(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    save_motions(tmp_path / "a.npz", [bowing_clip()])
    MotionLibrary.load(tmp_path / "a.npz")
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


def test_other_content_is_another_cache_entry(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    save_motions(tmp_path / "a.npz", [standing_clip()])
    MotionLibrary.load(tmp_path / "a.npz")
    save_motions(tmp_path / "a.npz", [standing_clip("other")])
    assert MotionLibrary.load(tmp_path / "a.npz").clip_names == ["other"]


def test_another_name_is_another_cache_entry(tmp_path, monkeypatch):
    # a file's name names its clip and may say its frame rate
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    write_csv(tmp_path / "a_30fps.csv", bowing_clip())
    slow = MotionLibrary.load(tmp_path / "a_30fps.csv")
    fast = MotionLibrary.load((tmp_path / "a_30fps.csv").rename(tmp_path / "b_60fps.csv"))
    assert fast.duration == pytest.approx(slow.duration / 2, abs=0.04)
    assert fast.clip_names == ["b"]


def test_another_folder_is_another_cache_entry(tmp_path, monkeypatch):
    # the folder's name may say the frame rate as well
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    for folder in ("30fps", "60fps"):
        (tmp_path / folder).mkdir()
        write_csv(tmp_path / folder / "a.csv", bowing_clip())
    slow, fast = (MotionLibrary.load(tmp_path / folder / "a.csv") for folder in ("30fps", "60fps"))
    assert fast.duration == pytest.approx(slow.duration / 2, abs=0.04)


def test_the_folder_that_one_is_in_counts_as_well(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    seconds = []
    for folder in ("walks_30fps", "walks_60fps"):
        (tmp_path / folder).mkdir()
        write_csv(tmp_path / folder / "a.csv", bowing_clip())
        monkeypatch.chdir(tmp_path / folder)
        seconds.append(MotionLibrary.load("a.csv").duration)
    assert seconds[0] == pytest.approx(2 * seconds[1], rel=0.05)


def test_a_folder_of_sonic_names_its_clip_wherever_it_is_read_from(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    for folder in ("a", "b"):
        write_sonic(tmp_path / folder, bowing_clip())
        monkeypatch.chdir(tmp_path / folder)
        assert MotionLibrary.load("joint_pos.csv").clip_names == [folder]


def test_a_rate_beside_a_table_is_part_of_the_key(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    durations = []
    for fps in (25.0, 50.0):
        write_csv(tmp_path / "a.txt", bowing_clip())
        save_motions(tmp_path / "a.npz", [MotionClip("a", bowing_clip().qpos, fps)])
        durations.append(MotionLibrary.load(tmp_path / "a.txt").duration)
    assert durations == pytest.approx([39 / 25, 39 / 50], abs=0.04)


def test_another_default_pose_is_another_cache_entry(tmp_path, monkeypatch):
    # joints that a file lacks have it
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    columns = [*range(7), *(7 + joint for joint in WITHOUT_WRISTS)]
    names = [G1.joint_names[joint] for joint in WITHOUT_WRISTS]
    np.savez(tmp_path / "a.npz", a=bowing_clip().qpos[:, columns], fps=50, joint_names=names)
    wrist = G1.joint_names.index("left_wrist_pitch")
    for angle in (0.0, 0.5):
        robot = dataclasses.replace(G1, default_pose={**G1.default_pose, "left_wrist_pitch": angle})
        library = MotionLibrary.load(tmp_path / "a.npz", robot)
        assert float(library.frames["joint_pos"][0, wrist]) == pytest.approx(angle)


def test_what_a_description_includes_is_part_of_the_key(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    save_motions(tmp_path / "a.npz", [standing_clip()])
    (tmp_path / "robot.xml").write_text('<mujoco><include file="body.xml"/></mujoco>')
    heights = []
    for hip in ("0 0.064452 -0.1027", "0 0.064452 -0.2027"):
        own = G1.asset_path.read_text()
        assert "0 0.064452 -0.1027" in own
        (tmp_path / "body.xml").write_text(own.replace("0 0.064452 -0.1027", hip))
        robot = dataclasses.replace(G1, name="other", asset=str(tmp_path / "robot.xml"))
        heights.append(float(MotionLibrary.load(tmp_path / "a.npz", robot).frames["keypoint_pos"][..., 2].min()))
    assert heights[0] - heights[1] == pytest.approx(0.1, abs=1e-3)


def words(caplog) -> list[tuple[str, str]]:
    """Take what was logged, but for lines on what clips are like."""
    told = [
        (record.levelname, record.message) for record in caplog.records if "plat motions inspect" not in record.message
    ]
    caplog.clear()
    return told


def test_the_cache_says_what_reading_says(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    caplog.set_level("INFO", logger="plat.motions")
    folder = tmp_path / "motions"
    folder.mkdir()
    save_motions(folder / "good.npz", [bowing_clip()])
    save_motions(folder / "good (1).npz", [bowing_clip()])
    write_csv(folder / "table.csv", bowing_clip())
    (folder / "bad.npz").write_bytes(b"nonsense")
    names = MotionLibrary.load(folder, cache=False).clip_names
    told = words(caplog)
    assert [line.split(":")[0] for _, line in told if "table.csv" not in line] == ["ignored", "skipped"]
    assert any("table.csv: csv, 30 fps" in line for _, line in told)
    for _ in range(2):  # made, and from the cache
        assert MotionLibrary.load(folder).clip_names == names
        assert words(caplog) == told
    (tmp_path / "elsewhere").mkdir()
    moved = folder.rename(tmp_path / "elsewhere" / "motions")
    monkeypatch.setattr("plat.motions.library.load_motions", lambda *_: pytest.fail("the cache was not used"))
    assert MotionLibrary.load(moved).clip_names == names
    assert words(caplog) == [(level, line.replace(str(folder), str(moved))) for level, line in told]


def test_a_bad_file_that_is_named_is_refused_with_and_without_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    folder = tmp_path / "motions"
    folder.mkdir()
    save_motions(folder / "good.npz", [bowing_clip()])
    (folder / "bad.npz").write_bytes(b"nonsense")
    assert MotionLibrary.load(folder).num_clips == 1
    for cache in (True, False):
        with pytest.raises(MotionError, match="bad.npz': not a readable .npz file"):
            MotionLibrary.load([folder / "bad.npz", folder / "good.npz"], cache=cache)


def test_mirrored_clips_are_added_on_request(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    save_motions(tmp_path / "a.npz", [standing_clip()])
    plain = MotionLibrary.load(tmp_path / "a.npz")
    both = MotionLibrary.load(tmp_path / "a.npz", mirror=True)
    assert (plain.clip_names, both.clip_names) == (["standing"], ["standing", "standing_mirrored"])
    turning = both.frames["keypoint_ang_vel"][:, 0, 2]
    torch.testing.assert_close(turning[len(plain) :], -turning[: len(plain)])


def test_generated_motions_are_cached_until_the_code_that_makes_them_changes(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    made = []

    def make(name, robot):
        made.append(name.removeprefix("generated:"))
        return [standing_clip(f"{made[-1]}{len(made)}")]

    monkeypatch.setattr("plat.motions.library.generate_named", make)
    for split in ("train", "val", "train", "val"):
        MotionLibrary.load(f"generated:{split}")
    assert made == ["train", "val"]
    monkeypatch.setattr("plat.motions.library.CODE_DIGEST", "other")
    assert MotionLibrary.load("generated:train").clip_names == ["train3"]


def test_a_file_that_is_replaced_while_it_is_read_is_not_cached(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    path = tmp_path / "a.npz"
    first, second = ([standing_clip(name)] for name in ("first", "second"))
    save_motions(path, first)
    before = path.read_bytes()

    def replaced(*arguments, **settings):
        save_motions(path, second)
        return load_motions(*arguments, **settings)

    with monkeypatch.context() as patch:
        patch.setattr("plat.motions.library.load_motions", replaced)
        assert MotionLibrary.load(path).clip_names == ["second"]
    path.write_bytes(before)
    assert MotionLibrary.load(path).clip_names == ["first"], "the cache held the second under the first one's name"


def cut_short(content: bytes) -> bytes:
    return content[:1000]


def zero_a_page(content: bytes) -> bytes:
    return content[:8192] + bytes(4096) + content[12288:]


def forget_the_metadata(content: bytes) -> bytes:
    return save({"table": torch.zeros(2, 3)})


@pytest.mark.parametrize("damage", [cut_short, zero_a_page, forget_the_metadata])
def test_a_damaged_cache_is_made_again(tmp_path, monkeypatch, damage):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    save_motions(tmp_path / "a.npz", [standing_clip()])
    first = MotionLibrary.load(tmp_path / "a.npz").frames["keypoint_pos"].clone()  # the file is mapped
    (entry,) = (cache_dir() / "motions").glob("*.safetensors")
    entry.write_bytes(damage(entry.read_bytes()))
    second = MotionLibrary.load(tmp_path / "a.npz")
    assert torch.equal(first, second.frames["keypoint_pos"])
    monkeypatch.setattr("plat.motions.library.load_motions", lambda *_: pytest.fail("it was not made again"))
    assert MotionLibrary.load(tmp_path / "a.npz").clip_names == ["standing"]


def test_loads_at_the_same_time_share_one_whole_cache_entry(tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path / "cache"))
    save_motions(tmp_path / "a.npz", [standing_clip()])
    ready = Barrier(4)

    def load_together() -> MotionLibrary:
        ready.wait()
        return MotionLibrary.load(tmp_path / "a.npz")

    with ThreadPoolExecutor(4) as pool:
        libraries = [future.result() for future in [pool.submit(load_together) for _ in range(4)]]
    assert all(torch.equal(one.frames["joint_vel"], libraries[0].frames["joint_vel"]) for one in libraries)
    assert len(list((cache_dir() / "motions").iterdir())) == 1
    monkeypatch.setattr("plat.motions.library.load_motions", lambda *_: pytest.fail("the cache was not used"))
    assert MotionLibrary.load(tmp_path / "a.npz").num_clips == 1


@pytest.mark.skipif(os.name != "posix", reason="needs file size limits")
def test_a_full_disk_only_costs_the_cache(tmp_path):
    save_motions(tmp_path / "a.npz", [standing_clip()])
    program = (
        "import logging, resource, signal, sys\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "from plat.envs import MotionLibrary\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))\n"
        "logging.basicConfig(stream=sys.stdout, format='%(message)s')\n"
        f"print(MotionLibrary.load({str(tmp_path / 'a.npz')!r}).num_clips)\n"
    )
    environment = {**os.environ, "PLAT_CACHE_DIR": str(tmp_path / "cache")}
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    told, clips = out.stdout.splitlines()
    assert "was not written (" in told
    assert "File too large" in told
    assert clips == "1"
    assert not list((tmp_path / "cache" / "motions").iterdir())
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY


def test_bad_input():
    with pytest.raises(MotionError, match="no clips"):
        MotionLibrary.from_clips([])
    with pytest.raises(MotionError, match="motion library: no motions, expected at least one file"):
        MotionLibrary.load([])
    blink = MotionClip("blink", standing_clip(frames=2, fps=300.0).qpos, 300.0)
    with pytest.raises(MotionError, match="motion 'blink': 0.003 s, expected at least one control step"):
        MotionLibrary.from_clips([blink])
    with pytest.raises(MotionError, match="no set 'dev'"):
        MotionLibrary.load("generated:dev")


def test_real_motions_load(shared_data, tmp_path, monkeypatch):
    monkeypatch.setenv("PLAT_CACHE_DIR", str(tmp_path))
    library = MotionLibrary.load(shared_data / "motions" / "bandai_val.npz")
    assert library.num_clips == 272
    assert library.duration == pytest.approx(1411, abs=3)  # from each clip's first to its last frame
    assert np.isfinite(library.frames["keypoint_ang_vel"].numpy()).all()


def test_some_clips_in_the_order_given():
    library = MotionLibrary.from_clips([standing_clip("a", 31), standing_clip("b", 61), standing_clip("c", 46)])
    some = library.only(2, 0)
    assert some.clip_names == ["c", "a"]
    assert some.clip_length.tolist() == library.clip_length[[2, 0]].tolist()
    for number, clip in enumerate((2, 0)):
        alone = library.only(clip)
        start, length = int(some.clip_start[number]), int(some.clip_length[number])
        torch.testing.assert_close(some.frames[start : start + length], alone.frames, rtol=0, atol=0)


def test_long_clips_are_cut_into_equal_pieces():
    library = MotionLibrary.from_clips([standing_clip("short", 20), standing_clip("long", 61)])
    pieces = library.pieces(0.9)
    assert pieces.clip_names == ["short", "long_0", "long_1", "long_2"]
    long = int(library.clip_length[1])
    assert int(pieces.clip_length[1:].sum()) == long
    assert int(pieces.clip_length.max() - 1) * pieces.dt <= 0.9
    assert int(pieces.clip_length[1:].max() - pieces.clip_length[1:].min()) <= 1
    assert torch.equal(pieces.frames["joint_vel"], library.frames["joint_vel"])
    first = torch.cat([pieces.qpos(torch.tensor([int(start)])) for start in pieces.clip_start[1:]])
    whole = library.only(1)
    offsets = pieces.clip_start[1:] - pieces.clip_start[1]
    assert torch.equal(first, whole.qpos(offsets))
    assert library.pieces(60.0).clip_names == library.clip_names


def test_clips_are_found_by_name():
    library = MotionLibrary.from_clips([standing_clip(name) for name in ("run_old_001", "walk_001", "Dance_run")])
    assert library.named("run|kick") == [0, 2]
    assert library.named("dance|^walk") == [1, 2]
    with pytest.raises(MotionError, match="'jump' is in none of the 3, which are called 'run_old_001'"):
        library.named("jump")
    with pytest.raises(MotionError, match=r"'run\(' is not a regular expression"):
        library.named("run(")


def test_the_same_motions_for_other_motors():
    library = MotionLibrary.from_clips([standing_clip()])
    soft = tuned_robot(G1, "soft", 0.5 * G1.stiffness, G1.damping, G1.effort_limit)
    other = library.for_robot(soft)
    assert other.robot is soft
    assert other.frames["keypoint_pos"].equal(library.frames["keypoint_pos"])
    with pytest.raises(MotionError, match="motions of robot 'g1': robot 'short' has another body"):
        library.for_robot(dataclasses.replace(G1, name="short", keypoints=G1.keypoints[:5]))
