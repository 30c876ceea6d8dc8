"""Panel of keyframe files and videos."""

from pathlib import Path

import viser

from plat.studio.desk import Task
from plat.studio.folder import Folder
from plat.studio.page import Page

__all__ = ["FilePanel"]


class FilePanel:
    """Panel that saves and loads keyframes in one folder of the studio's machine, and to and from the browser's.

    Args:
        page: the page.
        path: initial text of the file box.
        folder: folder of the files.
    """

    def __init__(self, page: Page, path: str, folder: Folder):
        self._page, self._folder, session, gui = page, folder, page.session, page.gui
        self._path = gui.add_text("File", path, hint=f"In {folder.root}, on the machine that the studio runs on.")
        page.buttons("", {"Save": self._save, "Load": self._load})
        gui.add_markdown(f"Folder: `{folder.root}`")
        download = gui.add_button("Download", icon=viser.Icon.DOWNLOAD)
        upload = gui.add_upload_button("Upload", icon=viser.Icon.UPLOAD, mime_type="application/json")

        with gui.add_folder("Video of the policy that is chosen"):
            self._video = gui.add_text("Video file", str(Path(path).with_suffix(".mp4")))
            self._record_button = gui.add_button(
                "Record", icon=viser.Icon.VIDEO, hint="May take a minute without a GPU."
            )

        async def download_clicked(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            client = event.client
            if client is not None:
                page.desk.ask(lambda: client.send_file_download("keyframes.json", session.to_json()))

        async def uploaded(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            file = event.target.value
            page.desk.ask(lambda: self._loaded(file.name, session.from_json(file.name, file.content)))

        async def record_clicked(_: object) -> None:
            page.desk.ask(self._ask_to_record)

        self._record_button.on_click(record_clicked)
        download.on_click(download_clicked)
        upload.on_upload(uploaded)

    def _save(self) -> None:
        path = self._folder.file(self._path.value, ".json")

        def save() -> None:
            self._page.session.save(path)
            self._page.notify("Saved", str(path), "green")

        self._once_agreed(path, save)

    def _load(self) -> None:
        path = self._folder.file(self._path.value, ".json")
        self._loaded(self._path.value, self._page.session.load(path))

    def _ask_to_record(self) -> None:
        path = self._folder.file(self._video.value, ".mp4")
        self._folder.check_writable(path)
        self._once_agreed(path, lambda: self._start_to_record(path))

    def _start_to_record(self, path: Path) -> None:
        if self._record_button.disabled:
            return
        self._record_button.disabled = True
        self._page.notify("Video", f"{self._page.session.policy} is being recorded")
        self._page.desk.ask_elsewhere(lambda: self._record(path))

    def _record(self, path: Path) -> Task:
        session = self._page.session
        try:
            session.record(session.timeline, session.policy, path)
        finally:
            self._record_button.disabled = False
        return lambda: self._page.notify("Video", f"written to {path}", "green")

    def _once_agreed(self, path: Path, write: Task) -> None:
        """Write at once where nothing is replaced; otherwise ask the user first."""
        if not self._folder.taken(path):
            write()
            return
        gui = self._page.gui
        modal = gui.add_modal("Replace the file?")
        with modal:
            gui.add_markdown(f"`{path}` is there already.")
            replace, cancel = gui.add_button("Replace", color="red"), gui.add_button("Cancel")

        async def replaced(_: object) -> None:
            modal.close()
            self._page.desk.ask(write)

        async def cancelled(_: object) -> None:
            modal.close()

        replace.on_click(replaced)
        cancel.on_click(cancelled)

    def _loaded(self, name: str, added: int) -> None:
        count = len(self._page.session.timeline.keyframes)
        split = f", {added} of them added between keyframes that were too far apart" if added else ""
        self._page.notify("Loaded", f"{name}: {count} keyframes{split}", "green")
