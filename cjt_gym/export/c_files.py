"""Controllers and observers as C headers, tried against Python where there is a compiler."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cjt_gym.baselines import Controller
from cjt_gym.baselines.observers import LinearObserver
from cjt_gym.export.c_check import Checked, check_controller, check_observer
from cjt_gym.export.c_controller import controller_header
from cjt_gym.export.c_law import law_of
from cjt_gym.export.c_observer import observer_header
from cjt_gym.joint import Joint

TRIED = "law"


@dataclass(frozen=True)
class Header:
    """A header in C.

    Attributes:
        text: The file.
        checked: How it compares with Python.
    """

    text: str
    checked: Checked


def controller_to_c(
    controller: Controller,
    joint: Joint,
    name: str,
    prefix: str | None = None,
    gains: Mapping[str, float] | None = None,
) -> Header:
    """Return a controller as a C header: its whole loop, with limit and anti-windup.

    Args:
        controller: The controller.
        joint: The joint that it is for.
        name: Its name.
        prefix: What names in the header begin with; its name where None is given.
        gains: Its gains, which a comment lists.

    Raises:
        ConfigurationError: What it does cannot be written in C.
        ExportError: The header does otherwise than the controller.
    """
    law, told = law_of(controller, name), _told(joint)

    def text(begin: str) -> str:
        return controller_header(law, begin, name, told, gains or {})

    return Header(text(prefix or name), check_controller(controller, joint, text(TRIED)))


def observer_to_c(
    observer: LinearObserver, joint: Joint, name: str, prefix: str | None = None
) -> Header:
    """Return an observer as a C header.

    Args:
        observer: The observer.
        joint: The joint that it is for.
        name: Its name.
        prefix: What names in the header begin with; its name where None is given.

    Raises:
        ExportError: The header does otherwise than the observer.
    """
    told = _told(joint)
    text = observer_header(observer, prefix or name, name, told)
    tried = observer_header(observer, TRIED, name, told)
    return Header(text, check_observer(observer, joint, tried))


def _told(joint: Joint) -> str:
    return f"{joint.parameters.name}, {joint.structure}"
