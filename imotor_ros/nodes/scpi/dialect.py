"""Dialects: what instruments of a family are told and asked, as templates in a YAML file."""

from __future__ import annotations

import os
import re
import string
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

import imotor_ros
from imotor_ros.errors import BadInputError, UnknownKeyError, UnreadableFileError
from imotor_ros.nodes.scpi.words import WordFormat

Commands = tuple[str, ...]

_GENERATOR_NAMES = (
    "output", "name", "points", "rate", "frequency", "duration", "peak_to_peak",
)  # fmt: skip
_OSCILLOSCOPE_NAMES = (
    "input", "scale", "span", "offset", "rate", "points", "before", "before_percent", "duration",
    "centre", "trigger_source", "trigger_level", "first", "last", "count",
)  # fmt: skip
PREAMBLE_NAMES = (
    "points", "x_increment", "x_origin", "y_increment", "y_reference", "y_origin",
)  # fmt: skip
"""What the preamble of a record must tell; "-" stands for an entry of no interest."""


@dataclass(frozen=True)
class GeneratorDialect:
    """
    What a waveform generator is told and asked.

    Attributes
    ----------
    family : str
        Which instruments these are.
    identity : str
        Regular expression that the start of the answer to ``*IDN?`` matches.
    error_query, no_error : str
        Asks for the next error; regular expression that the start of the answer matches if there
        is none.
    words : WordFormat
        Samples in an upload.
    shortest_record : int
        Fewest samples of a record.
    reset, arrange : tuple of str
        Told after connecting, and before an upload.
    upload : str
        Told right before the block of samples.
    enable : tuple of str
        Told after an upload: from then on the output waits for the trigger at 0 V.
    trigger : str
        Starts the record.
    amplitude : str
        Changes the amplitude while it plays; empty if it cannot.
    disable : tuple of str
        Switches the output off.

    """

    family: str
    identity: str
    error_query: str
    no_error: str
    words: WordFormat
    shortest_record: int
    reset: Commands
    arrange: Commands
    upload: str
    enable: Commands
    trigger: str
    disable: Commands
    amplitude: str = ""


@dataclass(frozen=True)
class OscilloscopeDialect:
    """
    What an oscilloscope is told and asked.

    Attributes
    ----------
    family, identity, error_query, no_error, words
        As in `GeneratorDialect`; the words are those of a record.
    divisions : float
        Divisions of the screen that all codes of a word span.
    reset, input, acquire, arm, disarm : tuple of str
        Told after connecting; for each input; for the acquisition; to wait for the trigger; to
        stop waiting.
    rate_query, points_query : str
        Ask for sample rate and record length as they are set; empty if that is left out.
    armed_query, armed : str
        Asks whether it waits for the trigger; regular expression of the answer then.
    done_query, done : str
        Asks whether the record is taken; regular expression of the answer then.
    busy_bit : int
        Bits that are zero in the answer when the record is taken; 0 if it is no number.
    select, segment : tuple of str
        Told before an input is read, and before each segment of its record; without the latter
        the record comes in one.
    preamble_query, preamble_separator : str
        Asks for the scaling of a record; what stands between the parts of the answer.
    preamble : tuple of str
        Names of these parts.
    data_query : str
        Asks for the samples of a segment.

    """

    family: str
    identity: str
    error_query: str
    no_error: str
    words: WordFormat
    divisions: float
    reset: Commands
    input: Commands
    acquire: Commands
    arm: Commands
    armed_query: str
    armed: str
    done_query: str
    done: str
    disarm: Commands
    select: Commands
    preamble_query: str
    preamble_separator: str
    preamble: Commands
    data_query: str
    segment: Commands = ()
    rate_query: str = ""
    points_query: str = ""
    busy_bit: int = 0


_KINDS: dict[str, tuple[type[Any], tuple[str, ...]]] = {
    "generator": (GeneratorDialect, _GENERATOR_NAMES),
    "oscilloscope": (OscilloscopeDialect, _OSCILLOSCOPE_NAMES),
}
_EXPRESSIONS = ("identity", "no_error", "armed", "done")

D = TypeVar("D", GeneratorDialect, OscilloscopeDialect)


