"""Adapter of ProtoMotions' general tracker: inputs by name, action and motors."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.baselines.tracker import Tracker, tuned_robot
from plat.deploy.onnx_session import open_session
from plat.errors import CheckpointError
from plat.extras import importing
from plat.robots import G1, Robot
from plat.robots.kinematics import ForwardKinematics

__all__ = ["ProtoMotions"]

# Links of its model without a joint of their own, and the body that each is fixed to.
_FIXED = {"head": "torso_link", "left_rubber_hand": "left_wrist_yaw_link", "right_rubber_hand": "right_wrist_yaw_link"}
_SOURCES = (
    "current.dof_pos",
    "current.dof_vel",
    "current.anchor_rot",
    "current.root_local_ang_vel",
    "historical.processed_actions",
    "mimic.future_rot",
    "mimic.future_anchor_rot",
    "mimic.future_dof_pos",
    "mimic.future_dof_vel",
)


class ProtoMotions(Tracker):
    """Released general tracker of ProtoMotions for the G1 (``unified_pipeline.onnx`` and ``.yaml``).

    **Unverified**: the layout is that of the published deployment code. The adapter is tested only with networks of the
    same inputs, not with the released weights.

    The YAML file says which quantity each input is, how many frames ahead the references are, and gains. Quaternions
    are ``xyzw``. Orientations of the reference are those of all bodies of its model, or of the torso. The network
    returns joint targets. A bound on their second difference and a moving average of them follow, where the YAML file
    has them.

    Args:
        folder: holds the two files.
        robot: whose motor settings those of the YAML file replace.

    Raises:
        BundleError: when the network cannot be read.
        CheckpointError: naming file and field, when the YAML file asks for what this adapter does not have.
    """

    def __init__(self, folder: str | Path, robot: Robot = G1):
        network, described = (Path(folder) / f"unified_pipeline.{ending}" for ending in ("onnx", "yaml"))
        self._session = open_session(network)
        about = _Described(described)
        joints = tuple(name.removesuffix("_joint") for name in about.field("robot", "joint_names"))
        if joints != robot.joint_names:
            raise CheckpointError(f"{str(described)!r}: robot.joint_names are others than those of {robot.name!r}")
        stiffness, damping = (about.numbers("control", name, robot.num_joints) for name in ("stiffness", "damping"))
        effort = about.numbers("control", "effort_limits", robot.num_joints, robot.effort_limit)
        super().__init__(tuned_robot(robot, f"{robot.name}-protomotions", stiffness, damping, effort))
        self.ahead = tuple(int(step) for step in about.field("motion", "future_step_indices"))
        self.in_keys = [*self.in_keys, ("state", "keypoint_quat_w")]
        names: dict[str, str] = about.field("_runtime", "onnx_name_to_in_key")
        inputs = [entry.name for entry in self._session.get_inputs()]
        self._quantity = {name: names.get(name, name) for name in inputs}
        unknown = sorted(set(self._quantity.values()) - set(_SOURCES))
        if unknown:
            raise CheckpointError(f"{str(network)!r}: reads {unknown}, expected inputs among {list(_SOURCES)}")
        anchor = about.field("robot", "anchor_body_name", robot.anchor)
        if anchor != robot.anchor:
            raise CheckpointError(
                f"{str(described)!r}: robot.anchor_body_name is {anchor!r}, expected {robot.anchor!r}"
            )
        self._kinematics, self._rows = self._bodies(about, anchor)
        self._most_change = about.field("control", "pd_target_max_accel", None)
        self._kept = 1.0 - float(about.field("control", "action_ema_alpha", 1.0))
        outputs = [entry.name for entry in self._session.get_outputs()]
        if "joint_pos_targets" not in outputs:
            raise CheckpointError(f"{str(network)!r}: outputs {outputs}, expected joint_pos_targets among them")
        self._single = self._session.get_inputs()[0].shape[0] == 1

    def _bodies(self, about: "_Described", anchor: str) -> tuple[ForwardKinematics, list[int]]:
        """Return kinematics of the reference's bodies, and the row of each of theirs in it; the anchor is the last."""
        wanted: list[str] = [anchor]
        if "mimic.future_rot" in self._quantity.values():
            fixed = {**_FIXED, "pelvis_contour_link": "pelvis"}
            theirs = [fixed.get(name, name) for name in about.field("robot", "body_names")]
            wanted = [*theirs, anchor]
        model = self.robot.shared_model
        ours = {model.body(index).name for index in range(1, model.nbody)}
        if unknown := sorted(set(wanted) - ours):
            raise CheckpointError(f"{about.path!r}: robot.body_names has {unknown}, which {self.robot.name!r} has not")
        bodies = tuple(dict.fromkeys(wanted))
        return ForwardKinematics(self.robot, bodies), [bodies.index(name) for name in wanted]

    def targets(self, tensordict: TensorDictBase, joint_pos: Tensor, starting: Tensor) -> Tensor:
        measured, reference = tensordict["robot"], tensordict["tracker_reference"]
        _, turns = self._kinematics(reference["root_pos_w"], reference["root_quat_w"], reference["joint_pos"])
        turns = _xyzw(turns[..., self._rows, :])  # [N, F, bodies, 4]
        last = self.remembered("target", joint_pos, starting)
        quantities = {
            "current.dof_pos": joint_pos,
            "current.dof_vel": measured["joint_vel"],
            "current.anchor_rot": _xyzw(tensordict["state", "keypoint_quat_w"][:, self.robot.anchor_index]),
            "current.root_local_ang_vel": measured["root_ang_vel_b"],
            "historical.processed_actions": last[:, None],
            "mimic.future_rot": turns[..., :-1, :],
            "mimic.future_anchor_rot": turns[..., -1, :],
            "mimic.future_dof_pos": reference["joint_pos"],
            "mimic.future_dof_vel": reference["joint_vel"],
        }
        rows = {name: quantities[key].cpu().numpy().astype(np.float32) for name, key in self._quantity.items()}
        batches = [rows]
        if self._single:
            batches = [{name: value[row : row + 1] for name, value in rows.items()} for row in range(len(joint_pos))]
        results = [self._session.run(["joint_pos_targets"], batch)[0] for batch in batches]
        target = torch.from_numpy(np.concatenate(results)).to(joint_pos)
        return self._smoothed(target, starting)

    def _smoothed(self, target: Tensor, starting: Tensor) -> Tensor:
        new = starting[:, None]
        age = self.remembered("age", torch.zeros_like(target[:, :1]), starting)
        if self._most_change is not None:
            before, earlier = (self.remembered(name, target, starting) for name in ("before", "earlier"))
            change = (target - 2 * before + earlier).clamp(-self._most_change, self._most_change)
            target = torch.where(age >= 2, 2 * before - earlier + change, target)
            self.remember("earlier", before)
            self.remember("before", target)
        self.remember("age", age + 1)
        last = torch.where(new, target, self.remembered("target", target, starting))
        target = (1 - self._kept) * target + self._kept * last
        self.remember("target", target)
        return target


class _Described:
    """The YAML file beside the network."""

    def __init__(self, path: Path):
        self.path = str(path)
        with importing("baselines", f"{self.path!r}: reading settings needs", CheckpointError):
            import yaml
        try:
            self._content = yaml.safe_load(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise CheckpointError(f"{self.path!r}: not a readable YAML file ({error})") from error

    def field(self, group: str, name: str, *default: Any) -> Any:
        """Return a field of a group, or a default."""
        part = self._content.get(group) if isinstance(self._content, dict) else None
        if not isinstance(part, dict) or (name not in part and not default):
            raise CheckpointError(f"{self.path!r}: no {group}.{name}, expected what ProtoMotions exports")
        value = part.get(name)
        return default[0] if value is None and default else value

    def numbers(self, group: str, name: str, count: int, *default: Tensor) -> Tensor:
        """Return a field of so many numbers."""
        value = self.field(group, name, *default)
        tensor = torch.as_tensor(value, dtype=torch.float32)
        if tensor.shape != (count,):
            raise CheckpointError(f"{self.path!r}: {group}.{name} has {tensor.numel()} numbers, expected {count}")
        return tensor


def _xyzw(quat: Tensor) -> Tensor:
    return quat.roll(-1, -1)
