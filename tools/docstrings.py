"""Docstrings in the site."""

from __future__ import annotations

import re

import griffe

from cjt_gym.envs.arguments import PLACE, argument_table


class PlainDocstrings(griffe.Extension):
    """Read docstrings as they are meant: ``Example:`` holds code, ``:func:`` is only a mark.

    The place of the table of arguments takes the table.
    """

    def on_instance(self, *, obj: griffe.Object, **_: object) -> None:
        """Rewrite the text of one docstring."""
        if obj.docstring:
            text = re.sub(
                r":(?:func|class|data|mod|meth):`~?([^`]+)`", r"`\1`", obj.docstring.value
            )
            text = text.replace(PLACE, argument_table())
            obj.docstring.value = re.sub(r"(?m)^( *)Example:$", r"\1Examples:", text)
