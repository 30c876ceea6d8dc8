"""Going on from a trained policy: in what shape, and for which robot."""

from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from typing import Any

from plat.robots import Robot
from plat.runs import same_robot


def in_shape_of(init: Any, policy: Any, default: Any, trained: Any, kept: tuple[str, ...] = ()) -> Any:
    """Return the settings of a policy that goes on from a trained one, and print in what they differ.

    Args:
        init: the run that holds the trained one.
        policy: settings of the recipe.
        default: those of a recipe to which none were given: then they are the trained one's.
        trained: settings of the trained one.
        kept: settings that are the trained one's as well where others were given, but not these: with other ones it
            would act otherwise from the start.
    """
    if policy == default:
        shape = with_values(policy, vars(trained))
        ours, theirs = asdict(default), asdict(shape)
        told = [f"{name} {theirs[name]}" for name in ours if ours[name] != theirs[name]]
        words = "goes on in its shape: "
    else:
        own = {name: getattr(trained, name) for name in kept if getattr(policy, name) == getattr(default, name)}
        shape = replace(policy, **own)
        ours, theirs = asdict(shape), asdict(trained)
        differing = [name for name in theirs if name in ours and ours[name] != theirs[name]]
        told = [f"{name} {ours[name]} in place of {theirs[name]}" for name in differing]
        words = "goes on with "
    if told:
        print(f"--init {str(init)!r} {words}{', '.join(told)}")
    return shape


def with_values(config: Any, values: Mapping[str, Any]) -> Any:
    """Return a config with those values that it has a field for: one of another class may have more."""
    return replace(config, **{field.name: values[field.name] for field in fields(config) if field.name in values})


def tell_robot(init: Any, trained: Robot, robot: Robot) -> None:
    """Print that a policy goes on with another robot, if it does."""
    if not same_robot(trained, robot):
        print(f"--init {str(init)!r} drove robot {trained.name!r}, and goes on with {robot.name!r}")
