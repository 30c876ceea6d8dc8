"""Keyframe files, and videos."""

from pathlib import Path

import viser

from plat.studio.desk import Task
from plat.studio.page import Page

__all__ = ["FilePanel"]


class FilePanel:
    """Saves and loads keyframes on the machine that the studio runs on, and to and from the browser's.

    Args:
        page: the page.
        path: what the box for the file says at first.
    """

    def __init__(self, page: Page, path: str):
        self._page, session, gui = page, page.session, page.gui
        self._path = gui.add_text("File", path, hint="On the machine that the studio runs on.")
        page.buttons("", {"Save": self._save, "Load": self._load})
        download = gui.add_button("Download", icon=viser.Icon.DOWNLOAD)
        upload = gui.add_upload_button("Upload", icon=viser.Icon.UPLOAD, mime_type="application/json")

        with gui.add_folder("Video of the policy that is chosen"):
            self._video = gui.add_text("Video file", str(Path(path).with_suffix(".mp4")))
            record = gui.add_button("Record", icon=viser.Icon.VIDEO, hint="May take a minute without a GPU.")

        async def download_clicked(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            client = event.client
            if client is not None:
                page.desk.ask(lambda: client.send_file_download("keyframes.json", session.to_json()))

        async def uploaded(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            file = event.target.value
            page.desk.ask(lambda: self._loaded(file.name, session.from_json(file.name, file.content)))

        async def record_clicked(_: object) -> None:
            page.desk.ask_elsewhere(self._record)

        record.on_click(record_clicked)
        download.on_click(download_clicked)
        upload.on_upload(uploaded)

    def _save(self) -> None:
        self._page.session.save(self._path.value)
        self._page.notify("Saved", self._path.value, "green")

    def _load(self) -> None:
        self._loaded(self._path.value, self._page.session.load(self._path.value))

    def _record(self) -> Task:
        session, path = self._page.session, self._video.value
        self._page.notify("Video", f"{session.policy} is being recorded")
        session.record(session.timeline, session.policy, path)
        return lambda: self._page.notify("Video", f"written to {path}", "green")

    def _loaded(self, name: str, added: int) -> None:
        count = len(self._page.session.timeline.keyframes)
        split = f", {added} of them added between keyframes that were too far apart" if added else ""
        self._page.notify("Loaded", f"{name}: {count} keyframes{split}", "green")
