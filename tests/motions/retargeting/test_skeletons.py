import pytest

from plat.errors import MotionError, OutputError
from plat.motions.retargeting import builtin_maps, load_map, read_bvh, save_map
from plat.motions.retargeting.human import read_human

from .human import write_human

LAFAN1 = next(skeleton for skeleton in builtin_maps() if skeleton.name == "lafan1")


def test_a_map_of_ones_own(tmp_path):
    joints = "\n".join(f"  {role}: my{name}" for role, name in LAFAN1.joints.items())
    (tmp_path / "mine.yaml").write_text(f"joints:\n{joints}\nunits: 0.0254\nup: z\npelvis_pitch: 20\n")
    skeleton = load_map(tmp_path / "mine.yaml")
    assert (skeleton.name, skeleton.units, skeleton.up, skeleton.pelvis_pitch) == ("mine", 0.0254, "z", 20)
    renamed = {name: f"my{name}" for name in LAFAN1.joints.values()}
    path = write_human(tmp_path / "a.bvh", unit=2.54, up="z", names=renamed)
    assert read_human(read_bvh(path), skeleton, "clip.bvh").leg == pytest.approx(0.859, abs=1e-3)
    with pytest.raises(MotionError, match=r"clip.bvh: lacks the joints \['Hips', "):
        read_human(read_bvh(path), LAFAN1, "clip.bvh")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joints: [Hips]", r"'joints' lacks \['chest'"),
        ("joints: {tail: Tail}", r"has the unknown \['tail'\]"),
        ("units: cm", "expected the field 'joints'"),
        ("joints: {joints}\nunits: &a [1]\nup: *a", r"has a reference \(\*name\), expected plain values"),
        ("joints: {joints}\njoints: {joints}", "field 'joints' comes twice in one object"),
        ("joints: {joints}\nunits: 2001-99-99", "'units' is '2001-99-99'"),
        ("joints: {joints}\nunits: " + "9" * 5000, r"'units' is inf, expected"),
        ("joints: {hips: [a]}", "'joints' lacks"),
        ("joints: {}\nscale: 2", "expected the field 'joints' and any of"),
        ("joints: {", "not a readable YAML file"),
        ("joints: {joints}\nunits: yard", "'units' is 'yard', expected auto, m, cm, mm, in, ft, in/0.45 or meters"),
        ("joints: {joints}\nunits: -1", "'units' is -1"),
        ("joints: {joints}\nunits: [1]", r"'units' is \['1'\]"),
        ("joints: {joints}\nup: w", "'up' is 'w', expected auto, x, y or z"),
        ("joints: {joints}\ntorso_pitch: much", "'torso_pitch' is 'much', expected degrees"),
    ],
)
def test_errors_of_a_map_name_file_and_field(tmp_path, text, message):
    (tmp_path / "mine.yaml").write_text(text.replace("{joints}", str(LAFAN1.joints)))
    with pytest.raises(MotionError, match=f"mine.*{message}"):
        load_map(tmp_path / "mine.yaml")


def test_missing_map():
    with pytest.raises(MotionError, match=r"'nowhere.yaml': no such file"):
        load_map("nowhere.yaml")


def test_a_map_is_written_as_it_is_read(tmp_path):
    save_map(tmp_path / "lafan1.yaml", LAFAN1, "by hand")
    assert (tmp_path / "lafan1.yaml").read_text().startswith("# by hand\njoints:\n  hips: 'Hips'\n")
    assert load_map(tmp_path / "lafan1.yaml") == LAFAN1


def test_a_map_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(OutputError, match="x.yaml': cannot be written: File name too long"):
        save_map(tmp_path / f"{'x' * 300}.yaml", LAFAN1, "by hand")
