"""The default objects: the same bytes for the same seed, closed surfaces, every role in both splits."""

import hashlib
import shutil
from collections import Counter
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from busybot.boards.config import BoardConfig
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.datasets.create import create_dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.objects import cache
from busybot.objects.library import Library
from busybot.objects.model import CATEGORIES
from busybot.objects.procedural import build
from busybot.objects.procedural.build import FAMILIES, families_with, make_library, procedural_library
from busybot.objects.procedural.cad import ball, box, lathe, pipe, rectangle, torus
from busybot.objects.procedural.design import MovingLink, facing
from busybot.objects.procedural.switches import sliding as slides
from busybot.objects.procedural.switches.drawn import drawn
from busybot.objects.resolve import find
from busybot.sim.collect import CollectConfig, collect

TRIANGLES = 5_000
SMALL = {"width": 160, "height": 120}


@pytest.fixture(scope="module")
def library(procedural: Path) -> Library:
    return Library.load(procedural)


def digest(folder: Path) -> str:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return hashlib.sha256(b"".join(str(p.relative_to(folder)).encode() + p.read_bytes() for p in files)).hexdigest()


@pytest.mark.long
def test_same_seed_same_bytes(procedural: Path, tmp_path: Path, few_objects: Callable[[int], Path]) -> None:
    make_library(tmp_path / "again", seed=0)
    assert digest(tmp_path / "again") == digest(procedural)
    some, other = few_objects(0), few_objects(1)
    for folder in sorted(path.parent for path in some.glob("*/*/mobility.urdf")):
        place = folder.relative_to(some)
        assert digest(folder) == digest(procedural / place), "whichever others are made"
    assert digest(some) != digest(other)


def test_enough_of_everything(library: Library) -> None:
    counted = Counter(model.category for model in library.objects.values())
    assert counted["Switch"] >= 40 and counted["Door"] >= 10 and counted["Lamp"] >= 6 and counted["Toy"] >= 3


@pytest.mark.parametrize("split", ["train", "novel"])
def test_every_role_in_every_split(library: Library, split: str) -> None:
    triggers = [library.get(key).trigger_links for key, _ in library.weights(split, "Switch")]
    assert any(len(links) == 1 and links[0].kind == "two-state" for links in triggers)
    assert any(links[0].kind == "multi-direction" for links in triggers)
    assert any(len(links) > 1 for links in triggers)
    assert any(links[0].upper - links[0].lower < 0.15 and links[0].joint_type == "revolute" for links in triggers)
    lamps = [library.get(key).effect for key, _ in library.weights(split, "Lamp")]
    assert len(lamps) >= 3 and all(effect is not None and effect.single and effect.multi for effect in lamps)
    doors = [library.get(key).effect for key, _ in library.weights(split, "Door")]
    assert len(doors) >= 4 and all(effect is not None and effect.single for effect in doors)
    toys = [library.get(key).effect for key, _ in library.weights(split, "Toy")]
    assert toys and all(effect is not None and effect.multi for effect in toys)


def test_switches_to_learn_from_are_many_and_their_families_too(library: Library) -> None:
    families = {split: Counter(f.category for f in FAMILIES if f.split == split) for split in ("train", "novel")}
    assert families["train"]["Switch"] >= 40 and families["novel"]["Switch"] >= 12
    assert len(library.weights("train", "Switch")) >= 60 and len(library.weights("novel", "Switch")) >= 14


def test_families_are_in_one_split(library: Library) -> None:
    names = [(family.category, family.name) for family in FAMILIES]
    assert len(set(names)) == len(names)
    makers = {split: {family.make for family in FAMILIES if family.split == split} for split in ("train", "novel")}
    assert not makers["train"] & makers["novel"], "no family is in both splits under two names"
    told = {
        split: {key.rsplit("-", 1)[0] for category in CATEGORIES for key, _ in library.weights(split, category)}
        for split in ("train", "novel")
    }
    assert not told["train"] & told["novel"]
    in_splits = {f"{family.category}/{family.name}" for family in FAMILIES if family.split}
    assert told["train"] | told["novel"] == in_splits, "the rest is for scenes alone"


@pytest.mark.long
def test_no_two_objects_have_one_shape(procedural: Path) -> None:
    """But those of scenes: the knobs of a stove may differ in colour alone."""
    shapes: dict[bytes, str] = {}
    scenes = {family.name for family in FAMILIES if not family.split}
    for folder in sorted(path.parent for path in procedural.glob("*/*/mobility.urdf")):
        corners = [read_obj(path)[0] for path in sorted(folder.glob("textured_objs/*.obj"))]
        shape = np.sort(np.concatenate(corners), axis=0).tobytes()
        like = shapes.setdefault(shape, folder.name)
        alike = {name.rsplit("-", 1)[0] for name in (like, folder.name)}
        assert like == folder.name or alike <= scenes, f"{folder.name} has the shape of {like}"


