"""Graphs as files: what was inferred comes back and is judged alike, and so is anybody's graph."""

import json
from pathlib import Path

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset
from busybot.reason.evaluation.graph_files import graph_lines, graph_values, read_graphs, write_graph
from busybot.reason.models.base import InferredGraph, InferredLinks, ParentSet
from tests.cli.commands import busybot
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("graphs") / "data")


def test_what_is_written_is_judged_as_it_was(dataset: Dataset, tmp_path: Path) -> None:
    done = busybot(
        "eval", "reason", dataset.path, "--reasoner", "count", "--images", 7, "--graphs", tmp_path / "g", "--json"
    )
    first = json.loads(done.stdout)
    assert sorted(file.name for file in (tmp_path / "g").glob("*.json")) == [f"00000{i}.json" for i in (0, 1, 3)]
    again = busybot("eval", "reason", dataset.path, "--graph", tmp_path / "g", "--images", 7, "--json")
    second = json.loads(again.stdout)
    assert second["model"] == "count" and second["encoder"] is None and f"--graph {tmp_path / 'g'}" in second["command"]
    assert "--reasoner" not in second["command"], "nobody named one"
    for key in ("edge_p", "edge_r", "edge_acc", "parent_f1", "shd"):
        assert second[key] == first[key]
    assert second["brier"] == pytest.approx(first["brier"], abs=1e-5)


def test_mechanisms_and_lags_come_with_the_edges(tmp_path: Path) -> None:
    episode, matrix = make_episode(0), np.zeros((1, 5, 5))
    matrix[0, 0, 1], matrix[0, 0, 4] = 0.9, 0.2
    lags = np.array([-1, 2, -1, -1, -1])
    words = ("", "follows object 0 and object 3", "", "", "")
    told = InferredGraph("mine", matrix, kinds=("", "gate", "", "", ""), lags=lags, words=words)
    values = graph_values(episode, told, 6)
    first, second = values["edges"]
    assert (first["from"], first["to"], first["mechanism"], first["lag"], first["claimed"]) == (0, 1, "gate", 2, True)
    assert not second["claimed"] and second["mechanism"] is None
    assert graph_lines(values) == [
        "switch 0 -> lamp 1, 0.900, gate, after 2 more actions", "lamp 1 follows switch 0 and switch 3"
    ]  # fmt: skip
    assert graph_lines(values | {"edges": [first | {"lag": 1}]})[0].endswith("after 1 more action")
    assert graph_lines(values | {"edges": [second]})[0] == "nothing is claimed"
    strange = values | {"edges": [first | {"mechanism": "a\x1b[2J\nb"}], "model": "m\x1b[2J\nine"}
    write_graph(tmp_path / "strange", strange)
    head, line, *_ = (tmp_path / "strange" / "000000.txt").read_text().split("\n")
    assert head.startswith("board 0, inferred by m\\x1b[2J\\nine after") and "a\\x1b[2J\\nb" in line
    bare = [node | {"box": None if node["role"] == "trigger" else node["box"]} for node in values["nodes"]]
    assert graph_lines({"nodes": bare, "edges": []})[0].startswith("nothing is claimed: no trigger has a box; ")
    write_graph(tmp_path, values)
    graph = read_graphs(tmp_path).of(episode)
    np.testing.assert_allclose(graph.after(6), matrix[0])
    assert graph.kinds == ("", "gate", "", "", "") and graph.lags is not None and graph.lags.tolist() == lags.tolist()


def test_sets_of_parents_name_their_links(tmp_path: Path) -> None:
    episode, matrix = make_episode(0), np.zeros((1, 5, 5))
    acted = np.array([step.acted_object for step in episode.steps])
    clusters = np.where(acted == 0, 1, np.where(acted == 3, 0, -1))
    sets = (ParentSet((0, 1), (2,), 0.7), ParentSet((1,), (), 0.2), ParentSet((2,), (), 0.1))  # nobody held link 2
    told = InferredGraph(
        "mine", matrix, links=InferredLinks(clusters, np.zeros((1, 3, 5))), parent_sets=((), sets, (), (), ())
    )
    values = graph_values(episode, told, 6)
    assert values["nodes"][1]["parent_sets"] == [
        {"links": ["3.1", "0.1"], "objects": [2], "probability": 0.7},
        {"links": ["0.1"], "objects": [], "probability": 0.2},
    ]
    assert "parent_sets" not in values["nodes"][0]
    write_graph(tmp_path, values)
    assert read_graphs(tmp_path).of(episode).links is not None, "what is told besides is no matter"


