"""Panel of keyframe files and videos."""

from pathlib import Path

import viser

from plat.errors import StudioError
from plat.keyframes.splits import unit_doubt
from plat.studio.autosave import AUTOSAVE, Autosave
from plat.studio.desk import Task
from plat.studio.folder import Folder, mark_of
from plat.studio.page import Page
from plat.studio.timeline import Timeline
from plat.words import counted

__all__ = ["FilePanel"]


class FilePanel:
    """Panel that saves and loads keyframes in one folder of the studio's machine, and to and from the browser's.

    Args:
        page: the page.
        path: initial text of the file box.
        folder: folder of the files.
        autosave: keeps unsaved keyframes.
    """

    def __init__(self, page: Page, path: str, folder: Folder, autosave: Autosave):
        self._page, self._folder, session, gui = page, folder, page.session, page.gui
        self._autosave = autosave
        self._own: tuple[Path, object] | None = None  # the file that was written or read last, and of which keyframes
        self._left: object = None  # as what it was left
        if session.opened is not None and session.opened == self._in_folder(path):
            self._owns(session.opened)
        self._path = gui.add_text("File", path, hint=f"In {folder.root}, on the machine that the studio runs on.")
        page.buttons("", {"Save": self.save, "Load": self._load, "New": session.new})
        gui.add_markdown(f"Folder: `{folder.root}`")
        self._restore_button = page.button(
            "Restore autosave", self._restore, icon=viser.Icon.HISTORY, visible=autosave.former is not None
        )
        download = gui.add_button("Download", icon=viser.Icon.DOWNLOAD)
        upload = gui.add_upload_button("Upload", icon=viser.Icon.UPLOAD, mime_type="application/json")

        with gui.add_folder("Video of the policy that is chosen"):
            self._video = gui.add_text("Video file", str(Path(path).with_suffix(".mp4")))
            self._record_button = gui.add_button(
                "Record", icon=viser.Icon.VIDEO, hint="May take a minute without a GPU."
            )
        page.when_changed(self._path)

        async def download_clicked(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            client = event.client
            if client is not None:
                page.desk.ask(lambda: client.send_file_download(self._download_name, session.to_json()))

        async def uploaded(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            file = event.target.value
            page.desk.ask(lambda: self._upload(file.name, file.content))

        async def record_clicked(_: object) -> None:
            page.desk.ask(self._ask_to_record)

        self._record_button.on_click(record_clicked)
        download.on_click(download_clicked)
        upload.on_upload(uploaded)

    @property
    def _download_name(self) -> str:
        """Return the name of the file in the box, which need not be in the folder."""
        return (Path(self._path.value).name.removesuffix(".json") or "keyframes") + ".json"

    def _in_folder(self, name: str) -> Path | None:
        """Return the path of a keyframe file of the folder; None for a name that is none."""
        try:
            return self._folder.file(name, ".json")
        except StudioError:
            return None

    def _owns(self, path: Path) -> None:
        """Keep in mind that a file holds the keyframes as they are now."""
        self._own, self._left = (path, self._page.session.timeline.origin), mark_of(path)

    def _is_own(self, path: Path | None) -> bool:
        """Return whether a file is the one that was written or read last, of the keyframes that there are."""
        return self._own == (path, self._page.session.timeline.origin)

    def save(self) -> None:
        """Save to the file in the box.

        A file of other keyframes, or one that something else has written since, is only replaced when the user agrees.
        """
        path = self._folder.file(self._path.value, ".json")

        def save() -> None:
            self._page.session.save(path)
            self._owns(path)
            self._autosave.discard()
            self._page.notify("Saved", str(path), "good")

        own = self._is_own(path)
        if own and self._left == mark_of(path):
            save()
        else:
            self._once_agreed(path, save, "was changed by something else since" if own else "is there already")

    def _load(self) -> None:
        path = self._folder.file(self._path.value, ".json")
        self._loaded(self._path.value, lambda: self._page.session.load(path))
        self._owns(path)

    def _upload(self, name: str, content: bytes) -> None:
        self._loaded(name, lambda: self._page.session.from_json(name, content))

    def _restore(self) -> None:
        content = self._autosave.former
        if content is None:
            return
        self._upload(AUTOSAVE, content)
        self._page.session.saved = Timeline.empty(self._page.session.robot)  # it is in no file of the user's
        self._autosave.take_over()
        self._restore_button.visible = False

    def show(self) -> None:
        """Update the line about the file: the one in the box holds the keyframes, or they are not saved."""
        session = self._page.session
        elsewhere = not self._is_own(self._in_folder(self._path.value))
        state = {
            "name": Path(self._path.value).name,
            "unsaved": session.unsaved or (bool(session.timeline.keyframes) and elsewhere),
            "restorable": self._restore_button.visible,
        }
        self._page.dock.show("file", {**state, "autosave": self._autosave.words})

    def _ask_to_record(self) -> None:
        path = self._folder.file(self._video.value, ".mp4")
        self._folder.check_writable(path)
        self._once_agreed(path, lambda: self._start_to_record(path))

    def _start_to_record(self, path: Path) -> None:
        policy = self._page.session.playback.policy
        self._page.start(lambda: self._record(path), f"Recording {policy} …", self._record_button)

    def _record(self, path: Path) -> Task:
        session = self._page.session
        ended = session.record(session.timeline, session.playback.policy, path)
        told, kind = (f"; {ended}", "error") if ended else ("", "good")
        return lambda: self._page.notify("Video", f"written to {path}{told}", kind)

    def _once_agreed(self, path: Path, write: Task, what: str = "is there already") -> None:
        """Write at once where nothing is replaced; otherwise ask the user first."""
        if not self._folder.taken(path):
            write()
            return
        self._page.ask("Replace the file?", f"{path} {what}.", "Replace", write)

    def _loaded(self, name: str, load: Task) -> None:
        load()
        keyframes = self._page.session.timeline.keyframes
        doubt = unit_doubt(keyframes)
        told, kind = (f"; {doubt}", "error") if doubt else ("", "good")
        self._page.notify("Loaded", f"{name}: {counted(len(keyframes), 'keyframe')}{told}", kind)
