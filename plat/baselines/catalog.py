"""Catalog of released trackers: whose they are, which file, under which license, and how to get it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from plat.errors import CheckpointError

if TYPE_CHECKING:
    from plat.baselines.tracker import Tracker

__all__ = ["CATALOG", "Baseline", "identify", "sha256"]


@dataclass(frozen=True)
class Baseline:
    """Released tracker that plat can run. Its files are its owner's, and plat does not ship them.

    Attributes:
        name: in tables.
        flag: of the command line: ``--trackers.FLAG``.
        owner: who released it.
        version: of the weights.
        license: that they are under.
        get: how to get them.
        files: their names, each with its SHA-256 where that is known; several make a folder.
        adapter: module and class.
        tested: whether the adapter was run with the released file; otherwise only with networks of its shapes.
    """

    name: str
    flag: str
    owner: str
    version: str
    license: str
    get: str
    files: Mapping[str, str | None] = field(hash=False)
    adapter: tuple[str, str]
    tested: bool

    @property
    def is_folder(self) -> bool:
        """Return whether its path is a folder."""
        return len(self.files) > 1

    def paths(self, path: Path) -> list[Path]:
        """Return the files at a path: itself, or those of a folder."""
        return [path / name for name in self.files] if self.is_folder else [path]

    def load(self, path: Path) -> Tracker:
        """Load the tracker.

        Raises:
            BundleError: when a file cannot be read.
            CheckpointError: when it is the file of another tracker, or another network.
        """
        for file, (name, known) in zip(self.paths(path), self.files.items(), strict=True):
            if not file.is_file():
                continue  # the adapter says so
            found = identify(file)
            if found is not None and found.name != self.name:
                raise CheckpointError(
                    f"{str(file)!r} is {found.name}'s {found.version}, expected {self.name}'s {name}: --trackers."
                    f"{found.flag} takes it"
                )
            if known is not None and found is None:
                print(f"{self.name}: {str(file)!r} is not the released {name} (its SHA-256 is another); used as it is")
        module, kind = self.adapter
        tracker: Tracker = getattr(import_module(module), kind)(path)
        return tracker

    def described(self) -> str:
        """Return what is known of it, a fact per line."""
        hashes = [f"  {name}: {known or 'SHA-256 not known'}" for name, known in self.files.items()]
        tested = "with the released file" if self.tested else "with stand-in networks of its shapes only: unverified"
        lines = [
            f"{self.name}  (--trackers.{self.flag})",
            f"  owner    {self.owner}",
            f"  version  {self.version}",
            f"  license  {self.license}",
            f"  get      {self.get}",
            f"  tested   {tested}",
            *hashes,
        ]
        return "\n".join(lines)


_TRACKERS = (
    Baseline(
        "SONIC",
        "sonic",
        "NVIDIA (NVlabs/GR00T-WholeBodyControl)",
        "first release of GEAR-SONIC, encoder of 1762 inputs",
        "NVIDIA Open Model License",
        "huggingface.co/nvidia/GEAR-SONIC, the two files at the top",
        {"model_encoder.onnx": None, "model_decoder.onnx": None},
        ("plat.baselines.sonic", "Sonic"),
        tested=False,
    ),
    Baseline(
        "SONIC 1.1",
        "sonic-1-1",
        "NVIDIA (NVlabs/GR00T-WholeBodyControl)",
        "v1.1 of July 2026, encoder of 1751 inputs",
        "NVIDIA Open Model License",
        "huggingface.co/nvidia/GEAR-SONIC, the two files in sonic_v1_1",
        {"model_encoder.onnx": None, "model_decoder.onnx": None},
        ("plat.baselines.sonic", "Sonic11"),
        tested=False,
    ),
    Baseline(
        "ProtoMotions",
        "protomotions",
        "NVIDIA (NVlabs/ProtoMotions)",
        "general tracker of the G1 of August 2026, trained on BONES-SEED",
        "Apache-2.0",
        "github.com/NVlabs/ProtoMotions, data/pretrained_models/motion_tracker/g1-bones-deploy (git lfs)",
        {
            "unified_pipeline.onnx": "a59baa3e04a951e5cf0b4cc68f24ebaafa9272714226618b99a5017dfc805b4c",
            "unified_pipeline.yaml": "9b7896f3355a9d9d5e7d3139b83924eeb2e45c62c30bfda44afe996cfc6cf01c",
        },
        ("plat.baselines.protomotions", "ProtoMotions"),
        tested=False,
    ),
    Baseline(
        "TWIST2",
        "twist2",
        "Yanjie Ze and others (amazon-far/TWIST2)",
        "twist2_1017_20k",
        "MIT",
        "github.com/amazon-far/TWIST2, assets/ckpts/twist2_1017_20k.onnx",
        {"twist2_1017_20k.onnx": "2d1fb3a31e4e967f70ecfefc3ad1e7b2ac491677068b89f60b565a94e7735061"},
        ("plat.baselines.twist2", "Twist2"),
        tested=True,
    ),
    Baseline(
        "wbc",
        "wbc",
        "wbc-mjlab (wbc-mjlab/wbc-g1-deploy)",
        "general one-frame tracker, policy_066ab15",
        "Apache-2.0",
        "github.com/wbc-mjlab/wbc-g1-deploy at commit 066ab15, config/policy/wbc/params/policy.onnx",
        {"policy_066ab15.onnx": "48fdb6ea7181a475116f929fe8cfdcaba86272532d4d94c7753ead1bfb467215"},
        ("plat.baselines.wbc", "Wbc"),
        tested=True,
    ),
    Baseline(
        "YAHMP",
        "yahmp",
        "Fabio Amadio (fabio-amadio/yahmp)",
        "0.1.0, g1_yahmp of May 2026",
        "Apache-2.0",
        "github.com/fabio-amadio/yahmp at commit 2111a99, assets/models/g1_yahmp.onnx",
        {"g1_yahmp.onnx": "59f02e2aa6408a006f6af672b78b71858f32c234756e3fb47a98c1e1a77861f6"},
        ("plat.baselines.yahmp", "Yahmp"),
        tested=True,
    ),
)
CATALOG: Mapping[str, Baseline] = MappingProxyType({baseline.name: baseline for baseline in _TRACKERS})
"""Released trackers by name, in the order of tables."""


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def identify(path: Path) -> Baseline | None:
    """Return the baseline whose released file this is, by its SHA-256; None for any other file.

    >>> import tempfile
    >>> with tempfile.NamedTemporaryFile() as file:
    ...     print(identify(Path(file.name)))
    None
    """
    found = sha256(path)
    return next((baseline for baseline in CATALOG.values() if found in baseline.files.values()), None)