def test_links_come_back_as_they_were_told(tmp_path: Path) -> None:
    episode = make_episode(0)
    acted = np.array([step.acted_object for step in episode.steps])
    clusters = np.where(acted == 0, 1, np.where(acted == 3, 0, -1))
    assert {0, 3} <= set(acted.tolist())
    single = np.zeros((1, 2, 5))
    single[0, 1, 1], single[0, 0, 2] = 0.8, 0.3
    matrix = np.zeros((1, 5, 5))
    matrix[0, 0, 1], matrix[0, 3, 2] = 0.9, 0.4
    values = graph_values(episode, InferredGraph("mine", matrix, links=InferredLinks(clusters, single)), 6)
    assert [(link["id"], link["of"]) for link in values["links"]] == [("3.1", 3), ("0.1", 0)]
    assert [(edge["from"], edge["link"], edge["to"], edge["claimed"]) for edge in values["edges"]] == [
        (0, None, 1, True), (3, None, 2, False), (0, "0.1", 1, True), (3, "3.1", 2, False)
    ]  # fmt: skip
    assert graph_lines(values) == ["switch 0 -> lamp 1, 0.900"], "once, not of its link again"
    write_graph(tmp_path, values)
    told = read_graphs(tmp_path).of(episode)
    assert told.links is not None
    np.testing.assert_array_equal(told.links.clusters, clusters)
    np.testing.assert_allclose(told.links.after(6), single[0])
    np.testing.assert_allclose(told.after(6), matrix[0])


def test_single_links_of_a_strangers_graphs_are_judged(dataset: Dataset, tmp_path: Path) -> None:
    graphs = []
    for index in sorted(dataset.finished()):
        episode = read_episode(dataset.episode_path(index))
        held = {i: [n for n, step in enumerate(episode.steps) if step.acted_object == i] for i in (0, 3)}
        true = [(t.object, r.responder) for r in episode.board.relations for t in r.triggers]
        edges = [{"from": i, "link": f"link of {i}", "to": j} for i, j in true if held[i]]
        links = [{"id": f"link of {i}", "of": i, "steps": steps} for i, steps in held.items() if steps]
        graphs.append({"board": index, "links": links, "edges": edges})
    judged = {}
    for name, given in {"true": graphs, "none": [one | {"links": [], "edges": []} for one in graphs]}.items():
        (tmp_path / name).write_text(json.dumps(given))
        judged[name] = evaluate_dataset(dataset, ReasonEvaluation(given=read_graphs(tmp_path / name)), workers=1)
    assert judged["true"]["link_parent_p"] == 1 and judged["true"]["link_parent_r"] > 0.5
    assert judged["none"]["link_parent_r"] == 0
    (tmp_path / "some").write_text(json.dumps([graphs[0], {"board": 1, "edges": []}]))
    with pytest.raises(BusybotError, match="not of board 1"):
        read_graphs(tmp_path / "some")


def test_a_strangers_nodes_are_found_by_their_boxes(dataset: Dataset, tmp_path: Path) -> None:
    episode = make_episode(0)
    boxes = episode.image(0).boxes.tolist()
    true = [(t.object, r.responder) for r in episode.board.relations for t in r.triggers]
    told = {
        "nodes": [{"id": f"n{i}", "box": [box[0] + 1, *box[1:]]} for i, box in enumerate(boxes)]
        + [{"id": "wall", "box": [0, 0, 3, 3]}],
        "edges": [{"from": f"n{i}", "to": f"n{j}"} for i, j in true],
    }
    (tmp_path / "graph.json").write_text(json.dumps(told))
    graph = read_graphs(tmp_path / "graph.json").of(episode)
    assert {tuple(pair) for pair in np.argwhere(graph.claimed(6)).tolist()} == set(true)
    (tmp_path / "all.json").write_text(json.dumps([told, *({"board": i, "edges": []} for i in (1, 3))]))
    result = evaluate_dataset(dataset, ReasonEvaluation(given=read_graphs(tmp_path / "all.json")), workers=1)
    assert result["boards"] == 3 and result["edge_r"] > 0
    earlier = [result[key] for key in ("discovery", "uncertain_by_images", "by_images")]
    assert earlier == [[], [], []], "a file says nothing of earlier actions"


def test_the_earliest_of_an_objects_lags_and_the_likeliest_of_equal_edges_count(tmp_path: Path) -> None:
    late = [{"from": 0, "to": 1, "lag": 2, "probability": 0.9}, {"from": 3, "to": 1, "lag": 1}, {"from": 3, "to": 2}]
    again = [{"from": 0, "to": 1, "probability": 0.1}]
    for number, edges in enumerate((late + again, again + late[::-1])):
        (tmp_path / f"{number}.json").write_text(json.dumps({"edges": edges}))
        graph = read_graphs(tmp_path / f"{number}.json").of(make_episode(0))
        assert graph.lags is not None and graph.lags.tolist() == [-1, 1, -1, -1, -1]
        assert graph.after(1)[0, 1] == 0.9 and graph.claimed(1).sum() == 3


