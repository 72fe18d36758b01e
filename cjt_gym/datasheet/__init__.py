"""Data sheets: parameters, characteristics and plots of a joint on a few pages, as PDF or HTML.

`make_sheet` says what stands on a sheet, as plain blocks; `write_sheet` writes it. `quantities`
gives all numbers for programs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cjt_gym.characteristics import CHARACTERISTICS, acting, changing, characteristics
from cjt_gym.datasheet.blocks import Sheet
from cjt_gym.disk import write_bytes, write_text
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import JointFile

__all__ = ["FORMATS", "check_format", "check_out", "make_sheet", "quantities", "write_sheet"]

FORMATS = (".pdf", ".html", ".png")
MOST = 6  # joints that colours keep apart


def make_sheet(files: Sequence[JointFile]) -> Sheet:
    """Return the sheet of one joint, or of several side by side.

    Args:
        files: Joint files, one to six, all of the same kind of axis.

    Raises:
        ConfigurationError: There are none or too many, two of one name, or rotary and prismatic
            ones.
    """
    from cjt_gym.datasheet import content  # loads matplotlib

    if not 1 <= len(files) <= MOST:
        raise ConfigurationError(f"A sheet holds 1 to {MOST} joints, got {len(files)}.")
    _check_names(files)
    axes = {file.parameters.axis for file in files}
    if len(axes) > 1:
        raise ConfigurationError(
            "Joints of one sheet must have the same kind of axis, got rotary and prismatic ones. "
            "Write a sheet for each kind."
        )
    return content.make_sheet(files)


def check_format(path: str | Path) -> str:
    """Return the ending of a file to write, in lower case.

    Raises:
        ConfigurationError: No sheet is written in this format.
    """
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise ConfigurationError(
            f"The file to write must end in {', '.join(FORMATS)}, got '{Path(path).name}'."
        )
    return ending


def check_out(path: Path | None, *, optional: bool) -> None:
    """Refuse a command that names no file to write, or one of another format."""
    if path is not None:
        check_format(path)
    elif not optional:
        raise ConfigurationError(
            f"--out FILE is needed ({', '.join(FORMATS)}), or --json for the numbers only."
        )


def write_sheet(sheet: Sheet, path: str | Path) -> tuple[Path, ...]:
    """Write a sheet as PDF, as one HTML page, or as one PNG image per page; return the paths.

    Args:
        sheet: The sheet.
        path: File to write; its ending chooses the format. Images get a number each.

    Raises:
        ConfigurationError: The ending is another one.
    """
    path, ending = Path(path), check_format(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if ending == ".html":
        from cjt_gym.datasheet.html import to_html

        write_text(path, to_html(sheet))
        return (path,)
    from cjt_gym.datasheet.pdf import to_pdf

    pages = to_pdf(sheet, image=ending == ".png")
    if ending == ".pdf":
        write_bytes(path, pages[0])
        return (path,)
    paths = tuple(path.with_stem(f"{path.stem}_{k + 1}") for k in range(len(pages)))
    for page, image in zip(paths, pages, strict=True):
        write_bytes(page, image)
    return paths


def quantities(files: Sequence[JointFile]) -> dict[str, Any]:
    """Return parameters and characteristics of joints as plain data.

    Returns:
        ``{"joints": {joint: {name: value}}, "units": {name: unit}, "infinite": {joint: {name:
        what that means}}, "included": {joint: [effect]}}``. Parameters are those of the file;
        characteristics are those of the joint with the effects that are included. The winding
        inductance is there as `l_a` and, as in the toolbox, as `x`. A value that is infinite is
        None; what the parameters do not allow is absent.

    Raises:
        ConfigurationError: Two joints have the same name.
    """
    _check_names(files)
    joints: dict[str, dict[str, float | None]] = {}
    units: dict[str, str] = {}
    infinite: dict[str, dict[str, str]] = {}
    for file in files:
        p = file.parameters
        values = {symbol: quantity.number for symbol, quantity in p.quantities.items()}
        units |= {symbol: p.unit(symbol) for symbol in values}
        if "l_a" in values:
            values["x"], units["x"] = values["l_a"], units["l_a"]
        found = characteristics(acting(file))
        units |= {name: CHARACTERISTICS[name].unit(p.axis) for name in found}
        values |= found
        joints[file.name] = {k: v if math.isfinite(v) else None for k, v in values.items()}
        infinite[file.name] = {
            k: CHARACTERISTICS[k].infinite for k, v in values.items() if math.isinf(v)
        }
    included = {file.name: list(changing(file)) for file in files}
    return {"joints": joints, "units": units, "infinite": infinite, "included": included}


def _check_names(files: Sequence[JointFile]) -> None:
    names = [file.name for file in files]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise ConfigurationError(
            f"Every joint of a sheet needs a name of its own, got {repeated[0]} twice. Change name "
            "in one of the files."
        )
