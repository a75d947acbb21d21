"""Errors in the words of the command line: options, not the parameters behind them."""

from __future__ import annotations

import argparse
import re

from imotor_ros.errors import BadInputError

_DESTINATIONS = {
    "maximum_frequency": "max_frequency",
    "suppressed_harmonics": "suppressed",
    "spring_stiffness": "load_stiffness",
    "constant_force": "load_force",
    "slider mass": "mass",
}
"""Parameters that an option sets under another name."""

_PARAMETER = re.compile(r"(?:\w+\.)?([a-z][a-z_ ]*)")
"""A parameter with or without its class; what stands in a file has the file before it."""


def in_words_of(parser: argparse.ArgumentParser, error: BadInputError) -> BadInputError:
    """
    Return an error that names the option which set the parameter, or the error itself.

    Parameters
    ----------
    parser : ArgumentParser
        What has read the command line.
    error : BadInputError
        What was raised.

    """
    match = _PARAMETER.fullmatch(error.where)
    if type(error) is not BadInputError or match is None:
        return error
    destination = _DESTINATIONS.get(match[1], match[1])
    for action in parser._actions:
        if action.dest == destination and action.option_strings:
            return BadInputError(
                error.what, where=action.option_strings[-1], value=error.value, bound=error.bound
            )
    return error
