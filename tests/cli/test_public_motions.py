import numpy as np
import pytest

from plat.cli.public_motions import PUBLIC
from plat.errors import PlatError
from plat.motions import load_motions, save_csv
from plat.robots import G1
from tests.conftest import standing_clip
from tests.motions.retargeting.human import write_human


def test_motion_capture_is_retargeted_once(tmp_path, capsys):
    folder, bandai = tmp_path / "bvh", PUBLIC["bandai"]
    folder.mkdir()
    for name in ("clip_0", "clip_1"):  # train and val by the rule
        write_human(folder / f"{name}.bvh", frames=5)
    path = bandai.file(folder, tmp_path / "out", G1)
    assert path == tmp_path / "out" / "motions" / "bandai_val.npz"
    assert [clip.name for clip in load_motions(path)] == ["clip_1"]
    assert capsys.readouterr().out == "bandai: reading 1 file\n"
    assert bandai.file(folder, tmp_path / "out", G1) == path
    assert capsys.readouterr().out == f"motions of an earlier start: {path}; remove it to read {folder} again\n"
    assert bandai.file(path, tmp_path / "other", G1) == path  # a file is taken as it is
    (folder / "clip_1.bvh").unlink()
    with pytest.raises(PlatError, match="--bandai .*bvh': no .bvh file of the split val in it"):
        bandai.file(folder, tmp_path / "other", G1)


def test_named_files_are_taken_from_their_folder_at_their_rate(tmp_path, capsys):
    for place in ("karate/M_Move18/retarget", "karate/M_Move18/policy", "dance/J_Dance2_Salsa/retarget"):
        (tmp_path / place).mkdir(parents=True)
        name = place.split("/")[1]
        written = save_csv(tmp_path / place, standing_clip(name, frames=31))
        written.rename(tmp_path / place / f"{name}.csv")  # without the rate, as these come
    moves = PUBLIC["g1_moves"]
    (clip,) = load_motions(moves.file(tmp_path, tmp_path / "out", G1))
    assert (clip.name, clip.fps, len(clip.qpos)) == ("M_Move18", 60.0, 31)
    told = "without B_WiggleDance, J_ShortDance16_JazzWalk, M_Move19"
    assert capsys.readouterr().out == f"g1_moves: reading 1 file, {told}\n"
    assert moves.families(["M_Move18", "B_WiggleDance"]) == ["fight", "dance"]
    with pytest.raises(PlatError, match="--g1-moves .*: no .csv file of the names B_WiggleDance, .*M_Move19 in it"):
        moves.file(tmp_path / "dance", tmp_path / "other", G1)


def test_trials_of_cmu_are_taken_by_their_numbers(tmp_path):
    for name in ("16_36", "16_35"):
        write_human(tmp_path / f"{name}.bvh", frames=5)
    (clip,) = load_motions(PUBLIC["cmu"].file(tmp_path, tmp_path / "out", G1))
    assert clip.name == "16_36"
    assert PUBLIC["cmu"].families([clip.name]) == ["run"]


def test_captures_of_several_rates_are_brought_to_one(tmp_path):
    write_human(tmp_path / "16_36.bvh", frames=9)
    write_human(tmp_path / "16_38.bvh", frames=9)
    slower = tmp_path / "16_38.bvh"
    text = slower.read_text()
    assert text.count("Frame Time: ") == 1
    start = text.index("Frame Time: ") + len("Frame Time: ")
    end = text.index("\n", start)
    slower.write_text(text[:start] + str(2 * float(text[start:end])) + text[end:])
    one, other = load_motions(PUBLIC["cmu"].file(tmp_path, tmp_path / "out", G1))
    assert (one.fps, other.fps) == (50.0, 50.0)
    assert len(other.qpos) - 1 == pytest.approx(2 * (len(one.qpos) - 1), abs=2)


def test_a_trial_of_cmu_has_several_spellings(tmp_path):
    for name in ("016_36", "16_36_extra"):
        write_human(tmp_path / f"{name}.bvh", frames=5)
    (clip,) = load_motions(PUBLIC["cmu"].file(tmp_path, tmp_path / "out", G1))
    assert clip.name == "016_36"
    assert PUBLIC["cmu"].families([clip.name]) == ["run"]


@pytest.mark.parametrize(
    ("option", "skeleton", "capture", "place", "family"),
    [
        # the archive has a folder a subject; the real capture stands for the trial of that subject in the list
        ("cmu", "cmu_14.asf", "cmu_14_37.amc", "subjects/14/14_08.amc", "jump"),
        (
            "hdm05",
            "HDM_bd.asf",
            "HDM_bd_kickLFront1Reps_001_120.amc",
            "HDM05_cut_amc/kickLFront1Reps/HDM_bd_kickLFront1Reps_001_120.amc",
            "fight",
        ),
    ],
)
def test_captures_as_their_archives_lay_them_out(option, skeleton, capture, place, family, shared_data, tmp_path):
    pytest.importorskip("mink")
    captures = shared_data / "formats" / "mocap"
    path = tmp_path / place
    path.parent.mkdir(parents=True)
    lines = (captures / capture).read_bytes().splitlines()
    frames = [number for number, line in enumerate(lines) if line.strip().isdigit()]
    path.write_bytes(b"\n".join(lines[: frames[5]]) + b"\n")  # the first frames, for retargeting takes time
    called = skeleton.removeprefix("cmu_")
    (path.parent / called).write_bytes((captures / skeleton).read_bytes())
    (clip,) = load_motions(PUBLIC[option].file(tmp_path, tmp_path / "out", G1))
    assert clip.name == path.stem
    assert PUBLIC[option].families([clip.name]) == [family]
    assert 0.5 < clip.qpos[:, 2].mean() < 1.0


def test_no_public_validation_motion_was_trained_on(shared_data):
    """Names in the hard motion that weights were trained on: cmu_16_36_run, g1moves_M_Move18_c0, hdm05_bd_..._fight."""
    for name in ("hard_free_train", "hard_sa_train", "hard_nc_train"):
        with np.load(shared_data / "motions" / f"{name}.npz") as archive:
            trained = archive.files
        for clip in [*(PUBLIC["g1_moves"].clips or ()), *(PUBLIC["cmu"].clips or ())]:
            assert not any(f"_{clip}_" in f"{each}_" and each.startswith(("cmu", "g1moves")) for each in trained), clip
        for clip in PUBLIC["hdm05"].clips or ():
            cut = clip.removeprefix("HDM_").removesuffix("_120")
            assert not any(each.startswith(f"hdm05_{cut}_") for each in trained), clip
