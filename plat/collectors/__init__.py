"""Data collection for DAgger on TorchRL's collectors and replay buffers."""

from plat.collectors.dagger import LOOKUP_KEYS, ExpertLabels, MixedPolicy, dagger_buffer
from plat.collectors.goals import PrivilegedGoals, strided_offsets

__all__ = ["LOOKUP_KEYS", "ExpertLabels", "MixedPolicy", "PrivilegedGoals", "dagger_buffer", "strided_offsets"]
