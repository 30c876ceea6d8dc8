import pickle

import pytest

from plat.errors import MotionError
from plat.motions.retargeting import UnknownSkeletonError, builtin_maps, load_map, read_bvh, retarget, save_map
from plat.motions.retargeting.builtin import find_map
from plat.motions.retargeting.propose import propose_map

from .human import write_human

MAPS = {skeleton.name: skeleton for skeleton in builtin_maps()}
LAFAN1 = MAPS["lafan1"]
# other words for the joints of LAFAN1
ODD = {
    "Hips": "Bassin",
    "Spine": "Torse_0",
    "Spine1": "Torse_1",
    "Spine2": "Torse_2",
    "Neck": "NeckBase",
    **{f"{side}{name}": f"{word}_{side[0]}" for side in ("Left", "Right") for name, word in (
        ("UpLeg", "Cuisse"), ("Leg", "Mollet"), ("Foot", "foot"), ("Toe", "toes"), ("Shoulder", "Clav"),
        ("Arm", "Bras"), ("ForeArm", "AvantBras"), ("Hand", "hand"),
    )},
}  # fmt: skip


def test_hands_feet_and_the_tree_are_enough(tmp_path):
    mocap = read_bvh(write_human(tmp_path / "a.bvh", frames=3, names=ODD))
    found = propose_map(mocap, "proposed")
    assert found.joints == {role: ODD[name] for role, name in LAFAN1.joints.items()}


@pytest.mark.parametrize("name", sorted(set(MAPS) - {"asf", "amp", "cmu_daz", "deepmimic", "noitom"}))
def test_sides_and_limbs_of_the_known_skeletons(tmp_path, name):
    names = {LAFAN1.joints[role]: joint for role, joint in MAPS[name].joints.items()}
    if len(set(names.values())) < len(names):
        pytest.skip("one joint has two roles")
    rest = {joint: f"Extra{number}" for number, joint in enumerate(("Spine1", "Head", "LeftShoulder", "RightShoulder"))}
    mocap = read_bvh(write_human(tmp_path / "a.bvh", frames=3, names={**rest, **names}))
    found = propose_map(mocap, "proposed")
    limbs = [role for role in LAFAN1.joints if role.startswith(("left", "right"))]
    assert {role: found.joints[role] for role in limbs} == {role: MAPS[name].joints[role] for role in limbs}


def test_what_cannot_be_told_is_not_proposed(tmp_path):
    numbered = {name: f"joint{number}" for number, name in enumerate(ODD)}
    mocap = read_bvh(write_human(tmp_path / "a.bvh", frames=3, names=numbered))
    assert propose_map(mocap, "proposed") is None
    with pytest.raises(UnknownSkeletonError) as error:
        find_map(mocap, "a.bvh")
    assert error.value.proposed is None


def test_a_proposed_map_is_used_when_it_is_confirmed(tmp_path):
    pytest.importorskip("mink")
    path = write_human(tmp_path / "a.bvh", frames=3, names=ODD)
    with pytest.raises(MotionError, match="write a map for them") as error:
        retarget(path)
    # processes hand errors on
    again = pickle.loads(pickle.dumps(error.value))
    assert (str(again), again.proposed) == (str(error.value), error.value.proposed)
    save_map(tmp_path / "mine.yaml", again.proposed, "proposed")
    assert retarget(path, load_map(tmp_path / "mine.yaml")).error < 0.01


def in_language(hips, spine, neck, words, side):
    """Names of LAFAN1's joints in another language."""
    limbs = ("UpLeg", "Leg", "Foot", "Toe", "Shoulder", "Arm", "ForeArm", "Hand")
    trunk = {"Hips": hips, "Spine": f"{spine}1", "Spine1": f"{spine}2", "Spine2": f"{spine}3", "Neck": neck}
    return trunk | {
        f"{s}{limb}": side(word, s) for s in ("Left", "Right") for limb, word in zip(limbs, words, strict=True)
    }


LANGUAGES = {
    "German": in_language(
        *("Becken", "Wirbel", "Hals"),
        ("Oberschenkel", "Unterschenkel", "Fuss", "Zehen", "Schulter", "Oberarm", "Unterarm", "Hand"),
        lambda word, side: f"{word}{'Links' if side == 'Left' else 'Rechts'}",
    ),
    "French": in_language(
        *("Bassin", "Dos", "Cou"),
        ("Cuisse", "Jambe", "Pied", "Orteils", "Clavicule", "Bras", "Coude", "Main"),
        lambda word, side: f"{word}{'Gauche' if side == 'Left' else 'Droite'}",
    ),
    "Spanish": in_language(
        *("Cadera", "Columna", "Cuello"),
        ("Muslo", "Pierna", "Pie", "Punta", "Hombro", "Brazo", "Codo", "Mano"),
        lambda word, side: f"{word}_{'izq' if side == 'Left' else 'der'}",
    ),
    "Japanese": in_language(
        *("腰", "背骨", "首"),
        ("腿", "膝", "足首", "つま先", "肩", "腕", "肘", "手首"),
        lambda word, side: f"{'左' if side == 'Left' else '右'}{word}",
    ),
}


@pytest.mark.parametrize("names", LANGUAGES.values(), ids=LANGUAGES)
def test_names_in_other_languages(tmp_path, names):
    mocap = read_bvh(write_human(tmp_path / "a.bvh", frames=3, names=names))
    found = propose_map(mocap, "proposed")
    assert found is not None
    assert found.joints == {role: names[name] for role, name in LAFAN1.joints.items()}
