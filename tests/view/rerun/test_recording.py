"""What the recording for Rerun holds."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from busybot.boards.spec import LinkRef
from busybot.boards.task import goal_responders
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.reason.models.base import InferredGraph
from busybot.view.rerun.graph import graph_positions, label_extents, place_labels
from busybot.view.rerun.recording import _legend_share, graph_views, save_rrd
from busybot.view.rerun.series import relation_states, said, sentence
from tests.episodes.synthetic import make_episode, make_real_episode, make_task_episode

GUESS = InferredGraph("guess", np.zeros((6, 5, 5)))
GUESS.probabilities[1:, 0, 1] = 0.9


def rows(path: Path, entity: str) -> Iterator[dict]:
    for chunk in RrdReader(path).store().stream().to_chunks():
        if chunk.entity_path == entity:
            yield from chunk.to_record_batch().to_pylist()


def entities(path: Path) -> set[str]:
    return set(RrdReader(path).store().schema().entity_paths())


def saved(path: Path, episode: Episode, *inferred: InferredGraph) -> Path:
    save_rrd(path, episode, inferred)
    return path


def test_everything_is_there_on_the_two_timelines(tmp_path: Path) -> None:
    path = saved(tmp_path / "e.rrd", make_episode(), GUESS)
    found = entities(path)
    for entity in (
        "/camera/image", "/camera/objects", "/camera/changed", "/camera/action/pixel", "/camera/action/direction",
        "/depth/image", "/world/board/face", "/world/objects/switch\\ 0", "/world/boxes/lamp\\ 1", "/world/action",
        "/world/relations/true/arcs", "/world/relations/guess/arcs", "/graph/true", "/graph/guess", "/log", "/reward",
        "/inference/guess/probabilities", "/inference/guess/edges/0-1", "/signals/changed", "/signals/delta",
        "/states/relation_00/cause_switch_0_link_0", "/states/relation_00/effect_lamp_1",
    ):  # fmt: skip
        assert entity in found, entity
    names = {column.name for column in RrdReader(path).store().schema().index_columns()}
    assert names == {"step", "time"}


def test_step_k_shows_the_board_after_k_actions(tmp_path: Path) -> None:
    episode = make_episode(steps=6)
    path = saved(tmp_path / "e.rrd", episode)
    changed = {row["step"]: row["Scalars:scalars"][0] for row in rows(path, "/signals/changed") if row.get("step")}
    assert changed == {k + 1: float(step.changed_pixels) for k, step in enumerate(episode.steps)}
    images = [row["step"] for row in rows(path, "/camera/image")]
    assert images == [k for k in range(7) if k == 0 or episode.frame_of[k] != episode.frame_of[k - 1]]


def test_a_recording_without_objects_is_shown(tmp_path: Path) -> None:
    episode = make_real_episode()
    episode.board = episode.board.model_copy(update={"objects": (), "relations": ()})
    episode.images = [replace(image, boxes=np.zeros((0, 4), np.int16)) for image in episode.images]
    episode.positions = episode.positions[:0]
    assert "/camera/image" in entities(saved(tmp_path / "e.rrd", episode))


def test_only_what_changed_is_logged_again(tmp_path: Path) -> None:
    path = saved(tmp_path / "e.rrd", make_episode(steps=6))
    assert len(list(rows(path, "/world/objects/toy\\ 4"))) == 1
    assert len(list(rows(path, "/world/objects/switch\\ 0"))) > 1


def test_a_goal_is_shown_with_the_responders_that_differ_still(tmp_path: Path) -> None:
    episode = make_task_episode(steps=6)
    path = saved(tmp_path / "e.rrd", episode)
    assert len(list(rows(path, "/goal/image"))) == 1
    marked = {row["step"]: len(row["Boxes2D:half_sizes"]) for row in rows(path, "/goal/remaining")}
    wanted = goal_responders(episode.board)
    for k, count in marked.items():
        step = episode.steps[max(k - 1, 0)]
        shown = step.responder_states_after if k else step.responder_states_before
        assert count == sum(shown[i] != wanted[i] for i in (1, 2)), k
    assert len(set(marked.values())) > 1
    assert not {"/goal/image", "/goal/remaining"} & entities(saved(tmp_path / "plain.rrd", make_episode()))


def test_images_of_a_file_are_passed_on_as_they_are(tmp_path: Path) -> None:
    write_episode(tmp_path / "e.mcap", make_episode(), "png")
    episode = read_episode(tmp_path / "e.mcap", images="lazy")
    first = next(rows(saved(tmp_path / "e.rrd", episode), "/camera/image"))
    assert first["EncodedImage:media_type"] == ["image/png"]
    assert bytes(first["EncodedImage:blob"][0]) == episode.images.encoded[0].rgb  # type: ignore[attr-defined]


def test_the_graph_has_the_verdict_on_its_edges(tmp_path: Path) -> None:
    path = saved(tmp_path / "e.rrd", make_episode(), GUESS)
    last = max(rows(path, "/graph/guess"), key=lambda row: row["step"])
    labels = last["GraphNodes:labels"]
    assert labels[:5] == ["switch 0", "lamp 1", "door 2", "switch 3", "toy 4"]
    assert set(labels[5:]) == {"0.90", "missed 0.00"}


def test_equal_episodes_give_equal_recordings(tmp_path: Path) -> None:
    first, second = (saved(tmp_path / name, make_episode(), GUESS) for name in ("a.rrd", "b.rrd"))
    chunks = [
        sorted(
            (chunk.entity_path, str(batch.drop_columns([c for c in batch.schema.names if c.endswith("RowId")])))
            for chunk in RrdReader(path).store().stream().to_chunks()
            for batch in [chunk.to_record_batch()]
        )
        for path in (first, second)
    ]
    assert chunks[0] == chunks[1]


def test_only_equal_episodes_have_one_id(tmp_path: Path) -> None:
    """Rerun shows files with one id as one recording, and many datasets have a board 0 of the training split."""
    episode = make_episode()
    others = [replace(episode, board=episode.board.model_copy(update={"seed": 8})), replace(episode, settings={"a": 1})]
    files = [saved(tmp_path / f"{n}.rrd", one) for n, one in enumerate([episode, episode, *others])]
    first, same, *unlike = (RrdReader(file).recordings()[0].recording_id for file in files)
    assert first == same and len({first, *unlike}) == 3


@pytest.mark.parametrize("episode", [make_real_episode(), make_episode(steps=0)], ids=["real board", "no steps"])
def test_recordings_that_know_little_are_shown_too(episode: Episode, tmp_path: Path) -> None:
    found = entities(saved(tmp_path / "e.rrd", episode))
    assert {"/camera/image", "/graph/true", "/world/relations/true/arcs"} <= found


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BusybotError, match=r"e\.rrd: cannot be written"):
        save_rrd(tmp_path / "file" / "e.rrd", make_episode(steps=0))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_states_pair_each_cause_with_its_effect() -> None:
    episode = make_episode(steps=5)
    for frame in range(6):
        states = relation_states(episode, frame)
        assert list(states) == sorted(states)
        for relation, cause, effect in ((0, "switch_0_link_0", "lamp_1"), (1, "switch_3_link_0", "door_2")):
            assert (
                states[f"relation_{relation:02d}/cause_{cause}"] == states[f"relation_{relation:02d}/effect_{effect}"]
            )
    assert relation_states(make_real_episode(), 1) == {}


def test_names_of_links_are_parts_of_paths_whatever_they_are(tmp_path: Path) -> None:
    episode = make_episode(steps=3)
    links = tuple(replace(one, name=f"{one.name} (left)") if one.trigger else one for one in episode.links)
    wired = tuple(
        one.model_copy(
            update={"triggers": tuple(LinkRef(object=t.object, link=f"{t.link} (left)") for t in one.triggers)}
        )
        for one in episode.board.relations
    )
    episode = replace(episode, links=links, board=episode.board.model_copy(update={"relations": wired}))
    path = tmp_path / "e.rrd"
    save_rrd(path, episode)
    assert sum(name.endswith("left\\)") for name in entities(path) if name.startswith("/states/relation_00/")) == 1


def test_a_step_in_words() -> None:
    episode = make_episode(steps=3)
    drives = {0: "switch 0 and lamp 1", 3: "door 2 and switch 3"}
    for index, step in enumerate(episode.steps):
        words = sentence(episode, index)
        assert words.endswith(f"{drives.get(step.acted_object, 'nothing')} changed")
    assert sentence(make_real_episode(), 0).startswith("pull at pixel")


def test_a_depth_camera_that_measured_nothing_at_first_is_shown(tmp_path: Path) -> None:
    episode = make_episode(steps=6)
    episode.image(0).depth[:] = 0  # type: ignore[index]
    path = saved(tmp_path / "e.rrd", episode)
    assert {row["step"] for row in rows(path, "/depth/image")} and "/world/objects/toy\\ 4" in entities(path)


def test_all_labels_of_a_graph_are_in_view() -> None:
    episode = with_long_names(make_episode())
    for views in (graph_views(episode, [GUESS], None).contents, graph_views(episode, [], None).contents):
        for view in views:
            bounds = view.properties["VisualBounds2D"]
            pairs = [(0, 1), (3, 2)]
            low, high = (np.array([axis[end] for axis in ranges(bounds)]) for end in (0, 1))
            extents = label_extents(episode, pairs)
            assert (extents[:, :2] > low).all() and (extents[:, 2:] < high).all()
            assert (high - low)[0] == pytest.approx((high - low)[1])


def with_long_names(episode: Episode) -> Episode:
    objects = tuple(one.model_copy(update={"key": f"Worktop{one.key}"}) for one in episode.board.objects)
    return replace(episode, board=episode.board.model_copy(update={"objects": objects}))


def ranges(bounds: rrb.VisualBounds2D) -> list[list[float]]:
    (values,) = bounds.range.as_arrow_array().to_pylist()
    return [values["x_range"], values["y_range"]]


def test_curves_end_where_their_legend_begins() -> None:
    """The longer the names, the earlier; half of a plot is for curves at least."""
    episode = make_episode()
    short = _legend_share(episode, GUESS)
    assert 0.25 < short < _legend_share(with_long_names(episode), GUESS) <= 0.5


def test_an_edges_label_and_line_avoid_other_nodes() -> None:
    places = np.array([[0.0, 0.0], [400.0, 0.0], [200.0, 0.0]])
    straight = place_labels(places[:2], ["a", "b"], [(0, 1)], ["0.90"])
    np.testing.assert_allclose(straight, [[200, 0]])
    around = place_labels(places, ["a", "b", "in the way"], [(0, 1)], ["0.90"])
    assert abs(around[0, 1]) > 20


def test_graph_nodes_stay_where_the_camera_sees_the_objects() -> None:
    small, large = make_episode(width=160, height=120), make_episode(width=320, height=240)
    np.testing.assert_allclose(graph_positions(small), graph_positions(large), atol=8)


def test_what_an_agent_said_is_told_and_nothing_is_made_up() -> None:
    episode = make_episode(steps=2)
    assert said(episode, 0) == ""
    episode.settings["decisions"] = ["object 3 differs", "", "stop: everything looks as in the goal"]
    assert [said(episode, step) for step in range(4)] == [
        "random: switch 3 differs", "", "random: stop: everything looks as in the goal", "",
    ]  # fmt: skip
    episode.settings["decisions"] = 7
    assert said(episode, 0) == ""
