"""Old import paths of modules that have moved: they work for one more minor version, with a warning.

An alias is the new module itself, so classes are the same objects under both names.
"""

import importlib
import importlib.abc
import importlib.machinery
import sys
import warnings
from collections.abc import Sequence
from types import ModuleType

__all__ = ["MOVED", "MOVED_NAMES", "install", "moved_name"]

_OF_0_1 = {
    "plat.envs.layout": "plat.spec.observation",
    "plat.envs.motions.feet": "plat.motions.checks.feet",
    "plat.envs.motions.collision": "plat.motions.checks.collision",
    "plat.envs.motions.repair": "plat.motions.checks.repair",
    "plat.envs.motions.validation": "plat.motions.checks.validation",
    "plat.envs.motions.retargeting.split": "plat.motions.split",
    "plat.envs.motions.generation.score": "plat.motions.generation.script",
    "plat.envs.motions": "plat.motions",
    "plat.envs.robot": "plat.robots",
    "plat.envs.kinematics": "plat.robots.kinematics",
    "plat.modules.expert": "plat.modules.policies.expert",
    "plat.modules.imitation": "plat.modules.policies.student",
    "plat.modules.refinement": "plat.modules.policies.refinement",
    "plat.baselines.reference": "plat.baselines.tracker_reference",
    "plat.evaluation.table": "plat.evaluation.score_table",
    "plat.evaluation.runner": "plat.evaluation.scoring",
    "plat.playing.errors": "plat.control.pose_errors",
    "plat.playing": "plat.control",
    "plat.export.robot": "plat.robots.describe",
    "plat.deploy.session": "plat.deploy.onnx_session",
    "plat.training.saving": "plat.runs.saved_run",
    "plat.training": "plat.runs",
    "plat.rendering.bars": "plat.figures.bars",
    "plat.rendering.figures": "plat.figures.pyplot",
    "plat.rendering.strip": "plat.figures.film_strip",
    "plat.rendering.viewer": "plat.control.viewer",
    "plat.rendering.radar": "plat.figures.radar",
    "plat.rendering.style": "plat.figures.style",
    "plat.rendering.success": "plat.figures.success",
    "plat.objectives.precision": "plat.precision",
}
_OF_0_2 = {
    "plat.envs.transforms.metrics": "plat.envs.transforms.tracking_errors",
    "plat.motions.formats.names": "plat.motions.formats.spellings",
    "plat.motions.formats.table": "plat.motions.formats.text_tables",
    "plat.motions.generation.balance": "plat.motions.generation.zero_moment_point",
    "plat.motions.generation.curves": "plat.motions.generation.interpolation",
    "plat.motions.retargeting.axes": "plat.motions.retargeting.capture_axes",
    "plat.motions.retargeting.feet": "plat.motions.retargeting.planted_feet",
    "plat.motions.retargeting.solver": "plat.motions.retargeting.inverse_kinematics",
    "plat.spec.page": "plat.spec.observation_page",
}
MOVED = {**_OF_0_1, **_OF_0_2}
"""Where modules of versions 0.1 and 0.2 are now; what lies below a package has moved with it."""


MOVED_NAMES = {
    "plat.rendering": {
        "Viewer": "plat.control",
        "record": "plat.control",
        "play": "plat.evaluation",
        **dict.fromkeys(
            ("ablation_bars", "film_strip", "pyplot", "radar_plot", "save_figure", "success_plot"), "plat.figures"
        ),
    },
}
"""Names of version 0.1 that are in another package now, by the package that had them."""


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        new = _new_name(name)
        return None if new is None else importlib.machinery.ModuleSpec(name, self, origin=new, is_package=True)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        assert spec.origin is not None
        removed_in = "0.4" if spec.name in _OF_0_2 else "0.3"
        message = f"{spec.name} is now {spec.origin}; the old name is removed in version {removed_in}"
        warnings.warn(message, FutureWarning, stacklevel=2)
        module = importlib.import_module(spec.origin)
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        # it has run under its new name; the import machinery has only put the alias's spec in place of its own
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state


def _new_name(name: str) -> str | None:
    for old, new in MOVED.items():
        if name == old or name.startswith(f"{old}."):
            found = new + name.removeprefix(old)
            return _new_name(found) or found  # what moved twice is told where it is, not where it was
    return None


def moved_name(package: str, name: str) -> object:
    """Return what a package had under a name, with a warning; for the ``__getattr__`` of that package.

    Raises:
        AttributeError: for a name that it never had.
    """
    if name not in MOVED_NAMES[package]:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    new = MOVED_NAMES[package][name]
    warnings.warn(f"{package}.{name} is now {new}.{name}; the old name is removed in version 0.3", FutureWarning, 3)
    return getattr(importlib.import_module(new), name)


def install() -> None:
    """Let the old names be imported. Does nothing the second time."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        # ahead of the path finder, which would run a submodule a second time under its old name
        sys.meta_path.insert(0, _Finder())
