"""What a bag says of its run beside the messages: the metadata, as text by key and as objects."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import yaml

from imotor_ros.contracts.blocks import StreamLedger
from imotor_ros.errors import BadInputError, UnreadableFileError

SCHEMA_VERSION = 1
"""Grows when a reader of the old form cannot read the new one."""

RECOVERED = "recovered"
"""End state of a bag that `recover` mended."""

UNFINISHED = "unfinished"
"""End state of a bag that was not closed."""

StreamCounts = Mapping[str, Mapping[str, float]]
"""By stream: samples received and lost, flags, blocks rejected, sample rate (Hz)."""

_PREFIX = "imotor_"
_SCHEMA, _RUN_ID, _END_STATE = "imotor_schema", "imotor_run_id", "imotor_end_state"
_DIGEST = "imotor_run_info_sha256"


@dataclass(frozen=True)
class RunFacts:
    """
    What a bag says of its run.

    Attributes
    ----------
    run_id : str
        Name of the run.
    run_info : mapping
        All that is needed to repeat it, as plain JSON.
    provenance : mapping
        Versions, host and start: what differs when it is repeated.
    is_simulated : bool
        Whether log times follow the sample index.
    end_state : str
        How it ended.
    result : mapping or None
        What came out, as plain JSON.
    streams : mapping or None
        What came of each stream; see `StreamCounts`. None in a bag that was not closed.

    """

    run_id: str
    run_info: Mapping[str, Any] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    is_simulated: bool = True
    end_state: str = UNFINISHED
    result: Mapping[str, Any] | None = None
    streams: StreamCounts | None = None

    @property
    def run_info_digest(self) -> str:
        """SHA-256 of the run info as canonical JSON, in hexadecimal."""
        return hashlib.sha256(to_json(self.run_info, "run_info").encode()).hexdigest()

    def to_texts(self) -> dict[str, str]:
        """
        Return the facts as the bag's metadata hold them: texts by key.

        Raises
        ------
        BadInputError
            If JSON cannot hold one of them.

        """
        return {
            _SCHEMA: str(SCHEMA_VERSION),
            _RUN_ID: self.run_id,
            _END_STATE: self.end_state,
            _DIGEST: self.run_info_digest,
            **{_PREFIX + key: to_json(getattr(self, key), key) for key in _JSON_KEYS},
        }

    @classmethod
    def from_texts(cls, texts: Mapping[str, str], where: str) -> Self:
        """
        Return the facts of which `to_texts` made texts.

        Parameters
        ----------
        texts : mapping of str to str
            The metadata; keys of others are passed over.
        where : str
            The bag, for errors.

        Raises
        ------
        UnreadableFileError
            If they are not those of a run, are of a newer version, or do not parse.

        """
        version = texts.get(_SCHEMA, "")
        if not version:
            raise UnreadableFileError(
                "holds no run", where=where, bound="a bag written by this package"
            )
        if not version.isdigit() or int(version) > SCHEMA_VERSION:
            raise UnreadableFileError(
                "was written by a newer version",
                where=where,
                value=f"schema {version}",
                bound=f"schema <= {SCHEMA_VERSION}",
            )
        try:
            known = {k: json.loads(texts[_PREFIX + k]) for k in _JSON_KEYS if _PREFIX + k in texts}
        except ValueError as error:
            raise UnreadableFileError("has metadata that are not JSON", where=where) from error
        return cls(
            run_id=texts.get(_RUN_ID, ""), end_state=texts.get(_END_STATE, UNFINISHED), **known
        )


_JSON_KEYS = ("run_info", "provenance", "is_simulated", "result", "streams")


def to_json(value: Any, where: str) -> str:
    """
    Return a value as JSON on one line, keys sorted, so that equal values give equal text.

    Numbers that are not finite become null, NumPy scalars numbers, tuples lists.

    Raises
    ------
    BadInputError
        If JSON cannot hold the value.

    """
    try:
        return json.dumps(_plain(value), sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise BadInputError(f"cannot be written as JSON ({error})", where=where) from error


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if hasattr(value, "item") and not hasattr(value, "__len__"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def stream_counts(ledgers: Mapping[str, StreamLedger], rejected: Mapping[str, int]) -> StreamCounts:
    """Return what the ledgers say, and how many blocks were rejected."""
    return {
        name: {
            "received": ledger.received,
            "lost": ledger.lost,
            "flags": ledger.flags,
            "rejected": rejected.get(name, 0),
            "sample_rate": ledger.sample_rate,
        }
        for name, ledger in ledgers.items()
    }


def metadata_texts(metadata: str, where: str) -> dict[str, str]:
    """
    Return the texts by key that a bag's metadata hold beside those of rosbag2.

    Raises
    ------
    UnreadableFileError
        If the metadata do not parse.

    """
    try:
        # all scalars stay text, as they were written; the compiled parser is twenty times as fast
        loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
        data = (yaml.load(metadata, Loader=loader) or {}).get("custom_data") or {}
        if data == "null":
            return {}
        return {str(key): str(value) for key, value in data.items()}
    except (yaml.YAMLError, AttributeError) as error:
        raise UnreadableFileError("has metadata that do not parse", where=where) from error
