"""Files of public repositories, read from git directories in a folder.

The git directory of a repository stands in the folder `OWNER+NAME`: in the folder itself (a bare
clone), in `repo`, or in `.git` of either. Nothing is checked out, and nothing is fetched.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import NamedTuple

#: Folders below `OWNER+NAME` that may be a git directory.
_PLACES = (".", ".git", "repo", "repo/.git")
#: A snapshot without some of its files must not ask a server for them.
_OFFLINE = {"GIT_NO_LAZY_FETCH": "1", "GIT_TERMINAL_PROMPT": "0"}


class MissingError(Exception):
    """A repository, commit or file that the folder does not hold. The text names it."""


class TreeFile(NamedTuple):
    """A file of a commit.

    blob: id of its content, 40 hex digits.
    size: bytes, -1 if the snapshot lacks the content.
    path: path in the repository.
    """

    blob: str
    size: int
    path: str


class Mirror:
    """The git directory of a repository.

    repository: owner/name.
    """

    def __init__(self, folder: Path, repository: str) -> None:
        """Raises MissingError if the folder holds no git directory of the repository."""
        self.repository = repository
        top = folder / repository.replace("/", "+")
        for place in _PLACES:
            if (top / place / "HEAD").is_file() and (top / place / "objects").is_dir():
                self._directory = top / place
                return
        raise MissingError(f"{repository}: no git directory in the folder")

    def find_head(self) -> str:
        """The newest commit. Raises MissingError for an empty repository."""
        return self._run("rev-parse", "--verify", "HEAD").decode("ascii").strip()

    def list_files(self, commit: str) -> list[TreeFile]:
        """The files of a commit without links. Raises MissingError without the commit."""
        files = []
        listing = self._run("ls-tree", "-r", "-l", "-z", commit)
        for entry in listing.decode("utf-8", "surrogateescape").split("\0")[:-1]:
            attributes, path = entry.split("\t", 1)
            mode, kind, blob, size = attributes.split()
            if kind == "blob" and mode != "120000":
                files.append(TreeFile(blob, int(size) if size.isdecimal() else -1, path))
        return files

    def read_blob(self, blob: str) -> bytes:
        """The content of a file. Raises MissingError if the snapshot lacks it."""
        return self._run("cat-file", "blob", blob)

    def read_file(self, commit: str, path: str) -> bytes:
        """The content of a file of a commit. Raises MissingError without the commit or the file."""
        return self._run("cat-file", "blob", f"{commit}:{path}")

    def _run(self, *words: str) -> bytes:
        command = ["git", f"--git-dir={self._directory}", *words]
        environment = os.environ | _OFFLINE
        done = subprocess.run(command, capture_output=True, check=False, env=environment)
        if done.returncode:
            raise MissingError(f"{self.repository}: git {' '.join(words[:1] + words[-1:])} fails")
        return done.stdout
