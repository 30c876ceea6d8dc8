"""Runs on the Hub by its own client, against a server on this machine that answers as the Hub does."""

import base64
import hashlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest

from tests.export.runs import small_policy, write_run

COMMIT = "a" * 40
REPO = "/api/models/someone/walker"


class Hub(BaseHTTPRequestHandler):
    """One repository, someone/walker: what is committed can be downloaded."""

    protocol_version = "HTTP/1.1"
    files: ClassVar[dict[str, bytes]] = {}
    address = ""

    def log_message(self, *_: Any) -> None:
        """Keep quiet."""

    def answer(self, code: int, content: Any, **headers: str) -> None:
        body = content if isinstance(content, bytes) else json.dumps(content).encode()
        self.send_response(code)
        for name, value in {"Content-Length": str(len(body)), **headers}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def body(self) -> bytes:
        if self.headers.get("Transfer-Encoding") != "chunked":
            return self.rfile.read(int(self.headers.get("Content-Length", 0)))
        content = b""
        while size := int(self.rfile.readline(), 16):
            content += self.rfile.read(size)
            self.rfile.readline()
        self.rfile.readline()
        return content

    def do_POST(self) -> None:
        body = self.body()
        if self.path == "/api/repos/create":
            self.answer(200, {"url": f"{self.address}/someone/walker", "name": "someone/walker"})
        elif self.path == "/api/validate-yaml":
            self.answer(200, {"errors": [], "warnings": []})
        elif self.path == f"{REPO}/preupload/main":
            names = [file["path"] for file in json.loads(body)["files"]]
            answers = [{"path": name, "uploadMode": "regular", "shouldIgnore": False, "oid": None} for name in names]
            self.answer(200, {"files": answers})
        elif self.path.startswith(f"{REPO}/commit/main"):
            for entry in map(json.loads, body.splitlines()):
                if entry["key"] == "file":
                    self.files[entry["value"]["path"]] = base64.b64decode(entry["value"]["content"])
            url = f"{self.address}/someone/walker/commit/{COMMIT}"
            self.answer(200, {"success": True, "commitOid": COMMIT, "commitUrl": url, "hookOutput": ""})
        else:
            self.answer(404, {"error": self.path})

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        name = path.rpartition("/")[2]
        hashes = {file: hashlib.sha1(content).hexdigest() for file, content in self.files.items()}
        if path.startswith(f"{REPO}/tree/"):
            tree = [
                {"type": "file", "path": file, "size": len(self.files[file]), "oid": hashes[file]} for file in hashes
            ]
            self.answer(200, tree)
        elif path.startswith(REPO):
            siblings = [{"rfilename": file} for file in hashes]
            about = {"id": "someone/walker", "sha": COMMIT, "private": True, "siblings": siblings, "tags": []}
            self.answer(200, {"_id": "1", "modelId": "someone/walker", "downloads": 0, "likes": 0, **about})
        elif path.startswith("/someone/walker/resolve/") and name in self.files:
            self.answer(200, self.files[name], X_Repo_Commit=COMMIT, ETag=f'"{hashes[name]}"')
        else:
            self.answer(404, {"error": path}, X_Error_Code="RepoNotFound")

    def do_HEAD(self) -> None:
        self.do_GET()


@pytest.fixture
def server() -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Hub) as hub:
        Hub.files.clear()
        Hub.address = f"http://127.0.0.1:{hub.server_port}"
        threading.Thread(target=hub.serve_forever, daemon=True).start()
        yield Hub.address
        hub.shutdown()


@pytest.mark.slow
def test_its_client_brings_back_what_it_took(server: str, tmp_path: Path) -> None:
    pytest.importorskip("huggingface_hub.hf_api", reason="needs huggingface-hub")
    run = write_run(tmp_path / "walker", small_policy("residual_latent_noise"))
    program = """
import sys
import torch
import plat
from plat.errors import CheckpointError
from plat.export import push_run
from plat.runs import load_policy
push_run(sys.argv[1], "hf:someone/walker")
ours, theirs = (policy.state_dict() for policy in (load_policy(sys.argv[1]), plat.load("hf:someone/walker")))
assert list(ours) == list(theirs) and all(torch.equal(ours[name], theirs[name]) for name in ours)
try:
    plat.load("hf:someone/nobody")
except CheckpointError as error:
    print(error)
"""
    # the client reads these when it is imported
    switches = dict.fromkeys(("HF_HUB_DISABLE_XET", "HF_HUB_DISABLE_TELEMETRY", "HF_HUB_DISABLE_PROGRESS_BARS"), "1")
    settings = {"HF_ENDPOINT": server, "HF_HOME": str(tmp_path / "hub"), "HF_TOKEN": "hf_token", **switches}
    command = [sys.executable, "-c", program, str(run)]
    result = subprocess.run(command, env={**os.environ, **settings}, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("'hf:someone/nobody' could not be downloaded (RepositoryNotFoundError")
    assert set(Hub.files) >= {"README.md", "config.json", "model.safetensors"}
