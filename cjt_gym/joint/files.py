"""Joint files: reading and writing them, and the ones that ship with the package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from cjt_gym.disk.text import read_text
from cjt_gym.errors import MissingFileError, ParameterError, unknown_name
from cjt_gym.joint.drives import DRIVES
from cjt_gym.joint.effect_entries import usual_effects
from cjt_gym.joint.mistakes import Mistakes
from cjt_gym.joint.parameters import JointParameters, check_quantities, content_of, sha256_of
from cjt_gym.joint.quantity import FrozenMapping, Plain, Quantity, Setting, freeze
from cjt_gym.joint.structures import STRUCTURES
from cjt_gym.joint.toml_format import Document, parse_document
from cjt_gym.joint.toml_writer import write_document

__all__ = ["JointFile", "joint_names", "load_joint_file", "to_toml"]

TOOLBOX_SUFFIX = ".m"


@dataclass(frozen=True)
class JointFile:
    """The content of a joint file.

    Attributes:
        parameters: The validated parameters.
        effects: Settings by effect name, then by key: quantities, or texts such as "body". Their
            names are checked by the effect table, not here.
        sensors: "resolution" and "noise" by channel.
        sampling: "dt", "dt_electrical" and "jitter".
        structure: Structure of the joint unless another is asked for; None if the file names none.
        drive: Its drive, likewise.
        found: What a diagnosis says of how it found the values, as plain data.
    """

    parameters: JointParameters
    effects: Mapping[str, Mapping[str, Setting]] = field(default_factory=FrozenMapping)
    sensors: Mapping[str, Mapping[str, Quantity]] = field(default_factory=FrozenMapping)
    sampling: Mapping[str, Quantity] = field(default_factory=FrozenMapping)
    structure: str | None = None
    drive: str | None = None
    found: Mapping[str, Plain] = field(default_factory=FrozenMapping)

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "effects", FrozenMapping({k: FrozenMapping(v) for k, v in self.effects.items()})
        )
        object.__setattr__(
            self, "sensors", FrozenMapping({k: FrozenMapping(v) for k, v in self.sensors.items()})
        )
        object.__setattr__(self, "sampling", FrozenMapping(self.sampling))
        object.__setattr__(self, "found", freeze(self.found))

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.parameters.name

    def hash_hex(self) -> str:
        """Return the SHA-256 over axis, parameters, effects, sensors and sampling, in hexadecimal.

        Names, sources and tolerances do not count: they change no simulation. Nor do structure and
        drive, which are only what the joint is unless told otherwise.
        """
        tables = {"effects": self.effects, "sensors": self.sensors}
        nested = {
            title: {
                name: {k: content_of(v) for k, v in entries.items()}
                for name, entries in table.items()
            }
            for title, table in tables.items()
        }
        sampling = {key: content_of(quantity) for key, quantity in self.sampling.items()}
        return sha256_of(self.parameters.content() | nested | {"sampling": sampling})


def joint_names() -> tuple[str, ...]:
    """Return the names of the shipped joints."""
    folder = resources.files("cjt_gym.params")
    return tuple(
        sorted(
            entry.name[: -len(".toml")]
            for entry in folder.iterdir()
            if entry.name.endswith(".toml")
        )
    )


def load_joint_file(name_or_path: str | Path) -> JointFile:
    """Read and check a joint file.

    Args:
        name_or_path: Name of a joint that ships with the package (see `joint_names`), or path of
            a TOML file, or of a parameter file of the Compliant Joint Toolbox (`.m`).

    Raises:
        UnknownNameError: No joint of this name ships with the package.
        MissingFileError: There is no file at this path.
        ParameterError: The file breaks the format, or a parameter is out of range.

    Example:
        >>> load_joint_file("orange_80_6000").parameters.k_b
        6000.0
    """
    if is_path(name_or_path):
        path = Path(name_or_path).expanduser()
        if path.suffix == TOOLBOX_SUFFIX:
            from cjt_gym.joint.toolbox_files import read_toolbox

            return read_toolbox(name_or_path)
        return _parsed(read_joint_text(path), str(name_or_path))
    name = str(name_or_path)
    if name not in joint_names():
        raise unknown_name("joint", name, joint_names())
    text = (resources.files("cjt_gym.params") / f"{name}.toml").read_text(encoding="utf-8")
    return _parsed(text, f"params/{name}.toml")


def to_toml(joint_file: JointFile) -> str:
    """Return the text of a joint file that `load_joint_file` reads back to an equal one."""
    p = joint_file.parameters
    document = Document(
        name=p.name,
        source=p.source,
        axis=p.axis,
        parameters=FrozenMapping(p.quantities),
        effects=FrozenMapping(
            {name: FrozenMapping(entries) for name, entries in joint_file.effects.items()}
        ),
        sensors=FrozenMapping(
            {name: FrozenMapping(entries) for name, entries in joint_file.sensors.items()}
        ),
        sampling=FrozenMapping(joint_file.sampling),
        structure=joint_file.structure,
        drive=joint_file.drive,
        found=freeze(joint_file.found),
    )
    return write_document(document)


def is_path(name_or_path: str | Path) -> bool:
    """Return whether this is the path of a file rather than the name of a shipped joint."""
    if isinstance(name_or_path, Path):
        return True
    return (
        name_or_path.endswith((".toml", TOOLBOX_SUFFIX))
        or "/" in name_or_path
        or "\\" in name_or_path
    )


def read_joint_text(path: Path) -> str:
    """Return the text of a joint file.

    Raises:
        MissingFileError: There is no file at this path.
        ParameterError: It is not a text.
    """
    try:
        return read_text(path, ParameterError)
    except FileNotFoundError as error:
        raise MissingFileError(
            f"The joint file {path} does not exist. Give the path of a TOML file or one of: "
            f"{', '.join(joint_names())}."
        ) from error
    except OSError as error:
        raise ParameterError(
            f"The joint file {path} cannot be read: {error}. It must be a UTF-8 text file."
        ) from error


def _parsed(text: str, origin: str) -> JointFile:
    """Return the joint file for a text, or raise all of its mistakes at once."""
    mistakes = Mistakes(origin)
    document = parse_document(text, origin, mistakes)
    for key, known in (("structure", STRUCTURES), ("drive", DRIVES)):
        name = getattr(document, key)
        if name is not None and name not in known:
            mistakes.found.append(f"{key} of {origin}: {unknown_name(key, name, known)}")
    with mistakes.collected():
        check_quantities(document.parameters, document.axis, origin, not mistakes.found)
    effects = usual_effects(document.effects, document.axis, origin, mistakes)
    mistakes.check()
    parameters = JointParameters(
        document.name, document.source, document.parameters, document.axis, origin
    )
    return JointFile(
        parameters,
        effects,
        document.sensors,
        document.sampling,
        document.structure,
        document.drive,
        document.found,
    )
