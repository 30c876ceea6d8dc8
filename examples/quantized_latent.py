"""Another latent in stage 2: finite scalar quantization in place of a Gaussian.

python examples/quantized_latent.py
"""

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from plat.modules import LatentPolicy
from plat.objectives import LatentImitationLoss
from plat.robots import G1


class Quantized(nn.Module):
    """Values -1, 0 and 1, with straight-through gradients."""

    def __init__(self, size: int):
        super().__init__()
        self.linear = nn.LazyLinear(size)

    def forward(self, *features: Tensor) -> Tensor:
        value = self.linear(torch.cat(features, -1)).tanh()
        return value + (value.round() - value).detach()


student = LatentPolicy(
    G1,
    prior=TensorDictModule(Quantized(32), ["hidden"], [("prior", "code")]),
    posterior=TensorDictModule(Quantized(32), ["hidden", "goal_code"], [("posterior", "code")]),
    sample=lambda group: TensorDictModule(nn.Identity(), [(group, "code")], [(group, "latent")]),
    mode=("prior", "code"),
)
loss = LatentImitationLoss(student.training_graph(), divergence=nn.MSELoss(reduction="none"), parameters=("code",))

print(loss.out_keys)