def find_dialect(name: str) -> Path:
    """
    Return the file of a dialect.

    Parameters
    ----------
    name : str
        Name of a file under params/scpi/dialects/ without its ending, or the path of another.

    Raises
    ------
    UnreadableFileError
        If there is none.

    """
    if name.endswith((".yaml", ".yml")):
        return Path(name)
    roots = [Path(imotor_ros.__file__).parent.parent]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    roots += [Path(prefix) / "share" / "imotor_ros" for prefix in prefixes if prefix]
    folders = [root / "params" / "scpi" / "dialects" for root in roots]
    for folder in folders:
        if (folder / f"{name}.yaml").is_file():
            return folder / f"{name}.yaml"
    known = sorted({path.stem for folder in folders for path in folder.glob("*.yaml")})
    raise UnreadableFileError(
        "is no dialect", where="dialect", value=name,
        bound="a path ending in .yaml, or one of " + ", ".join(known),
    )  # fmt: skip


def load_dialect(name: str, kind: type[D]) -> D:
    """
    Return a dialect by name or path; see `find_dialect`.

    Raises
    ------
    BadInputError
        If the file is no dialect of that kind.

    """
    path = find_dialect(name)
    try:
        mapping = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UnreadableFileError(f"cannot be read: {error}", where=str(path)) from error
    made = dialect_from_mapping(mapping, str(path))
    if not isinstance(made, kind):
        wanted = next(word for word, (one, _) in _KINDS.items() if one is kind)
        raise BadInputError(
            "is a dialect of another kind", where=str(path), value=mapping["kind"], bound=wanted
        )
    return made


def dialect_from_mapping(mapping: Any, where: str) -> GeneratorDialect | OscilloscopeDialect:
    """
    Return a dialect.

    Raises
    ------
    BadInputError
        If a key is unknown, missing or wrong, or a template names what is not known there.

    """
    kind = mapping.get("kind") if isinstance(mapping, Mapping) else None
    if kind not in _KINDS:
        raise BadInputError(
            "is no dialect", where=f"{where}: kind", value=kind, bound="one of " + ", ".join(_KINDS)
        )
    cls, names = _KINDS[kind]
    known = {one.name: one for one in fields(cls)}
    for key in mapping:
        if key != "kind" and key not in known:
            raise UnknownKeyError(
                "is not a key", where=f"{where}: {key}", bound="one of " + ", ".join(known)
            )
    values = {}
    for key, one in known.items():
        if key in mapping:
            values[key] = _read(mapping[key], str(one.type), f"{where}: {key}", names)
        elif one.default is MISSING:
            raise BadInputError("is missing", where=f"{where}: {key}")
    _check_expressions(values, where)
    if "preamble" in values:
        missing = set(PREAMBLE_NAMES) - set(values["preamble"])
        if missing:
            raise BadInputError("does not tell", where=f"{where}: preamble", value=sorted(missing))
    made: GeneratorDialect | OscilloscopeDialect = cls(**values)
    return made


def _read(value: Any, type_name: str, where: str, names: tuple[str, ...]) -> Any:
    """Return a value of the type that a field has."""
    if type_name == "WordFormat":
        return WordFormat.from_mapping(value, where)
    if type_name == "Commands":
        if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
            raise BadInputError("is no list of texts", where=where, value=value)
        for one in value:
            _check_template(one, where, names)
        return tuple(value)
    wanted: Any = {"str": str, "int": int, "float": (int, float)}[type_name]
    if not isinstance(value, wanted) or isinstance(value, bool):
        raise BadInputError(f"is no {type_name}", where=where, value=value)
    if isinstance(value, str) and not where.endswith(_EXPRESSIONS):
        _check_template(value, where, names)
    return value


def _check_template(text: str, where: str, names: tuple[str, ...]) -> None:
    try:
        used = {name for _, name, _, _ in string.Formatter().parse(text) if name is not None}
    except ValueError as error:
        raise BadInputError(f"is no template: {error}", where=where, value=text) from error
    if unknown := used - set(names):
        raise BadInputError(
            "names what is not known", where=where, value=sorted(unknown)[0],
            bound="one of " + ", ".join(names),
        )  # fmt: skip


def _check_expressions(values: Mapping[str, Any], where: str) -> None:
    for key in _EXPRESSIONS:
        if key in values:
            try:
                re.compile(values[key])
            except re.error as error:
                raise BadInputError(
                    f"is no regular expression: {error}", where=f"{where}: {key}", value=values[key]
                ) from error