def test_mechanisms_and_lags_are_those_of_what_is_claimed(tmp_path: Path) -> None:
    """Who says something of every pair that may be one is not judged by the least probable of them."""
    claimed = {"from": 0, "to": 1, "probability": 0.9, "mechanism": "gate", "lag": 2}
    weak = {"from": 3, "to": 1, "probability": 0.1, "mechanism": "delay", "lag": 0}
    rest = {"from": 0, "to": 2, "probability": 0.2, "mechanism": "rest"}
    (tmp_path / "graph.json").write_text(json.dumps({"edges": [weak, claimed, rest]}))
    graph = read_graphs(tmp_path / "graph.json").of(make_episode(0))
    assert graph.kinds == ("", "gate", "rest", "", "")
    assert graph.lags is not None and graph.lags.tolist() == [-1, 2, -1, -1, -1]


def test_graphs_of_boards_that_are_not_there_are_refused(dataset: Dataset, tmp_path: Path) -> None:
    graphs = [{"board": index, "edges": []} for index in (*sorted(dataset.finished()), 99)]
    (tmp_path / "graphs.json").write_text(json.dumps(graphs))
    with pytest.raises(BusybotError, match="graphs.json: it has a graph of board 99"):
        evaluate_dataset(dataset, ReasonEvaluation(given=read_graphs(tmp_path / "graphs.json")), workers=1)


WRONG = {
    "no edges": ("{}", "graph.json: edges: Field required"),
    "another board": ('{"board": 1, "edges": []}', "it has no graph of board 0"),
    "a probability": ('{"edges": [{"from": 0, "to": 1, "probability": 2}]}', "edges.0.probability"),
    "a node that is no object": ('{"edges": [{"from": 0, "to": 9}]}', "node 9 is no object of the board"),
    "a node elsewhere": (
        '{"nodes": [{"id": 0, "box": [0, 0, 2, 2]}], "edges": [{"from": 0, "to": 0}]}',
        "node 0 is no",
    ),
    "two nodes of one name": ('{"nodes": [{"id": 1}, {"id": 0}, {"id": 1}], "edges": []}', "two nodes with id 1"),
    "a link of nobody": ('{"links": [{"id": 0, "of": 9, "steps": [0]}], "edges": []}', "node 9 is no object"),
    "two links of one name": (
        '{"links": [{"id": 0, "of": 0, "steps": [0]}, {"id": 0, "of": 3, "steps": [1]}], "edges": []}',
        "two links with",
    ),
    "a link of another": (
        '{"links": [{"id": "a", "of": 0, "steps": [0]}], "edges": [{"from": 3, "link": "a", "to": 1}]}',
        "names link 'a', which is none of it",
    ),
    "a link of no list": ('{"edges": [{"from": 0, "link": 5, "to": 1}]}', "names link 5, which is none of it"),
    "a link that nothing held": ('{"links": [{"id": 0, "of": 0, "steps": []}], "edges": []}', "links.0.steps"),
    "a step beyond": ('{"links": [{"id": 0, "of": 0, "steps": [6]}], "edges": []}', "the recording has no step 6"),
    "a step of two links": (
        '{"links": [{"id": 0, "of": 0, "steps": [1]}, {"id": 1, "of": 3, "steps": [0, 1]}], "edges": []}',
        "links 0 and 1 both have step 1",
    ),
    "two nodes of one object": (
        '{"nodes": [{"id": "a", "box": BOX}, {"id": "b", "box": BOX}], "edges": []}',
        "nodes 'a' and 'b' are both object 1",
    ),
    "two models": (
        '[{"model": "x", "edges": []}, {"model": "y", "board": 1, "edges": []}]',
        "board 1 has the model 'y', and board 0 has 'x'",
    ),
    "two thresholds": (
        '[{"edges": []}, {"threshold": 0.9, "board": 1, "edges": []}]',
        "board 1 has the threshold 0.9, and board 0 has 0.5",
    ),
    "two of a board": ('[{"edges": []}, {"edges": []}]', "a second graph of board 0"),
    "no JSON": ("graph", "not valid JSON"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_wrong_is_named(fault: str, tmp_path: Path) -> None:
    text, message = WRONG[fault]
    box = make_episode(0).image(0).boxes[1].tolist()
    (tmp_path / "graph.json").write_text(text.replace("BOX", str(box)))
    with pytest.raises(BusybotError, match=message) as error:
        read_graphs(tmp_path / "graph.json").of(make_episode(0))
    assert "graph.json" in error.value.what and error.value.hint
