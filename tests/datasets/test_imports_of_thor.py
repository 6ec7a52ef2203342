"""Events in AI2-THOR's documented format, written by hand, to a dataset; what is wrong in them is named."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from busybot.boards.directions import direction_named
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.importing.camera_folder import ImportOptions
from busybot.datasets.importing.sources import import_source
from busybot.datasets.verify import verify
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset, judge_episode
from tests.cli.commands import busybot

KNOBS = {f"StoveKnob|{n}|0.9|-1.5": [20 + 50 * n, 100, 40 + 50 * n, 115] for n in range(3)}
BURNERS = {f"StoveBurner|{n}|1.0|-1.2": [15 + 50 * n, 30, 45 + 50 * n, 60] for n in range(3)}
DOOR = {"Microwave|1.0|1.5|-1.2": [170, 20, 200, 60]}
COUNTER = {"CounterTop|0.0|1.0|-1.2": [0, 10, 208, 125]}
WIRING = (2, 0, 1)
WIDTH, HEIGHT = 208, 128
Change = Callable[[list[dict[str, Any]]], None]


def event(on: list[bool], opened: bool, action: dict[str, Any]) -> dict[str, Any]:
    """What a step of a stove with three knobs returned."""
    sides = ("toggleable", "isToggled", "openable", "isOpen", "receptacle", "parentReceptacles", "controlledObjects")
    knobs, burners = list(KNOBS), list(BURNERS)
    rows = [(k, True, on[n], False, False, False, None, [burners[WIRING[n]]]) for n, k in enumerate(knobs)]
    lit = [on[WIRING.index(n)] for n in range(3)]
    rows += [(b, False, lit[n], False, False, True, list(COUNTER), None) for n, b in enumerate(burners)]
    rows += [(*DOOR, False, False, True, opened, True, list(COUNTER), None)]
    rows += [
        (*COUNTER, False, False, False, False, True, None, None),
        ("Apple|0|1|0", *[False] * 5, list(COUNTER), None),
    ]
    objects = [
        {"objectId": row[0], "objectType": row[0].split("|")[0], **dict(zip(sides, row[1:], strict=True))}
        for row in rows
    ]
    agent = {
        "position": {"x": 0.0, "y": 0.9, "z": -0.5},
        "rotation": {"x": 0.0, "y": 180.0, "z": 0.0},
        "cameraHorizon": 30.0,
    }
    return {
        "metadata": {
            "objects": objects, "agent": agent, "sceneName": "FloorPlan1", "screenWidth": WIDTH, "screenHeight": HEIGHT,
            "lastAction": action["action"], "lastActionSuccess": True, "errorMessage": "",
        },
        "instance_detections2D": KNOBS | BURNERS | DOOR | COUNTER,
        "action": action,
    }  # fmt: skip


def picture(on: list[bool], opened: bool) -> np.ndarray:
    """Knobs that turn, burners that glow, a door that swings."""
    found = np.full((HEIGHT, WIDTH, 3), 190, np.uint8)
    for n, (u0, v0, u1, v1) in enumerate(KNOBS.values()):
        found[v0:v1, u0:u1] = 90
        found[v0 + 3 : v0 + 8, (u0 if on[n] else u1 - 8) : (u0 + 8 if on[n] else u1)] = (230, 230, 230)
    for n, (u0, v0, u1, v1) in enumerate(BURNERS.values()):
        found[v0:v1, u0:u1] = (40, 30, 220) if on[WIRING.index(n)] else 30
    u0, v0, u1, v1 = next(iter(DOOR.values()))
    found[v0:v1, u0:u1] = (20, 20, 20) if opened else (120, 160, 120)
    return found


def write_thor(folder: Path, change: Change | None = None) -> Path:
    """A recording of twelve actions, three of which open and close the microwave."""
    on, opened, events = [False] * 3, False, [event([False] * 3, False, {"action": "Initialize"})]
    pictures = [picture(on, opened)]
    for number in (0, 1, 2, 3, 0, 2, 1, 3, 0, 1, 3, 2):
        if number == 3:
            opened, target, verb = not opened, next(iter(DOOR)), "CloseObject" if opened else "OpenObject"
        else:
            on = [state != (place == number) for place, state in enumerate(on)]
            target, verb = list(KNOBS)[number], "ToggleObjectOn" if on[number] else "ToggleObjectOff"
        events.append(event(on, opened, {"action": verb, "objectId": target, "forceAction": False}))
        pictures.append(picture(on, opened))
    if change:
        change(events)
    (folder / "events").mkdir(parents=True)
    for number, (told, shown) in enumerate(zip(events, pictures, strict=False)):
        (folder / "events" / f"{number:06d}.json").write_text(json.dumps(told))
        cv2.imwrite(str(folder / "events" / f"{number:06d}.png"), shown)
    return folder


def imported(folder: Path, options: ImportOptions | None = None) -> Dataset:
    made = import_source(folder, folder.with_name(f"{folder.name}-set"), options).dataset
    assert made is not None
    return made


def test_relations_of_a_stove_are_found_and_judged(tmp_path: Path) -> None:
    made = imported(write_thor(tmp_path / "thor"))
    episode = made[0]
    assert verify(made.path).ok and [placed.role for placed in episode.board.objects] == ["trigger"] * 3 + [
        "responder"
    ] * 3 + ["trigger"]
    assert episode.board.objects[0].key.startswith("StoveKnob-0") and len(episode.steps) == 12
    assert [(r.triggers[0].object, r.responder) for r in episode.board.relations] == [(1, 3), (2, 4), (0, 5)]
    assert all(step.success for step in episode.steps) and episode.steps[0].pixel == (30, 107)
    assert episode.steps[3].direction == direction_named("pull"), "the microwave opens"
    judged = judge_episode(episode, ReasonEvaluation("count", 13))
    assert judged.counts(12)["hits"] == judged.counts(12)["claimed"] == judged.counts(12)["true"] == 3
    assert evaluate_dataset(made, ReasonEvaluation("event", 13), workers=1)["edge_r"] == 1


def test_what_nobody_told_is_unknown_and_rest_is_waited_for(tmp_path: Path) -> None:
    def change(events: list[dict[str, Any]]) -> None:
        events[2]["metadata"]["lastActionSuccess"] = False
        events[3]["action"] = {"action": "Pass"}
        for one in events:
            for placed in one["metadata"]["objects"]:
                placed["controlledObjects"] = None

    folder = write_thor(tmp_path / "both" / "first", change)
    told = import_source(folder.parent, None).recordings[0]
    assert told["actions"] == 11 and told["relations"] is None and told["triggers"] == 4 and told["failed"] == "1"
    assert imported(folder, ImportOptions(width=104))[0].rgb[0].shape == (64, 104, 3)


def moved(events: list[dict[str, Any]]) -> None:
    events[4]["metadata"]["agent"]["position"]["x"] = 0.25


def nowhere(events: list[dict[str, Any]]) -> None:
    events[0]["metadata"]["agent"]["position"]["x"] = "nan"


def acted_on_what_is_controlled(events: list[dict[str, Any]]) -> None:
    events[5]["action"]["objectId"] = next(iter(BURNERS))


def chained(events: list[dict[str, Any]]) -> None:
    events[0]["metadata"]["objects"][3]["controlledObjects"] = [list(BURNERS)[1]]


def crowded(events: list[dict[str, Any]]) -> None:
    for one in events:
        more = [{"objectId": f"Lamp|{n}", "toggleable": True} for n in range(9_900)]
        one["metadata"]["objects"] = [*one["metadata"]["objects"], *more]
    events[0]["instance_detections2D"] |= {f"Lamp|{n}": [0, 0, 5, 5] for n in range(9_900)}
    del events[2:]


def walked(events: list[dict[str, Any]]) -> None:
    events[4]["action"] = {"action": "MoveAhead"}


def unnamed(events: list[dict[str, Any]]) -> None:
    events[5]["action"] = {"action": "ToggleObjectOn"}


def stranger(events: list[dict[str, Any]]) -> None:
    events[5]["action"]["objectId"] = "Toaster|1|1|1"


def unboxed(events: list[dict[str, Any]]) -> None:
    events[0]["instance_detections2D"] = None


def hidden(events: list[dict[str, Any]]) -> None:
    del events[0]["instance_detections2D"][next(iter(KNOBS))]


def outside(events: list[dict[str, Any]]) -> None:
    events[0]["instance_detections2D"][next(iter(DOOR))] = [170, 20, 400, 60]


def endless(events: list[dict[str, Any]]) -> None:
    events[0]["instance_detections2D"][next(iter(DOOR))] = [170, 20, 10**400, 60]


def larger(events: list[dict[str, Any]]) -> None:
    events[0]["metadata"]["screenWidth"] = 300


def elsewhere(events: list[dict[str, Any]]) -> None:
    events[6]["metadata"]["sceneName"] = "FloorPlan2"


def twice(events: list[dict[str, Any]]) -> None:
    events[0]["metadata"]["objects"].append(events[0]["metadata"]["objects"][0])


def gone(events: list[dict[str, Any]]) -> None:
    events[7]["metadata"]["objects"] = events[7]["metadata"]["objects"][:4]


def wordy(events: list[dict[str, Any]]) -> None:
    events[2]["metadata"]["objects"][1]["isToggled"] = "perhaps"


def broken(events: list[dict[str, Any]]) -> None:
    events[2].pop("metadata")


@pytest.mark.parametrize(
    ("change", "file", "what"),
    [
        (moved, 4, "the agent moved"), (walked, 4, "action 'MoveAhead'"), (unnamed, 5, "on which object"),
        (stranger, 5, "none of the objects"), (unboxed, 0, "no instance_detections2D"), (hidden, 1, "does not show"),
        (outside, 0, "outside of pictures"), (larger, 0, "screenWidth"), (elsewhere, 6, "another scene"),
        (twice, 0, "stands there twice"), (gone, 7, "is gone"), (wordy, 2, "isToggled"), (broken, 2, "metadata"),
        (nowhere, 0, "position.x"), (acted_on_what_is_controlled, 5, "StoveBurner.* is acted on, and 'StoveKnob"),
        (chained, 0, "StoveBurner.* controls others, and 'StoveKnob"), (crowded, 0, "9907 objects"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(change: Change, file: int, what: str, tmp_path: Path) -> None:
    folder = write_thor(tmp_path / "thor", change)
    with pytest.raises(BusybotError, match=what) as error:
        import_source(folder, tmp_path / "made")
    assert f"{file:06d}.json" in error.value.what and error.value.hint
    assert sorted(path.name for path in tmp_path.iterdir()) == ["thor"], "nothing is half written"


def test_a_box_of_many_digits_is_named_also_in_smaller_pictures(tmp_path: Path) -> None:
    folder = write_thor(tmp_path / "thor", endless)
    with pytest.raises(BusybotError, match=r"000000.json: instance_detections2D.Microwave.* 1000000000"):
        import_source(folder, tmp_path / "made", ImportOptions(width=104))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["thor"]


def test_pictures_and_options_that_do_not_fit(tmp_path: Path) -> None:
    folder = write_thor(tmp_path / "thor")
    with pytest.raises(BusybotError, match="events tell all of it"):
        import_source(folder, None, ImportOptions(fps=3.0))
    (folder / "events" / "000003.png").unlink()
    with pytest.raises(BusybotError, match=r"000003.json: no picture"):
        import_source(folder, None)


def test_events_are_in_the_order_of_their_numbers_and_none_is_left_out(tmp_path: Path) -> None:
    def change(events: list[dict[str, Any]]) -> None:
        agent = events[3]["metadata"]["agent"]
        agent["position"] = dict(reversed(agent["position"].items()))

    folder = write_thor(tmp_path / "thor", change)
    expected = [(step.pixel, step.direction) for step in imported(folder)[0].steps]
    for file in list((folder / "events").iterdir()):
        file.rename(file.with_stem(str(int(file.stem))))
    folder = folder.rename(tmp_path / "unpadded")
    assert [(step.pixel, step.direction) for step in imported(folder)[0].steps] == expected
    (folder / "events" / "5.json").unlink()
    with pytest.raises(BusybotError, match=r"events: 1 missing between 4.json and 6.json") as error:
        import_source(folder, None)
    assert "divide" in error.value.hint


@pytest.mark.long
def test_the_command_reads_events(tmp_path: Path) -> None:
    done = busybot("dataset", "import", str(write_thor(tmp_path / "thor")), "--out", str(tmp_path / "made"), "--json")
    assert done.returncode == 0 and json.loads(done.stdout)["kind"] == "ai2thor"


def test_what_is_no_file_is_no_picture(tmp_path: Path) -> None:
    source = write_thor(tmp_path / "thor")
    (source / "events" / "000004.png").unlink()
    os.mkfifo(source / "events" / "000004.png")
    with pytest.raises(BusybotError, match="000004.png"):
        imported(source)
