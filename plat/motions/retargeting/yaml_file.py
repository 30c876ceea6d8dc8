"""YAML files of unknown origin, read with limits and one-line errors."""

from pathlib import Path
from typing import Any

from plat.errors import MotionError
from plat.extras import importing
from plat.json_file import short

__all__ = ["read_yaml"]

MAX_BYTES = 64 << 10
"""Largest file that is read: a skeleton map takes a kilobyte."""


def read_yaml(path: Path, label: str) -> Any:
    """Return the content of a YAML file: objects, lists, and texts for everything else.

    The usual YAML reader for Python expands references, of which a few lines make a billion. It also takes the last of
    two equal names, and converts dates and numbers. Here these are texts or errors.

    Args:
        path: the file.
        label: how messages begin.

    Raises:
        MotionError: in one line, for a file that is missing, too large, or not such YAML; when PyYAML is not
            installed.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "a.yaml").write_text("{joints: {hips: Hips}, up: z}")
    ...     read_yaml(Path(folder, "a.yaml"), "example")
    {'joints': {'hips': 'Hips'}, 'up': 'z'}
    """
    with importing("retarget", "retargeting needs", MotionError):
        import yaml

    class Loader(yaml.BaseLoader):
        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.events.AliasEvent):
                raise MotionError(f"{label}: has a reference (*name), expected plain values")
            return super().compose_node(parent, index)

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            names = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
            if len(set(names)) != len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise MotionError(f"{label}: field {short(twice)} comes twice in one object")
            return super().construct_mapping(node, deep)

    try:
        if not path.is_file():
            raise MotionError(f"{label}: {'not a regular file' if path.exists() else 'no such file'}")
        if path.stat().st_size > MAX_BYTES:
            raise MotionError(f"{label}: {path.stat().st_size / 1e3:.0f} KB, expected at most {MAX_BYTES >> 10} KB")
        return yaml.load(path.read_text(encoding="utf-8-sig"), Loader)
    except OSError as error:
        raise MotionError(f"{label}: cannot be read ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise MotionError(f"{label}: not a readable YAML file (byte {error.start} is no UTF-8)") from None
    except yaml.YAMLError as error:
        where = getattr(error, "problem_mark", None)
        place = f"line {where.line + 1}, column {where.column + 1}: " if where else ""
        problem = getattr(error, "problem", None) or type(error).__name__
        raise MotionError(f"{label}: not a readable YAML file ({place}{short(problem)})") from None
    except RecursionError:
        raise MotionError(f"{label}: not a readable YAML file (nested too deeply)") from None
