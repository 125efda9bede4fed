"""Files that are either complete or absent, and what a measurement ran on."""

from __future__ import annotations

import contextlib
import fcntl
import glob
import hashlib
import json
import math
import os
import platform
import re
import secrets
import shlex
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rans.errors import ConfigError

_PACKAGES = ("rans", "torch", "numpy", "drake", "casadi", "gymnasium", "stable-baselines3", "scipy")
"""Packages whose versions can change a measured value."""

LARGEST_TEXT = 2**26
"""Bytes of a text: a hundred times the largest that RANS writes."""
_LARGEST_LINES = 2**28
"""Bytes of a file of JSON, one a line, which the rows of a training fill."""
_DEEPEST = 64
"""Tables and lists within each other: many times as deep as in any file of RANS."""

_ABANDONED = 10.0
"""Age of a draft, s, at which a process that cannot be found is taken for dead."""

LOCK = ".lock"
"""Name of the file in a folder that `Lock` holds while somebody trains there."""


def replace_file(file: Path, write: Callable[[Path], object]) -> None:
    """Write a file beside its place and move it there, so that a reader never sees half of it.

    Missing folders are made; ``write`` writes the whole content to the path it is given, where an empty
    file waits that did not exist before: nobody can have laid a link there. A link in the file's place is
    replaced, and what it leads to stays as it is.

    Raises:
        ConfigError: the disk refused (full, read-only, no permission); the old file is unharmed. Or there is
            a folder in its place, or a file in its folder's.
    """
    if file.is_dir():  # also without a name, which means the current folder
        raise ConfigError(f"cannot write {file}: it is a folder; give the name of a file.")
    if file.exists() and not file.is_file():  # moving a file there would end a device
        raise ConfigError(
            f"cannot write {file}: it is a pipe or a device; give the name of a file."
        )
    draft = file.with_name(f".{os.getpid()}.{secrets.token_hex(4)}.{file.name}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        _clear_drafts(file)
        os.close(_opened(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
        write(draft)
        os.replace(draft, file)
    except (FileExistsError, NotADirectoryError) as error:
        raise ConfigError(
            f"cannot write {file}: {error.filename} is a file, not a folder."
        ) from error
    except (OSError, RuntimeError) as error:  # torch reports a full disk as a RuntimeError
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"cannot write {file}: {reason}; is the disk full or read-only?"
        ) from error
    finally:
        with contextlib.suppress(OSError):
            draft.unlink()


def _clear_drafts(file: Path) -> None:
    """Remove what processes left that were killed while they wrote this file."""
    # Drafts of older versions had no random part.
    named = re.compile(rf"\.(\d+)(\.[0-9a-f]{{8}})?\.{re.escape(file.name)}")
    for draft in file.parent.glob(f".*.{glob.escape(file.name)}"):
        found = named.fullmatch(draft.name)
        if found is None:
            continue
        try:
            about = draft.lstat()
        except FileNotFoundError:  # its writer has just finished
            continue
        # Another machine's process may be at work, whose number says nothing here.
        abandoned = not _is_alive(int(found[1])) and time.time() - about.st_mtime > _ABANDONED
        if abandoned and stat.S_ISREG(about.st_mode):
            draft.unlink(missing_ok=True)


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # it is somebody else's
        return True
    return True


def _opened(file: Path, flags: int) -> int:
    """Descriptor of a file that is no link, nor a pipe that nobody reads; OSError where it is one."""
    return os.open(file, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)


def append_text(file: Path, text: str) -> None:
    """Add to the end of a file, or begin it; `ConfigError` where it is a link or the disk refuses."""
    try:
        with open(
            _opened(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND), "a", encoding="utf-8"
        ) as stream:
            stream.write(text)
    except OSError as error:
        raise ConfigError(
            f"cannot write {file}: {error.strerror or error}; is the disk full, or the file a "
            "symbolic link?"
        ) from error


def inside(folder: Path, *parts: str) -> Path:
    """A place in a folder that may be a stranger's: no link leads from it to somewhere else.

    The folder itself may be a link, which the user named. What comes with this package may consist of links,
    as some installers make them.

    Raises:
        ConfigError: one of the parts is a symbolic link.
    """
    place = folder
    for part in parts:
        place /= part
        if place.is_symlink() and not folder.is_relative_to(Path(__file__).parent):
            raise ConfigError(
                f"{place} is a symbolic link, which may lead to any file of yours. If you know "
                f"where it leads, take a copy without links: cp -rL {shlex.quote(str(folder))} "
                "COPY."
            )
    return place


def inside_for_others(folder: Path, *parts: str) -> Path:
    """`inside` for a folder in which a library opens files by names of its own: none there is a link."""
    place = inside(folder, *parts)
    if place.is_dir():
        for name in os.listdir(place):
            inside(folder, *parts, name)
    return place


class Lock:
    """Held by one process at a time; it goes with the process.

    Args:
        file: made when the lock is taken, and never written, replaced or removed: a lock goes with the file
            that is opened, so who opens another one of the same name is not kept out.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._held = -1

    def take(self, refusal: str) -> None:
        """Hold it from now on; ConfigError with this sentence where another process does."""
        if self._held >= 0:
            return
        _make_folder(self._file.parent)
        try:
            self._held = _opened(self._file, os.O_RDWR | os.O_CREAT)
        except OSError as error:
            raise ConfigError(
                f"cannot write {self._file}: {error.strerror or error}; is the disk full or "
                "read-only, or the file a symbolic link?"
            ) from error
        try:
            fcntl.flock(self._held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise ConfigError(refusal) from None
        except OSError:  # a file system without locks: nobody can be kept out
            return

    @property
    def is_held(self) -> bool:
        """Whether it was taken by this object."""
        return self._held >= 0

    def release(self) -> None:
        """Let others have it."""
        if self._held >= 0:
            os.close(self._held)
            self._held = -1

    def __del__(self) -> None:
        self.release()


@contextlib.contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Wait until no other process is within this for the same folder; a missing one is made.

    For who reads a file there, extends it and replaces it, which takes a moment: else the last of two would
    write without what the first has added. File systems without locks keep nobody waiting.

    Raises:
        ConfigError: the folder cannot be made or opened.
    """
    _make_folder(folder)
    try:
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise ConfigError(f"cannot write into {folder}: {error.strerror or error}.") from error
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(held, fcntl.LOCK_EX)
        yield
    finally:
        os.close(held)


def distinct(name: str, content: str = "") -> str:
    """A name as part of a file's name, so that others get other ones.

    Args:
        name: stays as it is where that is possible; with a digest where a file's name cannot hold it.
        content: of a user's file; its digest tells it from what comes with the package by that name, and
            from other files of that name.
    """
    plain = re.sub(r"[^\w.-]+", "-", name)
    told = content or (name if plain != name else "")
    if not told:
        return plain
    digest = hashlib.sha256(told.encode("utf-8", "surrogatepass")).hexdigest()
    return f"{plain}-{digest[:8]}"


def _make_folder(folder: Path) -> None:
    """With those above it; `ConfigError` that names the file in the way, or why the disk refused."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or error
        for place in (folder, *folder.parents):
            if place.is_file():
                reason = f"{place} is a file, not a folder"
        raise ConfigError(
            f"cannot write into {folder}: {reason}; choose another folder."
        ) from error


def ready_folder(folder: Path) -> Path:
    """The folder, where results of long work will find their place; a missing one is made by the first.

    Raises:
        ConfigError: it cannot be, or nothing can be written there.
    """
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        ready = os.access(folder, os.W_OK | os.X_OK)
        with contextlib.suppress(OSError):  # another process is at work there
            for one in missing:  # so that work that fails leaves no empty folder
                one.rmdir()
    except OSError as error:
        reason = error.strerror or error
        raise ConfigError(
            f"cannot write into {folder}: {reason}; choose another folder."
        ) from error
    if not ready:
        raise ConfigError(f"cannot write into {folder}: permission denied; choose another folder.")
    return folder


def write_text(file: Path, text: str) -> None:
    """`replace_file` for text in UTF-8; of a file's name that is none, the bytes are spelt out."""
    replace_file(file, lambda draft: draft.write_text(text, "utf-8", "backslashreplace"))


def write_json(file: Path, value: Any) -> None:
    """`replace_file` for JSON; numbers it has no word for are texts, see `plain`."""
    write_text(file, json.dumps(plain(value), indent=2, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """A value as JSON can hold it: what is not finite becomes "inf", "-inf" or "nan", see `number`."""
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def number(value: float | str | None) -> float:
    """A number that `plain` may have made a text; null, as older files say, is infinite too."""
    return math.inf if value is None else float(value)


def regular(file: Path, what: str = "") -> Path:
    """The file itself; `ConfigError` where it is none, but a folder, or a pipe or device without an end."""
    try:
        mode = file.stat().st_mode
    except (OSError, ValueError) as error:  # a name that no file can have is a ValueError
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"cannot read {what}{file}: {reason}.") from error
    if not stat.S_ISREG(mode):
        raise ConfigError(
            f"cannot read {what}{file}: it is no file, but a folder, a pipe or a device."
        )
    return file


def read_bytes(file: Path, most: int, what: str = "") -> bytes:
    """The bytes in a file; `ConfigError` where it cannot be read or has more than that.

    A word such as "the mesh " may say what it is.
    """
    try:
        with regular(file, what).open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            content = b"" if size > most else stream.read(most + 1)
    except OSError as error:
        raise ConfigError(f"cannot read {what}{file}: {error}.") from error
    found = max(size, len(content))  # a file may say that it is empty, or grow
    if found > most:
        raise ConfigError(
            f"{what}{file} has {found:,} bytes, and at most {most:,} are read: it is "
            "another file than it should be, or damaged."
        )
    return content


def read_text(file: Path, most: int = LARGEST_TEXT, what: str = "") -> str:
    """The text in a file, see `read_bytes`; `ConfigError` where it cannot be read or is no text."""
    try:
        text = read_bytes(file, most, what).decode("utf-8")
    except UnicodeError as error:
        raise ConfigError(f"{what}{file} is damaged, it is no text in UTF-8: {error}.") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")  # as files opened as texts have it


def read_json(file: Path) -> Any:
    """The value in a JSON file; `ConfigError` where it is unreadable, damaged, too large or too deep."""
    text = read_text(file)
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{file} is damaged, it is not valid JSON: {error}.") from error
    try:
        check_depth(value)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error
    return value


def check_depth(value: Any) -> None:
    """Refuse (`ConfigError`) tables and lists that are too deep within each other."""
    level = [value]
    for _ in range(_DEEPEST + 1):
        containers = [one for one in level if isinstance(one, dict | list)]
        if not containers:
            return
        level = [
            inner
            for one in containers
            for inner in (one.values() if isinstance(one, dict) else one)
        ]
    raise ConfigError(f"tables and lists may be at most {_DEEPEST} deep within each other.")


def read_json_lines(file: Path) -> list[dict[str, Any]]:
    """The objects in a file of one a line, up to a line cut off by an interruption.

    Raises:
        ConfigError: it cannot be read or is too large, or a line is something else or too deep.
    """
    lines = read_bytes(file, _LARGEST_LINES).decode("utf-8", "replace").splitlines()
    values: list[Any] = []
    with contextlib.suppress(ValueError, RecursionError):
        values.extend(map(json.loads, lines))  # keeps what came before the line that is cut off
    for line, value in enumerate(values, 1):
        if not isinstance(value, dict):
            raise ConfigError(f"{file} is damaged: line {line} must be an object, {{...}}.")
        try:
            check_depth(value)
        except ConfigError as error:
            raise ConfigError(f"{file}, line {line}: {error}") from error
    return values


def first_line(error: BaseException) -> str:
    """What an error of another library says, without its advice."""
    return str(error).partition("\n")[0].rstrip(".") or type(error).__name__


def environment() -> dict[str, str]:
    """Versions and hardware behind a measured value."""
    torch = sys.modules.get("torch")  # for those who have loaded it
    gpu = (
        torch.cuda.get_device_name() if torch is not None and torch.cuda.is_available() else "none"
    )
    system = f"{platform.system()} {platform.machine()}"
    return {
        **{name: package_version(name) for name in _PACKAGES},
        "revision": git_revision(),
        "python": platform.python_version(),
        "system": system,
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "gpu": gpu,
    }


def command_line() -> str:
    """The command that runs, as it can be typed again."""
    return shlex.join(["rans", *sys.argv[1:]])


def git_revision() -> str:
    """Revision of the working copy this package runs from, or "unknown" when installed from a wheel."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--tags"]
    try:
        result = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
    return result.stdout.strip() or "unknown"


def package_version(package: str) -> str:
    """Of what is installed; who runs a copy of the sources may not have installed `rans` itself."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    """Name of the processor; Linux tells it only in a file."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "unknown")
