"""Real and procedural folders become models with the right facts; whatever is broken or hostile is refused by name."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from busybot.boards.spec import BODY
from busybot.common.errors import BusybotError
from busybot.objects.partnet.loader import UNLIMITED_RANGE, load_object

MESH = "textured_objs/link_0.obj"


def test_a_real_panel_has_its_links_in_order(partnet: Path) -> None:
    model = load_object(partnet / "Switch" / "100367")
    assert model.role == "trigger" and model.effect is None
    assert [link.name for link in model.trigger_links] == ["link_0", "link_1", "link_2", "link_3"]
    assert {link.kind for link in model.trigger_links} == {"two-state"}
    assert model.orientation == pytest.approx((0.7071068, 0, 0.7071068, 0))


@pytest.mark.parametrize("instance", ["100849", "100965", "100970", "102812", "102860"])
def test_real_multi_direction_triggers(partnet: Path, instance: str) -> None:
    (link,) = load_object(partnet / "Switch" / instance).trigger_links
    assert (link.kind, link.states) == ("multi-direction", 3)


def test_joint_ids_count_depth_first(partnet: Path) -> None:
    """On lamp 14605 the document's order and the tree's differ: link 3 is the shade, not the arm."""
    effect = load_object(partnet / "Lamp" / "14605").effect
    assert effect is not None and effect.link == "link_0"
    assert effect.single == ((0, 0, 0), (1, 0, 0))
    assert effect.multi == ((0, 0, 0), (0, 1, 1), (0, 1, 0))


@pytest.mark.parametrize(("instance", "closed"), [("9117", -1.5707963), ("8867", -0.8168141), ("8893", 0.0)])
def test_doors_are_closed_in_state_0(partnet: Path, instance: str, closed: float) -> None:
    """Whatever the signs of the limits, the flatter end is closed."""
    effect = load_object(partnet / "Door" / instance).effect
    assert effect is not None and effect.single is not None
    assert effect.single[0] == pytest.approx((closed,))
    assert abs(effect.single[1][0] - closed) > 1.5


def test_real_toys_have_three_steps(partnet: Path) -> None:
    effect = load_object(partnet / "Toy" / "toy1").effect
    assert effect is not None and effect.single is None
    assert effect.joints == ("yDir", "xDir")
    assert effect.multi == ((0, 0), (0, -0.3), (0, 0.3))


def test_boxes_are_what_the_object_occupies(partnet: Path) -> None:
    """The annotated box of lamp 14605 is turned by half a turn; the true one reaches 0.81 to the right."""
    model = load_object(partnet / "Lamp" / "14605")
    assert model.bounds_max[0] == pytest.approx(0.81061, abs=1e-3)
    assert model.bounds_min[0] == pytest.approx(-0.423282, abs=1e-3)


def test_all_real_objects_load(partnet: Path) -> None:
    folders = sorted(path.parent for path in partnet.glob("*/*/mobility.urdf"))
    models = [load_object(folder) for folder in folders]
    assert len(models) == 58
    assert len({model.sha256 for model in models}) == 58


def test_hash_follows_content_not_place(thing: Path, tmp_path: Path) -> None:
    first = load_object(thing)
    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(thing, elsewhere)
    assert load_object(elsewhere).sha256 == first.sha256
    mesh = elsewhere / MESH
    mesh.write_text(mesh.read_text() + "# one more line\n")
    assert load_object(elsewhere).sha256 != first.sha256


@pytest.fixture
def thing(procedural: Path, tmp_path: Path) -> Path:
    """A good slider switch that a test may damage."""
    folder = tmp_path / "slider-01"
    shutil.copytree(procedural / "Switch" / "slider-01", folder)
    return folder


Damage = Callable[[Path], object]


def rewrite(name: str, old: str, new: str) -> Damage:
    def damage(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return damage


def annotate(**changes: object) -> Damage:
    def damage(folder: Path) -> None:
        path = folder / "object_meta_info.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))

    return damage


def effect(entry: object) -> Damage:
    return annotate(Category="Toy", Cause=[], Movable_link={}, Effect=[entry])


def append(name: str, text: str) -> Damage:
    return lambda folder: (folder / name).write_text((folder / name).read_text() + text)


def replace(name: str, data: bytes) -> Damage:
    return lambda folder: (folder / name).write_bytes(data)


def texture(size: tuple[int, int] | None) -> Damage:
    def damage(folder: Path) -> None:
        append("textured_objs/link_0.mtl", "map_Kd big.png\n")(folder)
        if size is None:
            (folder / "textured_objs" / "big.png").write_bytes(b"\x89PNG\r\n\x1a\n and nothing else")
        else:
            Image.new("1", size).save(folder / "textured_objs" / "big.png")

    return damage


def link_out(folder: Path) -> None:
    outside = folder.parent / "outside.obj"
    (folder / MESH).rename(outside)
    (folder / MESH).symlink_to(outside)


def call_the_link_body(folder: Path) -> None:
    urdf = folder / "mobility.urdf"
    urdf.write_text(urdf.read_text().replace('"body"', '"frame"').replace('"link_0"', f'"{BODY}"'))
    annotate(Movable_link={BODY: {}})(folder)


def many_vertices(folder: Path) -> None:
    (folder / MESH).write_text("v 0 0 0\n" * 200_001 + "f 1 2 3\n")


BOMB = b'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]><robot name="&b;"></robot>'
CAUSE = [{"JointId": 1, "IsSmallCause": 1, "IsLargeCause": 0}]
COLOR = {"Type": "link", "LinkId": 1, "IsSingleEffect": 1, "IsMultiEffect": 0, "States": [[0, 0, 0], [1, 0, 2]]}
SWATCHES = {"Type": "link", "LinkId": 1, "IsSingleEffect": 1, "IsMultiEffect": 1}
STATES, STEPS = [[0, 0, 0], [1, 0, 0]], [[0, 0, 0, 1], [1, 0, 0, 1], [0, 0, 1, 1]]
CYCLE = (
    '<link name="a"/><link name="b"/>'
    '<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>'
    '<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>'
)

DAMAGES: dict[str, tuple[Damage, str]] = {
    "no annotation": (lambda folder: (folder / "object_meta_info.json").unlink(), "object_meta_info.json"),
    "annotation is a list": (replace("object_meta_info.json", b"[]"), "object_meta_info.json"),
    "annotation is cut off": (replace("object_meta_info.json", b'{"Category": "Sw'), "not valid JSON"),
    "annotation is not UTF-8": (replace("object_meta_info.json", b"\xff\xfe\x00"), "not valid JSON"),
    "annotation nested without end": (replace("object_meta_info.json", b"[" * 200_000), "not valid JSON"),
    "annotation with a number of a million digits": (
        replace("object_meta_info.json", b'{"Scale": ' + b"9" * 1_000_000 + b"}"),
        "not valid JSON",
    ),
    "missing scale": (annotate(Scale=None), "Scale"),
    "scale is text": (annotate(Scale="0.25"), "Scale"),
    "scale is zero": (annotate(Scale=0), "Scale"),
    "scale is infinite": (rewrite("object_meta_info.json", '"Scale": 0.25', '"Scale": Infinity'), "Scale"),
    "box without height": (annotate(MaxBBox=[1, 1, 0], MinBBox=[-1, -1, 0]), "bounding box"),
    "unknown category": (annotate(Category="Drone"), "Drone"),
    "instance with a path": (annotate(InstanceId="../../etc"), "InstanceId"),
    "orientation of length 2": (annotate(Orientation=[0, 0, 0, 2]), "Orientation"),
    "neither trigger nor responder": (annotate(Cause=[]), "Cause and Effect"),
    "both small and large": (annotate(Cause=[CAUSE[0] | {"IsLargeCause": 1}]), "IsSmallCause"),
    "joint number too high": (annotate(Cause=[CAUSE[0] | {"JointId": 9}]), "JointId"),
    "joint number of a fixed joint": (annotate(Cause=[CAUSE[0] | {"JointId": 0}]), "fixed joint"),
    "joint number negative": (annotate(Cause=[CAUSE[0] | {"JointId": -1}]), "JointId"),
    "link that no cause moves": (annotate(Movable_link={"link_0": {}, "link_7": {}}), "link_7"),
    "colour above 1": (annotate(Cause=[], Effect=[COLOR]), "colour"),
    "no URDF": (lambda folder: (folder / "mobility.urdf").unlink(), "mobility.urdf"),
    "URDF is cut off": (replace("mobility.urdf", b"<robot><link"), "not valid XML"),
    "URDF with an unknown encoding": (
        replace("mobility.urdf", b'<?xml version="1.0" encoding="x-no"?><robot/>'),
        "XML",
    ),
    "URDF nested without end": (replace("mobility.urdf", b"<a>" * 50_000 + b"</a>" * 50_000), "mobility.urdf"),
    "entity bomb": (replace("mobility.urdf", BOMB), "entities"),
    "another root": (replace("mobility.urdf", b"<sdf/>"), "<sdf>"),
    "absolute mesh": (rewrite("mobility.urdf", MESH, "/etc/passwd"), "/etc/passwd"),
    "mesh above": (rewrite("mobility.urdf", MESH, "../../outside.obj"), "leaves the object's folder"),
    "package mesh": (rewrite("mobility.urdf", MESH, "package://textured_objs/link_0.obj"), "package://"),
    "mesh by http": (rewrite("mobility.urdf", MESH, "http://example.org/a.obj"), "http://"),
    "mesh with a backslash": (rewrite("mobility.urdf", MESH, "..\\\\outside.obj"), "plain relative path"),
    "mesh of which some vertices have colours": (
        replace(MESH, b"v 0 0 0 9 9 9\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "a vertex, normal or texture coordinate is not",
    ),
    "missing mesh": (lambda folder: (folder / MESH).unlink(), "missing"),
    "mesh of another kind": (rewrite("mobility.urdf", MESH, "mobility.urdf"), ".obj"),
    "mesh is a link": (link_out, "is a link"),
    "mesh is a pipe": (lambda folder: os.mkfifo(folder / "pipe"), "not a regular file"),
    "unknown joint type": (rewrite("mobility.urdf", 'type="prismatic"', 'type="floating"'), "floating"),
    "limit that is not a number": (rewrite("mobility.urdf", 'lower="-0.26"', 'lower="nan"'), "nan"),
    "limits the wrong way round": (rewrite("mobility.urdf", 'lower="-0.26"', 'lower="0.9"'), "above the upper limit"),
    "no range": (rewrite("mobility.urdf", 'lower="-0.26" upper="0.26"', 'lower="0" upper="0"'), "no range"),
    "axis of length zero": (rewrite("mobility.urdf", 'axis xyz="1 0 0"', 'axis xyz="0 0 0"'), "zero vector"),
    "infinite mass": (rewrite("mobility.urdf", 'mass value="10"', 'mass value="1e999"'), "mass"),
    "two links of one name": (rewrite("mobility.urdf", 'name="link_0"', 'name="body"'), "body"),
    "joint of an unknown link": (rewrite("mobility.urdf", 'child link="link_0"', 'child link="link_9"'), "link_9"),
    "joint that follows another one": (
        rewrite("mobility.urdf", "<limit", '<mimic joint="joint_0"/><limit'),
        "'joint_0' follows another joint",
    ),
    "no limits": (rewrite("mobility.urdf", "<limit", "<nothing"), "joint 'joint_0' has no lower limit"),
    "one limit": (rewrite("mobility.urdf", ' upper="0.26"', ""), "joint 'joint_0' has no upper limit"),
    "moving link with the name of the whole": (call_the_link_body, "moves the link 'body'"),
    "cycle of joints": (rewrite("mobility.urdf", "</robot>", CYCLE), "cycle"),
    "SRDF beside the URDF": (lambda folder: (folder / "mobility.srdf").write_text("<robot/>"), "SRDF"),
    "too many links": (
        rewrite("mobility.urdf", "</robot>", "".join(f'<link name="x{k}"/>' for k in range(99)) + "</robot>"),
        "102 links",
    ),
    "vertex that is not finite": (append(MESH, "v nan 0 0\n"), "link_0.obj"),
    "vertex far away": (append(MESH, "v 0 0 1e30\n"), "link_0.obj"),
    "vertex with words": (append(MESH, "v 0 zero 0\n"), "link_0.obj"),
    "too many vertices": (many_vertices, "200001 vertices"),
    "face without vertex": (append(MESH, "f 1//1 2//1 999999//1\n"), "names vertex 999999"),
    "relative face": (append(MESH, "f -1//1 -2//1 -3//1\n"), "positive indices"),
    "mesh without faces": (replace(MESH, b"v 0 0 0\n"), "no faces"),
    "mesh is binary": (replace(MESH, bytes(range(256))), "link_0.obj"),
    "mesh in one line": (replace(MESH, b"f" + b" 1" * 100_000), "line"),
    "mesh that calls": (append(MESH, "call /etc/passwd\n"), "call"),
    "continued line": (append(MESH, "mtllib \\\n/etc/passwd\n"), "line continuations"),
    "material above": (append(MESH, "mtllib ../../secret.mtl\n"), "secret.mtl"),
    "indented material": (append(MESH, "   mtllib /etc/passwd\n"), "/etc/passwd"),
    "missing material": (append(MESH, "mtllib none.mtl\n"), "none.mtl"),
    "texture above": (append("textured_objs/link_0.mtl", "map_Kd ../../../secret.png\n"), "secret.png"),
    "texture with options": (append("textured_objs/link_0.mtl", "bump -bm 1 /etc/passwd\n"), "/etc/passwd"),
    "material of many kinds": (
        append("textured_objs/link_0.mtl", "".join(f"map_{k} x.png\n" for k in range(9999))),
        "kinds of statements",
    ),
    "mesh of many lines": (append(MESH, "\n" * 2_000_001), "lines"),
    "material with words": (append("textured_objs/link_0.mtl", "Kd red\n"), "Kd"),
    "material with an unknown statement": (append("textured_objs/link_0.mtl", "include x\n"), "include"),
    "monstrous texture": (texture((8192, 4096)), "pixels"),
    "broken texture": (texture(None), "big.png"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_damage_is_refused_by_name(name: str, thing: Path) -> None:
    damage, hint = DAMAGES[name]
    damage(thing)
    with pytest.raises(BusybotError) as caught:
        load_object(thing)
    assert hint in caught.value.what
    assert str(thing.name) in caught.value.what, "the message names the place"
    assert caught.value.hint, "the message says what to do"


def test_equal_values_that_nobody_uses_are_fine(thing: Path) -> None:
    effect(SWATCHES | {"States": STATES, "IsMultiEffect": 0, "Steps": [STEPS[0]] * 3})(thing)
    found = load_object(thing).effect
    assert found is not None and found.multi is None and found.single == ((0, 0, 0), (1, 0, 0))


def test_a_small_texture_is_fine(thing: Path) -> None:
    texture((64, 64))(thing)
    assert load_object(thing).folder == thing.resolve()


def test_missing_limits_are_a_quarter_turn(thing: Path) -> None:
    rewrite("mobility.urdf", 'type="prismatic"', 'type="continuous"')(thing)
    (link,) = load_object(thing).trigger_links
    assert (link.joint_type, link.lower, link.upper) == ("revolute", *UNLIMITED_RANGE)


def test_infinite_limits_are_a_quarter_turn(thing: Path) -> None:
    rewrite("mobility.urdf", 'lower="-0.26" upper="0.26"', 'lower="-inf" upper="inf"')(thing)
    rewrite("mobility.urdf", 'type="prismatic"', 'type="revolute"')(thing)
    (link,) = load_object(thing).trigger_links
    assert (link.joint_type, link.lower, link.upper) == ("revolute", *UNLIMITED_RANGE)


def test_random_damage_never_crashes(procedural: Path, tmp_path: Path) -> None:
    """Flipped, cut and doubled bytes in any file: a model or a BusybotError, nothing else."""
    rng = np.random.default_rng(7)
    source = procedural / "Switch" / "slider-01"
    names = sorted(str(path.relative_to(source)) for path in source.rglob("*") if path.is_file())
    for turn in range(150):
        folder = tmp_path / str(turn)
        shutil.copytree(source, folder)
        path = folder / names[turn % len(names)]
        data = bytearray(path.read_bytes())
        spot = int(rng.integers(len(data)))
        kind = int(rng.integers(3))
        if kind == 0:
            data[spot] = int(rng.integers(256))
        elif kind == 1:
            del data[spot:]
        else:
            data[spot:spot] = data[max(0, spot - 40) : spot]
        path.write_bytes(bytes(data))
        try:
            load_object(folder)
        except BusybotError as error:
            assert str(turn) in error.what
        shutil.rmtree(folder)
