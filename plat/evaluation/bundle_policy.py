"""Exported policies in batched environments: the ONNX network of a bundle."""

from pathlib import Path

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase

from plat.deploy import PolicyRunner
from plat.deploy.bundle import INPUT, OUTPUT
from plat.deploy.onnx_session import open_session
from plat.deploy.runner import NETWORK_FILE
from plat.errors import BundleError
from plat.robots.robot import Robot

__all__ = ["BundlePolicy"]


class BundlePolicy(TensorDictModuleBase):
    """Policy of a bundle: reads the entries that its network observes, and writes ``action``.

    Args:
        bundle: folder that ``plat export`` wrote, or the ``.onnx`` file alone.
        robot: that it drives.

    Raises:
        BundleError: when the bundle cannot be used, or is of a robot with other joints or motor settings.
    """

    def __init__(self, bundle: str | Path, robot: Robot):
        super().__init__()
        path = Path(bundle)
        runner = PolicyRunner(path, robot.joint_names)
        about = runner.robot
        # the environment makes targets of actions by the robot's own pose and scale
        for name in ("stiffness", "damping", "effort_limit", "default_joint_pos", "action_scale"):
            if not np.allclose(getattr(about, name), getattr(robot, name).numpy(), rtol=1e-3):
                raise BundleError(f"bundle {str(path)!r}: its {name} is not that of robot {robot.name!r}")
        if about.keypoints != robot.keypoints:
            raise BundleError(f"bundle {str(path)!r}: its keypoints are not those of robot {robot.name!r}")
        self.timing = runner.timing
        self.in_keys = [tuple(term.name.split(".")) for term in runner.bundle.terms]
        self.out_keys = ["action"]
        self._default = torch.as_tensor(about.default_joint_pos, dtype=torch.float32)
        self._scale = torch.as_tensor(about.action_scale, dtype=torch.float32)
        self._session = open_session(path if path.suffix == ".onnx" else path / NETWORK_FILE)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ``action`` ``[*B, J]``."""
        observation = torch.cat([tensordict[key] for key in self.in_keys], -1)
        rows = observation.reshape(-1, observation.shape[-1])  # the network's batch has one dimension
        target = np.empty((0, len(self._default)), np.float32)
        if len(rows):
            (target,) = self._session.run([OUTPUT], {INPUT: rows.cpu().numpy().astype(np.float32)})
        action = (torch.from_numpy(target) - self._default) / self._scale
        return tensordict.set("action", action.view(*observation.shape[:-1], len(self._default)).to(observation))
