"""Mend the bag of a run whose recorder was killed."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from imotor_ros.bag import facts, layout
from imotor_ros.bag.reader import BagMessage, RunBag
from imotor_ros.bag.records import McapFile
from imotor_ros.bag.storage import lock, sync
from imotor_ros.bag.writer import RunWriter
from imotor_ros.contracts.topics import ALL_TOPICS, DEFAULT_NAMESPACE, Intent, Topic
from imotor_ros.errors import BadInputError, RecordingError, UnreadableFileError

_WORKSHOP = ".recovering"
_INFORMATION = "rosbag2_bagfile_information"


@dataclass(frozen=True)
class RecoveryReport:
    """
    What was done to a bag.

    Attributes
    ----------
    path : str
        The bag, whole now.
    was_whole : bool
        Whether there was nothing to mend.
    damage : str
        What was wrong.
    original : str
        Where the damaged file is kept; empty if nothing was replaced.
    messages : int
        Messages saved.
    samples, lost : dict of str to int
        Samples saved by stream, and samples missing between them.

    """

    path: str
    was_whole: bool
    damage: str = ""
    original: str = ""
    messages: int = 0
    samples: dict[str, int] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)

    def to_mapping(self) -> dict[str, Any]:
        """Return the report as plain JSON."""
        return asdict(self)

    def __str__(self) -> str:
        if self.was_whole:
            return f"{self.path}: nothing to mend"
        lines = [f"{self.path}: mended ({self.damage})"]
        if self.original:
            lines.append(f"  the damaged file is kept as {self.original}")
        lines.append(f"  {self.messages} messages saved")
        lines += [
            f"  {name}: {count} samples" + (f", {self.lost[name]} lost" if self.lost[name] else "")
            for name, count in self.samples.items()
        ]
        return "\n".join(lines)


def recover(path: Path | str, output: Path | str | None = None) -> RecoveryReport:
    """
    Mend a bag that was not closed: save all messages up to where the file breaks off.

    A bag that is whole is left alone, or copied to `output`. In place, the damaged file is kept
    beside the new one as `<name>.mcap.damaged`, and the new one takes its place in one step: at
    every moment the bag is either as it was or mended.

    Parameters
    ----------
    path : Path
        The bag's folder, or one of its files.
    output : Path, optional
        Folder to write the mended bag to, instead of in place.

    Raises
    ------
    UnreadableFileError
        If there is no bag, or nothing of a run in it.
    BadInputError
        If it is being recorded, or `output` exists.
    RecordingError
        If the mended bag cannot be written.

    """
    file = layout.find_mcap(Path(path))
    with _locked(file), RunBag(file, allow_damaged=True) as bag:
        if not bag.damage:
            _verify(bag)
        if not bag.damage:
            shown = str(path if output is None else output)
            if output is not None:
                file = _copy(file, Path(output))
            if _restore_metadata(file):
                damage = f"{layout.METADATA} did not fit"
                return RecoveryReport(shown, was_whole=False, damage=damage)
            return RecoveryReport(shown, was_whole=True)
        if output is not None:
            return _save(bag, Path(output), str(output))
        return _save_in_place(bag, file, str(path))


def _verify(bag: RunBag) -> None:
    """Read a bag whose end is whole to that end; note if it is damaged inside."""
    try:
        for _ in bag.messages():
            pass
    except UnreadableFileError as error:
        bag.distrust(str(error))


def _copy(file: Path, folder: Path) -> Path:
    """Copy a whole bag file, with the metadata beside it, to a new folder; return the copy."""
    metadata = file.parent / layout.METADATA
    target = folder / file.name
    try:
        folder.mkdir(parents=True)
        shutil.copy2(file, target)
        if metadata.exists():
            shutil.copy2(metadata, folder)
        else:
            (folder / layout.UNFINISHED).touch()  # has its metadata made
    except FileExistsError:
        raise BadInputError("exists already", where=str(folder), bound="a new folder") from None
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be written: {error.strerror}") from error
    return target


def _save_in_place(bag: RunBag, file: Path, shown: str) -> RecoveryReport:
    workshop = file.parent / _WORKSHOP
    shutil.rmtree(workshop, ignore_errors=True)
    try:
        made = workshop / file.stem
        report = _save(bag, made, shown)
        kept = _keep(file)
        (made / file.name).replace(file)
        _restore_metadata(file)
    finally:
        shutil.rmtree(workshop, ignore_errors=True)
    return replace(report, original=str(kept))


def _save(bag: RunBag, folder: Path, shown: str) -> RecoveryReport:
    """Write what the bag holds to a new folder."""
    writer = RunWriter(
        folder,
        run_id=bag.run_id,
        run_info=bag.run_info,
        provenance=bag.facts.provenance,
        topics=[_topic(*item) for item in bag.topics.items()] or ALL_TOPICS,
        namespace=bag.namespace if bag.topics else DEFAULT_NAMESPACE,
        is_simulated=bag.facts.is_simulated,
        types=bag.types if bag.topics else None,
    )
    saved, last = 0, -1
    with writer:
        for message in bag.messages():
            if message.time > last and _is_intact(bag, message):
                writer.write(message.topic, message.data, message.time)
                saved, last = saved + 1, message.time
        writer.close(facts.RECOVERED)
    return RecoveryReport(
        path=shown,
        was_whole=False,
        damage=bag.damage,
        messages=saved,
        samples={name: ledger.received for name, ledger in writer.ledgers.items()},
        lost={name: ledger.lost for name, ledger in writer.ledgers.items()},
    )


def _topic(name: str, type_name: str) -> Topic:
    for topic in ALL_TOPICS:
        if (topic.name, topic.type_name) == (name, type_name):
            return topic
    return Topic(name, type_name, Intent.STATUS)


def _is_intact(bag: RunBag, message: BagMessage) -> bool:
    try:
        bag.decode(message)
    except UnreadableFileError:
        return False
    return True


def _keep(file: Path) -> Path:
    """Give the damaged file a second name, under which it stays; return that."""
    number = 0
    while True:
        kept = file.with_name(f"{file.name}.damaged" + (f".{number}" if number else ""))
        if not kept.exists():
            break
        if kept.samefile(file):  # by a recovery that was interrupted
            return kept
        number += 1
    try:
        kept.hardlink_to(file)
    except OSError:  # a file system without hard links
        shutil.copy2(file, kept)
    return kept


def _restore_metadata(file: Path) -> bool:
    """Write metadata.yaml anew from the copy in a whole file, where it is missing or wrong."""
    folder = file.parent
    shutil.rmtree(folder / _WORKSHOP, ignore_errors=True)
    marker, target = folder / layout.UNFINISHED, folder / layout.METADATA
    is_bag = folder.name == file.stem or marker.exists() or target.exists()
    with closing(McapFile(file)) as mcap:
        information = YAML(typ="safe").load(mcap.metadata)
    is_stale = is_bag and _message_count(target) != information["message_count"]
    if is_stale:
        draft = folder / f"{layout.METADATA}.new"
        yaml = YAML(typ="safe")
        yaml.default_flow_style = False
        yaml.dump({_INFORMATION: information}, draft)
        sync(draft)
        draft.replace(target)
    marker.unlink(missing_ok=True)
    sync(folder)
    return is_stale


def _message_count(metadata: Path) -> int | None:
    try:
        content = YAML(typ="safe").load(metadata.read_text(encoding="utf-8"))
        return int(content[_INFORMATION]["message_count"])
    except (OSError, YAMLError, KeyError, TypeError, ValueError):
        return None


@contextmanager
def _locked(file: Path) -> Iterator[None]:
    """Keep others from writing the file meanwhile."""
    try:
        stream = file.open("rb")
    except OSError as error:
        cause = error.strerror or str(error)
        raise UnreadableFileError(f"cannot be read ({cause})", where=str(file)) from error
    with stream:
        if not lock(stream.fileno()):
            raise BadInputError("is being recorded", where=str(file), bound="a bag left behind")
        yield
