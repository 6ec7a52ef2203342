"""Boxes and roles of an imported recording, drawn anew: the one change that a recording of others may see later."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydantic import ValidationError

from busybot.boards.spec import BoardSpec
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import first_fault
from busybot.datasets.dataset import Dataset
from busybot.datasets.importing.recording import KnownObject, boxes_of, link_of, placed_object, positions_of
from busybot.datasets.manifest import refuse_frozen
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.tables import episode_rows


def refuse_simulated(dataset: Dataset) -> None:
    """Boxes are drawn only where nobody else knows them.

    Raises:
        BusybotError: a simulator made the recordings, or the dataset is frozen.
    """
    if not dataset.info.generator.imported:
        what = f"{dataset.path}: the simulator knows the boxes of its recordings"
        raise BusybotError(what, "boxes are drawn in datasets that `busybot dataset import` made")
    refuse_frozen(dataset.path)


def redraw(dataset: Dataset, index: int, objects: Sequence[KnownObject], was: Sequence[int | None]) -> None:
    """Give a recording other objects; pictures and actions stay. A call that was killed is simply repeated.

    Args:
        was: which object each one was before, None for a new one; relations that were told follow them.

    Raises:
        BusybotError: a box is outside of the picture, an object of a relation is gone, or boxes cannot be drawn here.
    """
    refuse_simulated(dataset)
    with dataset.locked():
        episode = read_episode(dataset.episode_path(index))
        if episode.links:
            what = f"{dataset.path}: board {index}: a log told the states of its objects"
            raise BusybotError(what, "write boxes and roles into objects.csv, and import the recording again")
        changed = _redrawn(episode, objects, was)
        write_episode(dataset.episode_path(index), changed, "png", dataset.path)
        dataset.replace_board(changed.board)
        rows = {index: episode_rows(dataset.episode_path(index), index)}
        try:
            dataset.store_rows(rows)
        except BusybotError:  # the repair of another recording that is damaged makes the tables again
            if all(_readable(dataset, other) for other in dataset.finished()):
                raise


def _readable(dataset: Dataset, index: int) -> bool:
    try:
        read_episode(dataset.episode_path(index), "lazy")
    except BusybotError:
        return False
    return True


def _redrawn(episode: Episode, objects: Sequence[KnownObject], was: Sequence[int | None]) -> Episode:
    camera, board = episode.camera, episode.board
    boxes, before = boxes_of(objects, camera.width, camera.height), episode.images[0].boxes.tolist()
    number = {old: new for new, old in enumerate(was) if old is not None}
    related = {at for one in board.relations for at in (one.responder, *(ref.object for ref in one.triggers))}
    told = sum(old is not None for old in was)
    if len(number) != told or not number.keys() <= set(range(len(board.objects))):
        what = f"board {board.index}: it has {len(board.objects)} objects, each of which is drawn once"
        raise BusybotError(what, "load the page again")
    if gone := sorted(related - number.keys()):
        name = board.objects[gone[0]].category
        what = f"board {board.index}: object {gone[0]} ({name}) is gone, but a relation of it was told"
        raise BusybotError(what, "keep it; or import the recording again without relations.csv")
    values = board.model_dump(mode="json")
    for relation in values["relations"]:
        relation["responder"] = number[relation["responder"]]
        for ref in relation["triggers"]:
            ref["object"] = number[ref["object"]]
            ref["link"] = link_of(objects[ref["object"]])
    values["objects"] = [placed_object(n, one).model_dump(mode="json") for n, one in enumerate(objects)]
    try:
        drawn = BoardSpec.model_validate(values)
    except ValidationError as error:
        hint = "the responder of a relation that was told stays one"
        raise BusybotError(f"board {board.index}: {first_fault(error)}", hint) from None
    images = [replace(image, boxes=np.full_like(boxes, -1)) for image in episode.images]
    images[0] = replace(images[0], boxes=boxes)
    positions = positions_of(objects, camera, images[0].depth)
    for new, old in enumerate(was):
        if old is not None and boxes[new].tolist() == before[old]:
            positions[new] = episode.positions[old]  # which somebody may have measured
    return replace(episode, board=drawn, images=images, positions=positions)
