"""Files that appear whole or not at all, under names and in places that harm nothing else."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from cjt_gym.errors import ConfigurationError

LONGEST: Final = 200
"""Bytes of a file name, without its ending; most file systems take 255."""
FORBIDDEN: Final = frozenset('/\\:*?"<>|')


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """Write a file beside its place; it takes that place once all of it is on the disk.

    Whatever happens meanwhile, such as a full disk or a kill, leaves the file that was there, or
    none. What is no file, such as ``/dev/stdout``, is written to directly; a symbolic link stays
    one, and the file that it leads to is replaced.

    Args:
        path: The file.

    Yields:
        Path to write to, with the same ending.

    Raises:
        OSError: It cannot be written.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     with whole(Path(folder, "a.txt")) as part:
        ...         _ = part.write_text("all of it")
        ...     [file.name for file in Path(folder).iterdir()]
        ['a.txt']
    """
    path = Path(path)
    place = Path(os.path.realpath(path))
    if place.exists() and not place.is_file():
        yield path
        return
    part = place.with_name(f".{secrets.token_hex(6)}.part{place.suffix[:32]}")
    try:
        mode = _mode_of(place)
        os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        if mode is not None:
            part.chmod(mode)
        yield part
        with part.open("r+b") as file:
            os.fsync(file.fileno())  # so that a full disk is noticed
        part.replace(place)
    except BaseException as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(part), part):
            error.filename = str(path)
        raise


def write_text(path: str | Path, text: str) -> Path:
    """Write a text in UTF-8, whole or not at all; return the path."""
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | Path, data: bytes) -> Path:
    """Write a file, whole or not at all; return the path."""
    with whole(path) as part:
        part.write_bytes(data)
    return Path(path)


def check_file_name(name: str, owner: str) -> None:
    """Raise ConfigurationError unless a name can be that of a file in a folder, and only there."""
    good = name.isprintable() and not FORBIDDEN.intersection(name) and name.strip(" .") == name
    if not (good and name) or len(os.fsencode(name)) > LONGEST:
        raise ConfigurationError(
            f"{owner} must be a name that a file can have: 1 to {LONGEST} printable characters "
            f"without {' '.join(sorted(FORBIDDEN))}, and no blank or dot at its ends, got "
            f"{name[:LONGEST]!r}."
        )


def refuse_inputs(outputs: Sequence[Path], inputs: Sequence[str | Path | None]) -> None:
    """Raise ConfigurationError if a file that is to be written is one that was read."""
    read = [Path(path) for path in inputs if path is not None and Path(path).is_file()]
    for output in outputs:
        for path in read:
            if output.exists() and output.samefile(path):
                raise ConfigurationError(
                    f"{output} is what was read and would be overwritten. Give another --out."
                )


def lock(handle: int) -> None:
    """Lock an open file for this process, until it is closed.

    Raises:
        OSError: Another process, or another part of this one, has locked it.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
        return
    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _mode_of(place: Path) -> int | None:
    """Return the permissions of a file that is there, which must be one that may be written."""
    if not place.exists():
        return None
    if not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(place))
    return place.stat().st_mode & 0o7777
