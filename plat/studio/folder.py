"""Folder of the studio: file access limited to one folder and to the studio's own kinds of files."""

import stat
from pathlib import Path

from plat.errors import StudioError
from plat.files import expand_home, replace_file
from plat.keyframes.files import is_keyframe_file

__all__ = ["Folder", "mark_of"]


class Folder:
    """Folder that resolves names typed into the page to its own files.

    Args:
        root: the folder.

    Raises:
        StudioError: when it is no folder.
    """

    def __init__(self, root: Path):
        self.root = expand_home(root).resolve()
        if not self.root.is_dir():
            raise StudioError(f"folder {str(root)!r}: no such folder, expected one for keyframes and videos")

    def file(self, name: str, suffix: str) -> Path:
        """Return the path of a file to read or write.

        Args:
            name: as typed: relative to the folder, or a path inside it.
            suffix: that it must have, such as ``".json"``.

        Raises:
            StudioError: when the name is outside the folder, of another kind, behind a link, or no regular file.
        """
        label = f"file {name!r}"
        if not name.strip() or "\0" in name:
            raise StudioError(f"{label}: no file name, expected one that ends in {suffix}")
        path = self.root / expand_home(Path(name))
        if path.suffix.lower() != suffix:
            raise StudioError(f"{label}: ends in {path.suffix!r}, expected {suffix!r}")
        # what the name resolves to is compared with the name itself: a difference is a link or a way out by ..
        if not path.resolve().is_relative_to(self.root):
            raise StudioError(f"{label}: outside {str(self.root)!r}; start the studio with another --folder")
        try:
            mode = path.lstat().st_mode
        except FileNotFoundError:
            return path
        except OSError as error:
            raise StudioError(f"{label}: cannot be looked at ({error})") from error
        if not stat.S_ISREG(mode):
            raise StudioError(f"{label}: a link, folder or device, expected a regular file")
        return path

    def taken(self, path: Path) -> bool:
        """Return whether writing to a path of :meth:`file` would replace something.

        Raises:
            StudioError: when a JSON file is there that holds no keyframes: it is not the studio's to replace.
        """
        if not path.exists():
            return False
        if path.suffix.lower() == ".json" and not is_keyframe_file(path):
            raise StudioError(f"file {str(path)!r}: holds no keyframes, so it is not replaced; choose another name")
        return True

    def check_writable(self, path: Path) -> None:
        """Check, before the work, that a file can be written.

        Raises:
            StudioError: when it cannot.
        """
        probe = path.with_name(f".{path.name}.probe")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(probe, lambda part: part.write_bytes(b""))
            probe.unlink()
        except OSError as error:
            raise StudioError(f"file {str(path)!r} cannot be written ({error.strerror or error})") from error


def mark_of(path: Path) -> tuple[int, ...] | None:
    """Return what changes when a regular file is written again, the time first; None where there is none."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return (found.st_mtime_ns, found.st_ino, found.st_size) if stat.S_ISREG(found.st_mode) else None
