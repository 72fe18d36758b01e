"""Docstrings in the site."""

from __future__ import annotations

import inspect
import pydoc
import re

import griffe


class PlainDocstrings(griffe.Extension):
    """Read docstrings as they are meant: ``Example:`` holds code, ``:func:`` is only a mark.

    Tables that are made when a class is, such as that of arguments, stand in its own docstring.
    """

    def on_instance(self, *, obj: griffe.Object, **_: object) -> None:
        """Rewrite the text of one docstring."""
        if obj.docstring:
            text = obj.docstring.value
            if re.search(r"(?m)^ *\{\w+\}$", text):
                text = inspect.getdoc(pydoc.locate(obj.path)) or text
            text = re.sub(r":(?:func|class|data|mod|meth):`~?([^`]+)`", r"`\1`", text)
            obj.docstring.value = re.sub(r"(?m)^( *)Example:$", r"\1Examples:", text)
