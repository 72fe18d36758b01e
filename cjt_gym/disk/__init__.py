"""Files: written whole or not at all, and read without trust.

=============  =========================================================================
`whole_files`  a file that appears whole or not at all; which names and places are refused
`limits`       how much a file may make of itself
`parsing`      whatever a third-party parser raises, as one error of this package
`text`         TOML and JSON, read
`toml_writer`  TOML, written
`arrays`       NumPy archives
=============  =========================================================================
"""

from cjt_gym.disk.limits import BYTES_OF_TEXT, COLUMNS, NUMBERS, Limit
from cjt_gym.disk.parsing import parsed_each, parsing
from cjt_gym.disk.text import parse_json, parse_toml, read_json, read_toml
from cjt_gym.disk.toml_writer import Inline, to_toml, toml_text
from cjt_gym.disk.whole_files import (
    check_file_name,
    lock,
    refuse_inputs,
    whole,
    write_bytes,
    write_text,
)

__all__ = [
    "BYTES_OF_TEXT",
    "COLUMNS",
    "NUMBERS",
    "Inline",
    "Limit",
    "check_file_name",
    "lock",
    "parse_json",
    "parse_toml",
    "parsed_each",
    "parsing",
    "read_json",
    "read_toml",
    "refuse_inputs",
    "to_toml",
    "toml_text",
    "whole",
    "write_bytes",
    "write_text",
]
