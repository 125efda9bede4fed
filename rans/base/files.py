"""Reading and writing of files: complete or absent, with locks and size limits; versions behind a measurement."""

from __future__ import annotations

import contextlib
import errno
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
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextvars import ContextVar
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, BinaryIO

from rans.base import system
from rans.base.errors import ConfigError, RansError, RansWarning, brief, meant_file, text_of_name

_PACKAGES = ("rans", "torch", "numpy", "drake", "casadi", "gymnasium", "stable-baselines3", "scipy")
"""Packages whose versions can affect measurements."""

LARGEST_TEXT = 2**26
"""Largest number of bytes of a text file that is read."""
_LARGEST_LINES = 2**28
"""Largest number of bytes of a file with one JSON object per line, such as the rows of a training."""
_DEEPEST = 64
"""Largest nesting depth of tables and lists."""

_ABANDONED = 10.0
"""Age of a draft, s, above which it is removed if its process does not exist."""

LOCK = ".lock"
"""Name of the lock file (`Lock`) of a training in its folder."""


def replace_file(file: Path, write: Callable[[Path], object]) -> None:
    """Write a file atomically: to a draft beside it, which then replaces it.

    Missing folders are created. A symbolic link in place of the file is replaced; its target does not change.

    Args:
        file: file to write.
        write: writes the whole content to the path that it receives, an empty new file.

    Raises:
        ConfigError: the disk is full or read-only, permission is missing, the path is a folder, or one of its
            folders is a file. The old file is not changed.
    """
    if file.is_dir():  # an empty name means the current folder
        raise ConfigError(f"cannot write {file}: it is a folder; give the name of a file.")
    if file.exists() and not file.is_file():  # a device would be replaced
        raise ConfigError(
            f"cannot write {file}: it is a pipe or a device; give the name of a file."
        )
    draft = file.with_name(f".{os.getpid()}.{secrets.token_hex(4)}.{file.name}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        clear_drafts(file)
        os.close(system.open_safely(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
        write(draft)
        os.replace(draft, file)
        _written.append(file.name)
    except (FileExistsError, NotADirectoryError) as error:
        raise ConfigError(
            f"cannot write {file}: {error.filename} is a file, not a folder."
        ) from error
    except (OSError, RuntimeError) as error:  # torch reports a full disk as a RuntimeError
        raise ConfigError(f"cannot write {file}: {why_unwritten(error)}.") from error
    finally:
        with contextlib.suppress(OSError):
            draft.unlink()


_KNOWN_REASONS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk is full",
    errno.EROFS: "the disk is read-only",
    errno.ELOOP: "a symbolic link is in the way",
}
"""What a system's error of writing means, where that is certain."""


def why_unwritten(error: Exception) -> str:
    """Why a file could not be written, as the end of a sentence without its period."""
    if reason := _KNOWN_REASONS.get(getattr(error, "errno", None) or 0):
        return reason
    reason = getattr(error, "strerror", None) or str(error).rstrip(".")
    return f"{reason} (is the disk full or read-only?)"


_written: deque[str] = deque(maxlen=1)
"""Name of the file that this process has written last."""


def has_written() -> bool:
    """Whether this process has written a file, which an interrupt leaves complete."""
    return bool(_written)


def clear_drafts(file: Path, abandoned: float = _ABANDONED) -> None:
    """Remove drafts of processes that were killed while they wrote a file.

    Args:
        file: the file.
        abandoned: age of a draft, s, above which it is removed if its process does not exist; 0 for files that no
            other machine can be writing.
    """
    # Drafts of older versions have no random part.
    named = re.compile(rf"\.(\d+)(\.[0-9a-f]{{8}})?\.{re.escape(file.name)}")
    for draft in file.parent.glob(f".*.{glob.escape(file.name)}"):
        match = named.fullmatch(draft.name)
        if match is None:
            continue
        try:
            about = draft.lstat()
        except FileNotFoundError:  # its process has just finished
            continue
        # The process may run on another machine, where its number has another meaning.
        is_old = time.time() - about.st_mtime > abandoned or not abandoned
        if is_old and not system.is_alive(int(match[1])) and stat.S_ISREG(about.st_mode):
            with contextlib.suppress(PermissionError):  # on Windows a process has it open
                draft.unlink(missing_ok=True)


def append_text(file: Path, text: str) -> None:
    """Append a text to a file, which is created if it is missing.

    Raises:
        ConfigError: the file is a symbolic link or cannot be written.
    """
    try:
        held = system.open_safely(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        with open(held, "a", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
        _written.append(file.name)
    except OSError as error:
        raise ConfigError(f"cannot write {file}: {why_unwritten(error)}.") from error


def inside(folder: Path, *parts: str) -> Path:
    """Path within an untrusted folder, none of whose parts is a symbolic link.

    The folder itself may be a link. Files of this package may be links, as some installers create them.

    Raises:
        ConfigError: one of the parts is a symbolic link.
    """
    path = folder
    for part in parts:
        path /= part
        if path.is_symlink() and not folder.is_relative_to(Path(__file__).parents[1]):
            raise ConfigError(
                f"{path} is a symbolic link, which may lead to any file of yours. If you know "
                f"where it leads, make a copy without links: cp -rL {shlex.quote(str(folder))} "
                "COPY."
            )
    return path


def inside_for_others(folder: Path, *parts: str) -> Path:
    """`inside` for a folder whose files a library opens by itself: its entries are no links either."""
    path = inside(folder, *parts)
    if path.is_dir():
        for name in os.listdir(path):
            inside(folder, *parts, name)
    return path


class Lock:
    """Lock file that one process holds at a time; it is released when the process ends.

    Args:
        file: created when the lock is taken, and never written or replaced, because the lock belongs to the opened
            file and not to its name; who removes it holds the lock.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._held = -1

    def take(self, refusal: str) -> None:
        """Take the lock.

        Args:
            refusal: message of the error if another process holds it.

        Raises:
            ConfigError: another process holds the lock, or the file cannot be opened.
        """
        if self._held >= 0:
            return
        _make_folder(self._file.parent)
        try:
            self._held = system.open_safely(self._file, os.O_RDWR | os.O_CREAT)
        except OSError as error:
            raise ConfigError(f"cannot write {self._file}: {why_unwritten(error)}.") from error
        try:
            system.lock(self._held, wait=False)
            if not os.fstat(self._held).st_nlink:  # its holder has just removed it
                raise BlockingIOError
        except BlockingIOError:
            self.release()
            raise ConfigError(refusal) from None
        except OSError:  # a file system without locks
            return

    @property
    def is_held(self) -> bool:
        """Whether this object holds the lock."""
        return self._held >= 0

    def release(self) -> None:
        """Release the lock."""
        if self._held >= 0:
            os.close(self._held)
            self._held = -1

    def __del__(self) -> None:
        self.release()


@contextlib.contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Context in which only one process at a time is, for the same folder; a missing folder is created.

    It protects a read, change and replacement of a file against other processes. It has no effect on file systems
    without locks.

    Raises:
        ConfigError: the folder cannot be created or opened.
    """
    _make_folder(folder)
    try:
        held = system.open_for_lock(folder)
    except OSError as error:
        raise ConfigError(f"cannot write into {folder}: {error.strerror or error}.") from error
    try:
        with contextlib.suppress(OSError):
            system.lock(held, wait=True)
        yield
    finally:
        os.close(held)


@contextlib.contextmanager
def writing_at_end(write: Callable[[], object], file: Path | None = None) -> Iterator[None]:
    """Context that writes results when it ends, also after an error or Ctrl-C.

    Args:
        write: writes them.
        file: theirs, which only one process at a time writes; None: they are in none.

    Raises:
        ConfigError: another process writes the file, or its folder cannot be written.
    """
    with _alone(file) if file is not None else contextlib.nullcontext():
        try:
            yield
        finally:
            write()


@contextlib.contextmanager
def _alone(file: Path) -> Iterator[None]:
    """Context of one process alone, for the same file; it leaves no lock behind, and no empty folders."""
    path = file.with_name(f".{file.name}{LOCK}")
    lock = Lock(path)
    with _made(path.parent):
        lock.take(
            f"another process is flying for {file}, too: wait until it has ended, or write into another folder "
            "(--output, where the command has it)."
        )
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                path.unlink()
            lock.release()


def distinct(name: str, content: str = "") -> str:
    """Unique part of a file name for a name.

    Args:
        name: unchanged if possible; characters that file names cannot have are replaced and a digest is added.
        content: content of a user's file, whose digest distinguishes it from others of the same name; empty: no
            file.
    """
    plain = re.sub(r"[^\w.-]+", "-", name)
    source = content or (name if plain != name else "")
    if not source:
        return plain
    digest = hashlib.sha256(source.encode("utf-8", "surrogatepass")).hexdigest()
    return f"{plain}-{digest[:8]}"


@contextlib.contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Context in which a folder exists; it and its parents go again where they were missing and are empty."""
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    _make_folder(folder)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # something was written there
            for parent in missing:
                parent.rmdir()


def _make_folder(folder: Path) -> None:
    """Create a folder and its parents; a `ConfigError` names the file in the way or the reason of the system."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or error
        for parent in (folder, *folder.parents):
            if parent.is_file():
                reason = f"{parent} is a file, not a folder"
        raise ConfigError(
            f"cannot write into {folder}: {reason}; name another folder, or run where you may write."
        ) from error


def new_folder(folder: Path) -> bool:
    """Create a folder with its parents; False if its name is taken, as another process may be faster."""
    _make_folder(folder.parent)
    try:
        folder.mkdir()
    except FileExistsError:
        return False
    except OSError as error:
        raise ConfigError(f"cannot write into {folder.parent}: {why_unwritten(error)}.") from error
    return True


def ready_folder(name: str | Path) -> Path:
    """The folder of a name, checked to be writable before long work; a missing folder is not left behind.

    Raises:
        ConfigError: the name is empty, the folder cannot be created, or nothing can be written there.
    """
    folder = Path(text_of_name("a folder", name, Path))
    with _made(folder):
        if not os.access(folder, os.W_OK | os.X_OK):
            raise ConfigError(
                f"cannot write into {folder}: permission denied; name another folder, or run where you may write."
            )
    return folder


def write_text(file: Path, text: str) -> None:
    """`replace_file` for a text in UTF-8; characters without an encoding are escaped."""
    replace_file(file, lambda draft: draft.write_text(text, "utf-8", "backslashreplace", "\n"))


def write_json(file: Path, value: Any, beside: Iterable[str] | None = None) -> None:
    """`replace_file` for JSON; numbers that are not finite become texts (`plain`).

    Args:
        file: file to write.
        value: its content.
        beside: of results, which replace those of the same command only: others are `set_aside`, with these.
            None: the file always replaces the one before.
    """
    text = json.dumps(plain(value), indent=2, allow_nan=False) + "\n"

    def write(draft: Path) -> None:
        draft.write_text(text, "utf-8", "backslashreplace", "\n")
        # The earlier results stay where they are until the new ones are on the disk.
        if beside is not None and file.is_file() and not file.is_symlink():
            command = before = _command(value)
            with contextlib.suppress(ConfigError, AttributeError):  # damaged
                before = _command(read_json(file))
            if before != command:
                set_aside(file, beside)

    replace_file(file, write)


def set_aside(file: Path, beside: Iterable[str] = ()) -> None:
    """Move results that others will replace to earlier/THEIR TIME beside them, with a warning.

    Args:
        file: their file; those whose names differ from its in the ending alone move too.
        beside: names of further files and folders beside it.

    Raises:
        ConfigError: the folder is a symbolic link, or cannot be written.
    """
    made = datetime.fromtimestamp(file.stat().st_mtime)
    folder = inside(file.parent, "earlier", f"{made:%Y-%m-%d-%H%M%S.%f}")
    _make_folder(folder)
    names = {other.name for other in file.parent.glob(f"{glob.escape(file.stem)}.*")}
    for name in names.union(beside):
        with contextlib.suppress(FileNotFoundError):  # another process was faster
            (file.parent / name).replace(folder / name)
    said = f"{file} was there already; the earlier results are now in {folder}."
    warnings.warn(said, RansWarning, stacklevel=2)


def _command(results: Any) -> str:
    """The command that results name as their maker; empty: none."""
    return str(results.get("about", results).get("command", ""))


def plain(value: Any) -> Any:
    """Value for JSON, in which numbers that are not finite become "inf", "-inf" or "nan" (`number`)."""
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def number(value: float | str | None) -> float:
    """Number from JSON, which `plain` may have written as a text; null (older files) is infinity."""
    return math.inf if value is None else float(value)


def open_regular(file: Path, what: str = "") -> BinaryIO:
    """Stream of the bytes of a regular file; `read_bytes` and the like are for files as a whole.

    Raises:
        ConfigError: it does not exist, permission is missing, or it is a folder, a pipe or a device.
    """
    try:
        held = system.open_safely(file, os.O_RDONLY, follow=True)
    except (OSError, ValueError) as error:  # a name that no file can have is a ValueError
        reason = getattr(error, "strerror", None) or error
        near = meant_file(file) if isinstance(error, FileNotFoundError) else ""
        raise ConfigError(f"cannot read {what}{file}: {reason}{near}.") from error
    if not stat.S_ISREG(os.fstat(held).st_mode):
        os.close(held)
        raise ConfigError(
            f"cannot read {what}{file}: it is not a file, but a folder, a pipe or a device."
        )
    return os.fdopen(held, "rb")


def read_bytes(file: Path, most: int, what: str = "") -> bytes:
    """Bytes of a file.

    Args:
        file: file to read.
        most: largest number of bytes.
        what: description of the file in messages, such as "the mesh ".

    Raises:
        ConfigError: the file cannot be read or is too large.
    """
    try:
        with open_regular(file, what) as stream:
            size = os.fstat(stream.fileno()).st_size
            content = b"" if size > most else stream.read(most + 1)
    except OSError as error:
        raise ConfigError(f"cannot read {what}{file}: {error}.") from error
    length = max(size, len(content))  # the reported size may be zero, and a file may grow
    if length > most:
        raise ConfigError(
            f"{what}{file} has {length:,} bytes, and at most {most:,} are read; it is probably the wrong "
            "file, or damaged."
        )
    return content


def read_text(file: Path, most: int = LARGEST_TEXT, what: str = "") -> str:
    """Text of a file in UTF-8 with lines that end in a newline; arguments as for `read_bytes`.

    Raises:
        ConfigError: the file cannot be read, is too large, or is not a text in UTF-8.
    """
    content = read_bytes(file, most, what)
    if content.startswith((b"\x1f\x8b", b"\xfd7zXZ", b"BZh")):  # gzip, xz and bzip2
        raise ConfigError(f"{what}{file} is compressed: unpack it first.")
    if b"\0" in content:
        raise ConfigError(
            f"{what}{file} has zero bytes, as a text in UTF-16, and only UTF-8 is read: save it in that encoding."
        )
    try:
        text = content.decode("utf-8-sig")  # editors of Windows begin a file with a byte order mark
    except UnicodeError as error:
        raise ConfigError(
            f"{what}{file} is damaged or in another encoding, it is not a text in UTF-8: {error}. Save it as UTF-8."
        ) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")  # as `open` does in text mode


def read_json(file: Path) -> Any:
    """Value of a JSON file.

    Raises:
        ConfigError: the file cannot be read, is damaged, too large or nested too deeply.
    """
    return parse_json(read_text(file), file)


def parse_json(text: str | bytes, where: object) -> Any:
    """Value of a JSON text from a file or a message.

    Args:
        text: the text, or its bytes in UTF-8.
        where: name of its source in messages.

    Raises:
        ConfigError: the text is damaged, too large or nested too deeply.
    """
    if len(text) > LARGEST_TEXT:
        raise ConfigError(
            f"{where} has {len(text):,} characters of JSON, and at most {LARGEST_TEXT:,} are read."
        )
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{where} is damaged, it is not valid JSON: {error}.") from error
    try:
        check_depth(value)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
    return value


def check_depth(value: Any) -> None:
    """Reject (`ConfigError`) tables and lists nested too deeply, since later code descends by recursion."""
    level = [value]
    for _ in range(_DEEPEST + 1):
        containers = [item for item in level if isinstance(item, dict | list)]
        if not containers:
            return
        level = [
            inner
            for container in containers
            for inner in (container.values() if isinstance(container, dict) else container)
        ]
    raise ConfigError(f"tables and lists may be nested at most {_DEEPEST} deep.")


def read_json_lines(file: Path) -> list[dict[str, Any]]:
    """Objects of a file with one JSON object per line, up to a line that was cut off by an interruption.

    Raises:
        ConfigError: the file cannot be read or is too large, or a line is not an object or nested too deeply.
    """
    lines = read_bytes(file, _LARGEST_LINES).decode("utf-8", "replace").splitlines()
    values: list[Any] = []
    with contextlib.suppress(ValueError, RecursionError):
        values.extend(map(json.loads, lines))  # keeps the lines before the one that was cut off
    for line, value in enumerate(values, 1):
        if not isinstance(value, dict):
            raise ConfigError(f"{file} is damaged: line {line} must be an object, {{...}}.")
        try:
            check_depth(value)
        except ConfigError as error:
            raise ConfigError(f"{file}, line {line}: {error}") from error
    return values


@contextlib.contextmanager
def reading(file: Path) -> Iterator[Any]:
    """Context of code that takes the value of a JSON file, or the objects of a .jsonl file, for what RANS writes.

    Raises:
        ConfigError: the file cannot be read (`read_json`, `read_json_lines`), or the code in the context fails at
            a value that is missing, or of another kind: the file is a stranger's, edited or of another version.
    """
    content = read_json_lines(file) if file.suffix == ".jsonl" else read_json(file)
    try:
        yield content
    except RansError as error:  # such as a name in a registry
        if made := _other_version(file, content):
            raise ConfigError(f"{file} {made}: {str(error)[:150]} ...") from error
        raise ConfigError(f"{file}: {error}") from error
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RuntimeError,  # of torch
        TypeError,
        ValueError,
    ) as error:
        reason = "a value is missing, or of another kind or size than it must be"
        if isinstance(error, KeyError):
            reason = f"there is no {brief(error.args[0])}"
        made = _other_version(file, content) or "was probably edited by hand"
        raise ConfigError(
            f"{file} is not what RANS writes there: {reason}. It {made}: write it again by its command, or "
            "delete it."
        ) from error


def _other_version(file: Path, content: Any) -> str:
    """Which other version of RANS has made a file, as a part of a sentence; "": this one, or nothing says it."""
    here = package_version("rans")
    made = _version_of(content)
    if not made and (beside := file.with_name("contract.json")).is_file():  # of an export
        made = _version_of(read_json(beside))
    return "" if made in ("", here) else f"was made by RANS {made}, and this is {here}"


def _version_of(content: Any) -> str:
    """Version of RANS that wrote the value of a JSON file, by its parts that may say so; "" if none does."""
    if not isinstance(content, Mapping):
        return ""
    parts = (content.get(key) for key in ("about", "environment", "training"))
    return str(content.get("rans", "")) or next(filter(None, map(_version_of, parts)), "")


def folders_with(folder: Path, names: Iterable[str]) -> str:
    """Suggestion " (did you mean ...?)" of folders in a folder that have one of these files, the newest two."""
    try:
        found = {file.parent for name in names for file in folder.glob(f"*/{name}")}
        newest = sorted(found, key=lambda inner: (-inner.stat().st_mtime, inner))[:2]
    except OSError:
        return ""
    return f" (did you mean {' or '.join(map(str, newest))}?)" if newest else ""


def first_line(error: BaseException) -> str:
    """First line of an exception's message, for errors of other libraries."""
    return str(error).partition("\n")[0].rstrip(".") or type(error).__name__


def environment() -> dict[str, str]:
    """Versions, revision of the code and hardware, which JSON files of measurements have under "environment".

    Readers of measurements show these keys; none may depend on what is imported later.
    """
    torch = sys.modules.get("torch")  # only if it is already loaded
    gpu = (
        torch.cuda.get_device_name() if torch is not None and torch.cuda.is_available() else "none"
    )
    system = f"{platform.system()} {platform.machine()}"
    return {
        **{name: package_version(name) for name in _PACKAGES},
        "revision": git_revision(),
        "date": datetime.now(UTC).isoformat(" ", "minutes"),
        "python": platform.python_version(),
        "system": system,
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "gpu": gpu,
    }


def command_line() -> str:
    """Command line of this process, quoted for a shell."""
    return shlex.join(["rans", *sys.argv[1:]])


_is_command: ContextVar[bool] = ContextVar("is_command", default=False)


@contextlib.contextmanager
def as_command() -> Iterator[None]:
    """Context of a function that its command calls: files name the command line as their maker."""
    token = _is_command.set(True)
    try:
        yield
    finally:
        _is_command.reset(token)


def made_by(function: str) -> str:
    """What a file names as its maker: the command line, or the name of the function that Python called."""
    return command_line() if _is_command.get() else function


def git_revision() -> str:
    """Git revision of the checkout of RANS that this package is in, or "unknown" without one.

    A repository further up is a user's, as round a virtual environment: it is not asked, nor is a program that a
    repository's settings name run.
    """
    root = system.PACKAGE_FOLDER.parent
    if not ((root / ".git").exists() and (root / "rans_command.py").exists()):
        return "unknown"
    command = ["git", "-C", str(root), "-c", "core.fsmonitor=false"]
    command += ["describe", "--always", "--dirty", "--tags"]
    try:
        result = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
    return result.stdout.strip() or "unknown"


def package_version(package: str) -> str:
    """Version of an installed package, or "not installed", as for `rans` in a copy of its sources."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    """Name of the processor, which Linux provides only in a file."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "unknown")
