"""A skeleton map proposed from names of hands and feet, and from the tree between them."""

import re
from collections.abc import Sequence

import numpy as np

from plat.motions.formats.spellings import tokens
from plat.motions.retargeting.capture_axes import rest_pitches
from plat.motions.retargeting.mocap import Mocap
from plat.motions.retargeting.skeletons import SIDES, SkeletonMap

__all__ = ["propose_map"]

# in English, German, French, Spanish and Japanese
_ANKLE = re.compile(r"foot|ankle|feet|talus|fuss|fuß|knöchel|pied|cheville|tobillo|(?<![a-z])pie(?![a-z])|足首")
_TOE = re.compile(r"toe|ball|zeh|orteil|punta|つま先")
_WRIST = re.compile(r"hand|wrist|palm|poignet|mano|muñeca|(?<![a-z])main(?![a-z])|手首")
_OTHER_SIDES = {
    "left": re.compile(r"links|gauche|izquierd|(?<![a-z])izq(?![a-z])|左"),
    "right": re.compile(r"rechts|droit|derech|(?<![a-z])der(?![a-z])|右"),
}
# parts of hands and feet, and helpers that are no joints
_PARTS = re.compile(
    r"thumb|index|middle|mid\d|ring|pinky|finger|daumen|pouce|doigt|pulgar|dedo|指|twist|roll|nub|ik|pole|ctrl|prop|end$|tip"
)
_NECK = re.compile(r"neck|head|cervic|hals|kopf|nacken|cou(?!d)|tête|cuello|cabeza|首|頭")
# Lengths below this share of the skeleton's height are none.
_SHORT = 0.01


def propose_map(mocap: Mocap, name: str) -> SkeletonMap | None:
    """Return a map to be confirmed, or None where hands, feet or sides cannot be determined from the names.

    Feet and hands are found by name, with their side. Knees, hips, elbows and shoulders are the joints above them that
    are some way off. The trunk leads from the hips to where the arms meet.

    Args:
        mocap: whose joints are to be mapped.
        name: of the map.
    """
    tree = _Tree(mocap)
    joints: dict[str, int] = {}
    for side in SIDES:
        ankle, wrist = tree.named(_ANKLE, side), tree.named(_WRIST, side)
        if ankle is None or wrist is None:
            return None
        for end, roles in ((ankle, ("ankle", "knee", "hip")), (wrist, ("wrist", "elbow", "shoulder"))):
            chain = tree.above(end)[: len(roles)]
            if len(chain) < len(roles):
                return None
            joints |= {f"{side}_{role}": joint for role, joint in zip(roles, chain, strict=True)}
        toes = [child for child in tree.below(ankle) if tree.apart(ankle, child)]
        if not toes:
            return None
        joints[f"{side}_toe"] = next((toe for toe in toes if _TOE.search(mocap.names[toe].lower())), toes[0])
    hips = tree.meeting(joints["left_hip"], joints["right_hip"])
    top = tree.meeting(joints["left_shoulder"], joints["right_shoulder"])
    if hips is None or top is None or hips not in tree.ancestors(top):
        return None
    trunk = [joint for joint in tree.ancestors(top)[::-1] if hips in tree.ancestors(joint) and joint != hips]
    spine = next((joint for joint in trunk if tree.apart(hips, joint)), None)
    arms = {joint for side in SIDES for joint in tree.ancestors(joints[f"{side}_wrist"])}
    necks = [joint for joint in tree.below(top) if joint not in arms and tree.apart(top, joint)]
    neck = next((joint for joint in necks if _NECK.search(mocap.names[joint].lower())), None)
    if spine is None or neck is None:
        return None
    joints |= {"hips": hips, "spine": spine, "chest": top, "neck": neck}
    names = {role: mocap.names[joint] for role, joint in joints.items()}
    pelvis, torso = rest_pitches(mocap, names) or (0.0, 0.0)
    return SkeletonMap(name, names, pelvis_pitch=pelvis, torso_pitch=torso)


class _Tree:
    def __init__(self, mocap: Mocap):
        self._mocap = mocap
        self._places = mocap.positions[len(mocap.positions) // 2]
        self._height = float(np.ptp(self._places, axis=0).max())

    def named(self, expression: re.Pattern[str], side: str) -> int | None:
        """Return the joint of a side that is called so and stands nearest to the root."""
        found = [
            index
            for index, name in enumerate(self._mocap.names)
            if expression.search(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower())
            and not _PARTS.search(name.lower())
            and _side(name) == side
        ]
        return min(found, key=lambda index: len(self.ancestors(index)), default=None)

    def ancestors(self, joint: int) -> list[int]:
        """Return the joint and all above it."""
        chain = [joint]
        while (parent := self._mocap.parents[chain[-1]]) >= 0:
            chain.append(parent)
        return chain

    def above(self, joint: int) -> list[int]:
        """Return the joint and those above it, each some way from the one before."""
        chain = [joint]
        for other in self.ancestors(joint)[1:]:
            if self.apart(chain[-1], other):
                chain.append(other)
        return chain

    def below(self, joint: int) -> list[int]:
        """Return all joints below one, the nearest first."""
        found = [index for index in range(len(self._mocap.names)) if joint in self.ancestors(index)[1:]]
        return sorted(found, key=lambda index: len(self.ancestors(index)))

    def meeting(self, first: int, second: int) -> int | None:
        """Return the lowest joint above both."""
        others = self.ancestors(second)
        return next((joint for joint in self.ancestors(first) if joint in others), None)

    def apart(self, first: int, second: int) -> bool:
        """Return whether two joints are some way from each other."""
        return float(np.linalg.norm(self._places[first] - self._places[second])) > _SHORT * self._height


def _side(name: str) -> str | None:
    words: Sequence[str] = tokens(re.split(r"[:|]", name)[-1])
    joined = "".join(words)
    spelled = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
    for side in SIDES:
        if _OTHER_SIDES[side].search(spelled):
            return side
        if side in words or joined.startswith(side) or joined.endswith(side):
            return side
    initial = re.match(r"([lr])(?=[A-Z_.\- ]|foot|ankle|hand|wrist)", re.split(r"[:|]", name)[-1], re.IGNORECASE)
    return None if initial is None else {"l": "left", "r": "right"}[initial[1].lower()]
