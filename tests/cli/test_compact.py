import ast
import inspect
import textwrap
from dataclasses import fields
from itertools import pairwise

import pytest

from plat.cli import COMMANDS
from plat.cli.compact import GROUPS, group_from_text, group_text
from plat.cli.settings import parse
from plat.envs import ResetNoise
from plat.envs.transforms import NoiseLevels, RandomizationRanges, Regularization, TrackingTerm
from plat.recipes.options import ExpertRecipe
from plat.recipes.presets import PRESETS
from tests.cli.settings import settings_of

REQUIRED = ["--motions", "x.npz", "--out", "x"]


@pytest.mark.parametrize("kind", GROUPS)
def test_defaults_and_every_field_come_back(kind):
    assert group_from_text(kind, group_text(kind())) == kind()
    other = -0.7 if kind is Regularization else 0.7  # in the place of 0
    defaults = {
        field.name: field.default if isinstance(field.default, tuple) else (field.default,) for field in fields(kind)
    }
    text = ",".join(
        f"{name}={':'.join(f'{0.5 * value or other}' for value in values)}" for name, values in defaults.items()
    )
    changed = group_from_text(kind, text)
    assert all(getattr(changed, field.name) != field.default for field in fields(kind))
    assert group_from_text(kind, group_text(changed)) == changed


def test_numbers_ranges_and_none():
    ranges = RandomizationRanges(push_interval=(2, 6), motor_gain=0.2)
    assert group_from_text(RandomizationRanges, "push_interval=2:6,motor-gain=.2") == ranges
    assert group_from_text(Regularization, "floor=none") == Regularization(floor=None)
    for text, friction in (("none", None), ("0.5:0.5", (0.5, 0.5))):
        ranges = group_from_text(RandomizationRanges, f"foot_friction={text}")
        assert ranges == RandomizationRanges(foot_friction=friction)
        assert group_text(ranges) == f"foot_friction={text}"


def _help(kind: type) -> dict[str, str]:
    """Help of each field of a group: the text below it."""
    (body,) = (node.body for node in ast.parse(textwrap.dedent(inspect.getsource(kind))).body)
    return {
        field.target.id: text.value.value
        for field, text in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }


@pytest.mark.parametrize("kind", GROUPS)
def test_every_field_has_help_of_one_line(kind):
    """They are no flags of their own, whose help tests/cli/test_help.py looks at."""
    told = _help(kind)
    assert [field.name for field in fields(kind) if field.name not in told] == []
    assert {name: text for name, text in told.items() if "\n" in text or len(text) > 90} == {}


@pytest.mark.parametrize(
    ("kind", "text", "message"),
    [
        (ResetNoise, "yw=1", "'yw=1': expected 'default', or NAME=NUMBER with a name of: root_pos_xy, .*yaw"),
        (ResetNoise, "yaw", "'yaw': expected 'default'"),
        (ResetNoise, "yaw=0.1,yaw=0.2", "'yaw=0.2': expected yaw once"),
        (RandomizationRanges, "push-interval=2:6,motor_gain=0.2,push_interval=2:6", "expected push_interval once"),
        (ResetNoise, "yaw=fast", "yaw=fast: expected a number"),
        (ResetNoise, "yaw=1:2", "yaw=1:2: expected a number"),
        (ResetNoise, "yaw=-1", "ResetNoise: yaw is -1.0, expected a number of at least 0"),
        (RandomizationRanges, "push_interval=6:2", r"push_interval is \(6.0, 2.0\), expected .* in ascending order"),
        (RandomizationRanges, "push_interval=2", "push_interval=2: expected 2 numbers with : in between"),
    ],
)
def test_wrong_text_is_named(kind, text, message):
    with pytest.raises(ValueError, match=message):
        group_from_text(kind, text)


def test_the_command_line_takes_them():
    flags = "--task.noise default --task.randomization motor_gain=0.2 --task.dense.joint-pos 2 .1"
    task = parse(ExpertRecipe, [*REQUIRED, *flags.split()]).task
    assert task.noise == NoiseLevels()
    assert task.randomization == RandomizationRanges(motor_gain=0.2)
    assert task.dense.joint_pos == TrackingTerm(2.0, 0.1)
    assert task.dense.anchor_pos == TrackingTerm(3.0, 0.4)  # the recipe's
    assert parse(ExpertRecipe, REQUIRED).task.noise is None
    for none in ("none", "None"):
        assert parse(ExpertRecipe, [*REQUIRED, "--task.noise", none]).task.noise is None


def test_a_wrong_name_ends_the_program():
    with pytest.raises(SystemExit, match="'yw=1': expected 'default', or .* root_pos_xy"):
        parse(ExpertRecipe, [*REQUIRED, "--task.reset-noise", "yw=1"])
    with pytest.raises(SystemExit, match="--task.noise: 'off': expected 'none', 'default', or .* joint_pos"):
        parse(ExpertRecipe, [*REQUIRED, "--task.noise", "off"])


def test_presets_leave_groups_at_their_defaults():
    # because what the command line does not name has the default of the class
    for preset in PRESETS.values():
        for stage in preset.values():
            for value in (getattr(stage["task"], field.name) for field in fields(stage["task"])):
                assert type(value) not in GROUPS or value == type(value)()


def test_stages_have_few_flags():
    # those of the commands of "plat motions" are listed together here
    flags = {name: len(settings_of(name)) for name in COMMANDS if name != "motions"}
    assert max(flags.values()) <= 82, flags
