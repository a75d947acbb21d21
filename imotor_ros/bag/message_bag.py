"""The messages of a run's bag, and what the bag says of the run beside them."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from imotor_ros.bag import layout
from imotor_ros.bag.facts import RunFacts, metadata_texts
from imotor_ros.bag.records import McapFile, StoredMessage
from imotor_ros.bag.storage import is_locked
from imotor_ros.bag.types import BagTypes
from imotor_ros.contracts.topics import RUN_INFO
from imotor_ros.errors import BadInputError, UnreadableFileError

_PACKAGE = "imotor_msgs/"
_FIRST_MESSAGES = 1000
_ADVICE = "a bag that was closed; `imotor recover` mends one that was not"


@dataclass(frozen=True)
class BagMessage:
    """
    One message of a bag.

    Attributes
    ----------
    topic : str
        Name of its topic, as in the contracts.
    type_name : str
        Its type, e.g. "imotor_msgs/msg/SampleBlock".
    time : int
        Log time (ns since 1970).
    data : bytes
        The message as CDR.

    """

    topic: str
    type_name: str
    time: int
    data: bytes


class MessageBag:
    """
    The bag of one run as messages, open until `close` or to the end of a `with` block.

    Needs no message package: a bag holds the definitions of its messages.

    Parameters
    ----------
    path : Path
        The bag's folder, or its MCAP or metadata.yaml file.
    allow_damaged : bool
        Whether to read what there is of a bag that was not closed; its end state is then
        "unfinished".

    Attributes
    ----------
    facts : RunFacts
        What the bag says of its run beside the messages.

    Raises
    ------
    UnreadableFileError
        If there is no such bag, it was not closed, it is that of something else than a run, or
        it was written by a newer version.

    """

    def __init__(self, path: Path | str, *, allow_damaged: bool = False) -> None:
        self.path = Path(path)
        self.file = layout.find_mcap(self.path)
        self._names: dict[int, str] = {}
        self._mcap = McapFile(self.file)
        try:
            if self._mcap.damage and not allow_damaged:
                if is_locked(self.file):
                    raise UnreadableFileError("is being recorded", where=str(self.file))
                what = f"is damaged: {self._mcap.damage}"
                raise UnreadableFileError(what, where=str(self.file), bound=_ADVICE)
            self.facts = self._read_facts()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the bag."""
        self._mcap.close()

    def __enter__(self) -> Self:
        """Return the bag."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bag."""
        self.close()

    def distrust(self, reason: str) -> None:
        """Read on as from a damaged file, although its end is whole."""
        self._mcap.distrust(reason)

    # ---- facts of the run ----------------------------------------------------------------------

    @property
    def damage(self) -> str:
        """What is wrong with the file; empty if nothing."""
        return self._mcap.damage

    @property
    def run_id(self) -> str:
        """Name of the run."""
        return self.facts.run_id

    @property
    def run_info(self) -> Mapping[str, Any]:
        """All that is needed to repeat the run."""
        return self.facts.run_info

    @property
    def end_state(self) -> str:
        """How the run ended."""
        return self.facts.end_state

    @property
    def result(self) -> Mapping[str, Any] | None:
        """What came out of the run, if it was stated."""
        return self.facts.result

    @property
    def namespace(self) -> str:
        """Namespace of the stand, e.g. "/stand"."""
        return layout.namespace_of({c.topic: c.type_name for c in self._mcap.channels.values()})

    @cached_property
    def topics(self) -> dict[str, str]:
        """Message type by topic, named as in the contracts."""
        return {self._name(key): c.type_name for key, c in self._mcap.channels.items()}

    @cached_property
    def message_counts(self) -> dict[str, int]:
        """Number of messages by topic, named as in the contracts."""
        counts = self._mcap.counts
        if self.damage:
            counts = dict.fromkeys(self._mcap.channels, 0)
            for message in self._mcap.messages():
                counts[message.channel] += 1
        return {self._name(key): counts.get(key, 0) for key in self._mcap.channels}

    @cached_property
    def times(self) -> tuple[int, int]:
        """Log times (ns since 1970) of the first and the last message; zeros if there is none."""
        if not self.damage:
            return self._mcap.times if any(self._mcap.counts.values()) else (0, 0)
        times = [message.time for message in self._mcap.messages()]
        return (min(times), max(times)) if times else (0, 0)

    # ---- messages ------------------------------------------------------------------------------

    def messages(self, *topics: str) -> Iterator[BagMessage]:
        """
        Yield messages in the order of the bag.

        Parameters
        ----------
        *topics : str
            Names of the topics wanted, as in the contracts; none for all.

        Raises
        ------
        UnreadableFileError
            If the bag is damaged inside.

        """
        for message in self._mcap.messages(self._numbers(topics) if topics else None):
            yield self._named(message)

    def decode(self, message: BagMessage) -> Any:
        """
        Return the content of a message.

        Raises
        ------
        UnreadableFileError
            If it is not of its type.

        """
        try:
            return self.types.deserialize(message.data, message.type_name)
        except BadInputError as error:
            raise UnreadableFileError(str(error), where=f"{self.file}: {message.topic}") from error

    # ---- inside --------------------------------------------------------------------------------

    def _name(self, number: int) -> str:
        return layout.relative_name(self.namespace, self._mcap.channels[number].topic)

    def _named(self, message: StoredMessage) -> BagMessage:
        if message.channel not in self._names:  # a damaged file tells its channels on the way
            self._names[message.channel] = self._name(message.channel)
        kind = self._mcap.channels[message.channel].type_name
        return BagMessage(self._names[message.channel], kind, message.time, bytes(message.data))

    def _numbers(self, topics: Collection[str]) -> set[int]:
        for topic in topics:
            if topic not in self.topics:
                raise BadInputError(
                    "is not a topic of the bag",
                    where=str(self.path),
                    value=topic,
                    bound="one of " + ", ".join(sorted(self.topics)),
                )
        return {key for key in self._mcap.channels if self._name(key) in topics}

    @cached_property
    def types(self) -> BagTypes:
        """The message types that the bag defines."""
        return BagTypes.from_definitions(
            {c.type_name: c.definition for c in self._mcap.channels.values()}
        )

    def _read_facts(self) -> RunFacts:
        where = str(self.path)
        if not self.damage:
            return RunFacts.from_texts(metadata_texts(self._mcap.metadata, where), where)
        for _ in self._mcap.messages():  # finds the channels
            break
        try:
            text = (self.file.parent / layout.UNFINISHED).read_text(encoding="utf-8")
        except OSError:
            return self._facts_from_messages()
        return RunFacts.from_texts(_json_object(text), where)

    def _facts_from_messages(self) -> RunFacts:
        """Return what the run info tells, or any message of the run: one of the first."""
        facts = None
        for message in islice(self.messages(), _FIRST_MESSAGES):
            if message.topic == RUN_INFO.name:
                content = self.decode(message)
                return RunFacts(content.run_id, _json_object(content.json))
            if facts is None and message.type_name.startswith(_PACKAGE):
                facts = RunFacts(self.decode(message).run_id)
        if facts is None:
            raise UnreadableFileError("holds nothing of a run", where=str(self.path))
        return facts


def _json_object(text: str) -> dict[str, Any]:
    """Return the JSON object in a text; an empty one if there is none."""
    try:
        content = json.loads(text)
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}