@pytest.mark.parametrize("split", ["train", "novel"])
def test_some_links_hardly_move(library: Library, split: str) -> None:
    """The paper's small-displacement triggers: tilts of less than 9 degrees, or travels of less than 0.03 units."""
    models = [library.get(key) for key, _ in library.weights(split, "Switch")]
    travels = [
        (link.joint_type, (link.upper - link.lower) * (model.scale if link.joint_type == "prismatic" else 1.0))
        for model in models
        for link in model.trigger_links
    ]
    assert any(joint == "revolute" and travel < 0.16 for joint, travel in travels)
    assert any(joint == "prismatic" and travel < 0.03 for joint, travel in travels)


def test_quarter_turns_turn_everything() -> None:
    design = slides.drawer(0, generator(0, "test", 0, "drawer"))
    once, again = facing(design, 1), facing(design, 5)
    link, turned_link = design.links[0], once.links[0]
    assert turned_link.axis == pytest.approx((-link.axis[1], link.axis[0], link.axis[2]))
    assert turned_link.origin == pytest.approx((-link.origin[1], link.origin[0], link.origin[2]))
    for part, turned_part, same in zip(link.parts, turned_link.parts, again.links[0].parts, strict=True):
        x, y, z = part.solid.vertices.T
        assert turned_part.solid.vertices == pytest.approx(np.stack([-y, x, z], axis=1), abs=1e-12)
        assert same.solid.vertices == pytest.approx(turned_part.solid.vertices)
    assert {d for d in facing(design, 2).directions} == set(design.directions), "both signs are annotated"


@pytest.mark.parametrize("new", [0, 60])
def test_moving_links_stay_over_their_object(new: int) -> None:
    """So nothing on a board runs into its neighbour: boards keep at least a quarter of a switch's size free."""
    for family in families_with(new):
        for variant in range(family.count if family.category == "Switch" else 0):
            seed = 7 if family.name == "drawn" else 0
            design = family.make(variant, generator(seed, "procedural", variant, f"{family.category}/{family.name}"))
            parts = [*design.body, *(part for link in design.links for part in link.parts)]
            rest = np.concatenate([part.solid.vertices for part in parts])
            for link in design.links:
                for position in np.linspace(link.lower, link.upper, 5):
                    moved = at_position(link, float(position))
                    beyond = np.maximum(moved - rest.max(0), rest.min(0) - moved)[:, :2].max()
                    assert beyond < 0.10, (family.name, variant, beyond)
                    assert moved[:, 2].min() > -0.08, (family.name, variant, "sinks into the board")


def test_drawn_switches_are_sound_and_each_is_another() -> None:
    """Closed, outward, of a board's size; all motions, one link and several, two rests and three."""
    designs = [drawn(number, generator(3, "test", number, "drawn")) for number in range(60)]
    shapes = set()
    for number, design in enumerate(designs):
        parts = [*design.body, *(part for link in design.links for part in link.parts)]
        for part in parts:
            mesh = trimesh.Trimesh(part.solid.vertices, part.solid.faces)
            assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0, number
        corners = np.concatenate([part.solid.vertices for part in parts])
        sides = np.ptp(corners[:, :2], axis=0)
        assert sides.min() >= 0.15 and sides.max() <= 0.6, number
        assert sum(len(part.solid.faces) for part in parts) <= 2 * TRIANGLES, number
        shapes.add(design.links[0].parts[0].solid.vertices.round(9).tobytes())
    assert len(shapes) == len(designs)
    assert {len(design.links) for design in designs} > {1, 2}
    assert {link.kind for design in designs for link in design.links} == {"small", "large"}
    assert {link.label for design in designs for link in design.links} == {
        "button",
        "rocker",
        "lever",
        "slider",
        "knob",
    }


@pytest.mark.long
def test_drawn_switches_stand_in_for_the_novel_ones_and_can_be_moved(tmp_path: Path) -> None:
    """The oracle moves what it holds; models see them on boards of novel objects alone."""
    make_library(tmp_path / "library", 4, 12)
    library = Library.load(tmp_path / "library")
    novel = {key for key, _ in library.weights("novel", "Switch")}
    assert novel == {f"Switch/drawn-{number:02d}" for number in range(1, 13)}
    assert not {key for key, _ in library.weights("train", "Switch")} & novel
    config = BoardConfig(split="novel-object", boards=6, seed=0, group_size=1)
    dataset = create_dataset(tmp_path / "data", config, library)
    collect(dataset, library, CollectConfig.model_validate({"policy": "scripted", "steps": 8, "render": SMALL}), 1)
    steps = [step for index in dataset.finished() for step in read_episode(dataset.episode_path(index), "lazy").steps]
    assert len(steps) == 48 and all(step.success for step in steps)


