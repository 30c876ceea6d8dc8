"""Documentation page of the observation: ``python -m plat.spec.observation_page docs/observation.md`` writes it."""

import sys
from pathlib import Path

from plat.files import replace_file
from plat.spec.observation import OPTIONAL_GROUPS, STUDENT_GROUPS, Entry, table

__all__ = ["observation_page"]

_OPENING = """\
# What a policy observes

*This page is made from the table in `plat/spec/observation.py` by
`python -m plat.spec.observation_page docs/observation.md`.*

A deployed policy observes its own state, one keyframe and the time left:
`o_t = [robot, goal, command]`, side by side in the order below. *J* is the number of joints and
*K* the number of keypoint bodies. The columns are those of the G1 (*J* = {joints}, *K* = {bodies}),
{size} in all.
"""
_GROUPS = {
    "robot": "The robot's own state. All of it is measured or estimated on the robot.",
    "goal": (
        "The commanded keyframe in the frame of the robot's root: turning or moving robot and keyframe\n"
        "together changes nothing. The last column names the part of a keyframe that an entry belongs to."
    ),
    "command": (
        "`tau` is the number of control steps until the keyframe, divided by `Timing.max_steps` of the\npolicy."
    ),
    "parts": (
        "What the keyframe commands: entries of the goal that it does not command are 0. Horizontal\n"
        "position and height of the root are made 0 in the world, before they are turned into its frame.\n"
        "Only policies trained with `--policy.also parts` observe this group; others are given whole\n"
        "keyframes alone."
    ),
    "clock": (
        "The end of the time to the keyframe, on a finer scale than `tau`. Only policies trained with\n"
        "`--policy.also clock` observe it. A policy that observes one of the two groups has it right\n"
        "after `command`."
    ),
    "privileged": "Only a critic observes these, in training.",
}
_CLOSING = """\
Other goal groups have the entries of `goal`. `goal_6` is the reference six frames ahead.
`dense_goal` and `dense_goal_6` are the same beside a keyframe, and `keyframe` is a keyframe beside
a dense goal. `led_...` is any of them moved ahead by a lead (`plat.modules.GoalLead`).
`plat.spec.observation.is_goal` says which names are goals.

To add an entry to the goal, add it to the table, and add the function that computes it to
`GOAL_ENTRIES` in `plat/envs/goals.py` (torch) and in `plat/deploy/goals.py` (numpy). Environment,
networks, gymnasium and exports follow. Weights that were trained before do not fit the new size. A
policy that is `symmetric` asks what becomes of it in the mirror (`Entry.mirrored`).
"""


def observation_page(num_joints: int, num_keypoints: int) -> str:
    """Return the page in Markdown, with the columns that a robot of these sizes has."""
    sections, start = [], 0
    for group, text in _GROUPS.items():
        rows = []
        for entry in table().entries(group):
            stop = start + entry.width(num_joints, num_keypoints)
            observed = group in (*STUDENT_GROUPS, *OPTIONAL_GROUPS)
            rows.append(_row(entry, f"{start}:{stop}" if observed else "-"))
            start = stop if observed else start
        head = "| entry | width | columns | unit | frame | scale | commanded by |\n|---|---|---|---|---|---|---|\n"
        sections.append(f"## `{group}`\n\n{text}\n\n{head}" + "".join(rows))
    size = sum(entry.width(num_joints, num_keypoints) for group in STUDENT_GROUPS for entry in table().entries(group))
    opening = _OPENING.format(joints=num_joints, bodies=num_keypoints, size=size)
    return "\n".join([opening, *sections, _CLOSING])


def _row(entry: Entry, columns: str) -> str:
    parts = [(entry.size, ""), (entry.per_joint, "J"), (entry.per_body, "K")]
    width = " + ".join(name if name and count == 1 else f"{count} {name}".strip() for count, name in parts if count)
    cells = [f"`{entry.name}`", width, columns, entry.unit, entry.frame, f"{entry.scale:g}", entry.commanded_by or "-"]
    return f"| {' | '.join(cells)} |\n"


if __name__ == "__main__":
    text = observation_page(num_joints=29, num_keypoints=14)
    replace_file(Path(sys.argv[1]), lambda part: part.write_text(text, encoding="utf-8"))