def at_position(link: MovingLink, position: float) -> np.ndarray:
    """Vertices of a link without parent at a joint position, board units."""
    vertices = np.concatenate([part.solid.vertices for part in link.parts])
    axis = np.array(link.axis)
    if link.joint_type == "prismatic":
        return vertices + position * axis
    return Rotation.from_rotvec(position * axis).apply(vertices - link.origin) + link.origin


def test_sizes_are_those_of_a_board(library: Library) -> None:
    largest = {"Switch": 0.6, "Lamp": 0.75, "Door": 0.95, "Toy": 0.95}
    for model in library.objects.values():
        size = (np.array(model.bounds_max) - model.bounds_min) * model.scale
        assert size[:2].max() <= largest[model.category], model.key
        assert size[:2].min() >= 0.15, model.key
        assert model.bounds_min[2] * model.scale + model.offset_z == pytest.approx(0, abs=0.03), model.key


def test_lamps_are_off_first_and_then_saturated(library: Library) -> None:
    for key, model in library.objects.items():
        if model.category == "Lamp":
            assert model.effect is not None and model.effect.single is not None and model.effect.multi is not None
            states = {*model.effect.single, *model.effect.multi}
            assert model.effect.single[0] == model.effect.multi[0] == (0, 0, 0)
            assert len(states) == 4, key
            assert all(max(color) == 1 and min(color) == 0 for color in states if any(color)), key


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    lines = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([line[1:] for line in lines if line[0] == "v"], float)
    return vertices, np.array([[int(c.split("/")[0]) - 1 for c in line[1:]] for line in lines if line[0] == "f"])


@pytest.mark.long
def test_meshes_are_closed_and_few(procedural: Path) -> None:
    """Every part is a closed surface with outward faces, so shading and depth are right from all sides."""
    for folder in sorted(path.parent for path in procedural.glob("*/*/mobility.urdf")):
        triangles = 0
        for path in sorted(folder.glob("textured_objs/*.obj")):
            vertices, faces = read_obj(path)
            triangles += len(faces)
            edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
            forth, back = (np.sort(e @ [len(vertices), 1]) for e in (edges, edges[:, ::-1]))
            assert len(np.unique(forth)) == len(forth) and (forth == back).all(), f"{path} is not closed"
            links = coo_array((np.ones(len(edges)), edges.T), shape=(len(vertices), len(vertices)))
            _, part = connected_components(links, directed=False)
            a, b, c = vertices[faces].transpose(1, 0, 2)
            volumes = np.bincount(part[faces[:, 0]], np.einsum("ij,ij->i", a, np.cross(b, c)) / 6)
            assert volumes.min() > 0, f"{path} has a part that is inside out"
        assert triangles <= TRIANGLES, (folder.name, triangles)


@pytest.mark.parametrize(
    ("solid", "volume"),
    [
        (box(1, 2, 3), 6.0),
        (ball(1, 64, 32), 4.19),
        (lathe([(1, 0), (1, 2)], 64), 6.28),
        (torus(2, 0.5, 64, 32), 9.87),
        (pipe([(0, 0, 0), (0, 0, 1), (0, 0, 2)], 1, 64), 6.28),
    ],
)
def test_solids_are_closed_and_face_outwards(solid: "trimesh.Trimesh", volume: float) -> None:
    mesh = trimesh.Trimesh(solid.vertices, solid.faces)
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume, rel=0.02)


def test_outlines_run_counter_clockwise() -> None:
    x, y = rectangle(2, 1, 0.2).T
    assert 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) == pytest.approx(2 - 0.04 * (4 - np.pi), abs=0.01)


def test_a_filled_folder_is_refused(procedural: Path) -> None:
    with pytest.raises(BusybotError, match="empty folder"):
        make_library(procedural)


def test_the_default_library_is_kept_and_mended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "FAMILIES", [family for family in FAMILIES if family.name in ("rocker", "hatch")])
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path))
    library = find(None)
    assert library.name == "procedural" and library.folder.is_relative_to(tmp_path)
    written = (library.folder / "data.json").stat().st_mtime_ns
    assert procedural_library().sha256 == library.sha256
    assert (library.folder / "data.json").stat().st_mtime_ns == written, "it was not made again"
    shutil.rmtree(library.folder / "Door" / "hatch-01" / "textured_objs")
    assert procedural_library().sha256 == library.sha256
    assert [path.name for path in cache.cache_folder().iterdir() if path.name.startswith(".")] == []


def _sha256(_: int) -> str:
    return procedural_library().sha256


@pytest.mark.long
def test_builds_at_once_do_not_disturb_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path))
    with get_context("spawn").Pool(2) as pool:
        assert len(set(pool.map(_sha256, range(2)))) == 1
