"""Objects as SAPIEN has loaded them, ready to be built again and again; the least recently used are forgotten.

SAPIEN keeps every mesh file that it ever read. Here the cached builder of an object holds its loaded meshes instead, so
that SAPIEN's own cache can be emptied and an object that leaves ours is freed (`benchmarks/speed/collection.py
--memory`).
"""

import ctypes
import sys
from collections import OrderedDict
from functools import cache, partial
from typing import Any

import numpy as np
import sapien
from sapien.wrapper.actor_builder import ActorBuilder
from sapien.wrapper.articulation_builder import ArticulationBuilder

from busybot.common.errors import BusybotError
from busybot.objects.model import ObjectModel
from busybot.sim.scene.mesh_store import component, meshes_of, with_own_materials

KEPT = 64
"""Objects that stay loaded, about 6 MB each: more than the paper's 58."""
MASS, INERTIA = 10.0, 1.0
"""Of every link of the annotated switches, before they are scaled."""
SIZE = 2.0
"""About their diagonal then."""


class _Unbound:
    """Stands in for a scene while a URDF is parsed: builders are bound to a scene when a board is built."""

    def create_articulation_builder(self) -> ArticulationBuilder:
        return ArticulationBuilder()

    def create_actor_builder(self) -> ActorBuilder:
        return ActorBuilder()


class Builders:
    """Articulation builders by object and scale.

    Args:
        looks: whether anybody looks; otherwise meshes are left out.
    """

    def __init__(self, looks: bool):
        self._looks = looks
        self._builders: OrderedDict[tuple[str, float], ArticulationBuilder] = OrderedDict()

    def get(self, model: ObjectModel, scale: float) -> ArticulationBuilder:
        """The object's builder, loaded if it is not there.

        Raises:
            BusybotError: the object cannot be loaded.
        """
        key = (model.key, scale)
        if key not in self._builders:
            self._builders[key] = self._load(model, scale)
        self._builders.move_to_end(key)
        return self._builders[key]

    def forget(self) -> None:
        """Free all but the `KEPT` most recently used objects; those in a living scene are freed with it."""
        if len(self._builders) <= KEPT:
            return
        while len(self._builders) > KEPT:
            self._builders.popitem(last=False)
        if self._looks:
            sapien.render.clear_cache(models=True, images=True)
            # the C library keeps what lies between the pieces that are still in use, and glibc alone can give it back
            trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
            if trim is not None:
                trim(0)

    def _load(self, model: ObjectModel, scale: float) -> ArticulationBuilder:
        loader = _urdf_loader()()
        loader.set_scene(_Unbound())
        loader.fix_root_link = True
        loader.scale = scale
        # clones share their materials: what a board paints is made anew each time
        painted = model.effect.link if model.effect is not None and model.effect.type == "color" else None
        try:
            builder = loader.load_file_as_articulation_builder(str(model.urdf))
            meshes = meshes_of(model, builder.link_builders) if self._looks else None
            for link in builder.link_builders:
                link.collision_records = []
                _give_stops(link.joint_record, model, scale)
                if model.trigger_links:
                    _weigh(link, model, scale)
                if not self._looks:
                    link.visual_records = []
                elif meshes is not None:
                    link.build_render_component = partial(component, link, model.folder, meshes)
                if link.name == painted:
                    link.build_render_component = partial(with_own_materials, link, link.build_render_component)
                elif link.visual_records:
                    link.build_render_component = link.build_render_component().clone
        except Exception as error:  # the loader raises whatever its parsers raise
            raise BusybotError(f"{model.urdf}: SAPIEN cannot load it: {error}", "busybot assets check") from error
        return builder


@cache
def _urdf_loader() -> Any:
    """SAPIEN's reader of URDF, imported without trimesh.

    It takes trimesh, and with it half of SciPy, for meshes that it reads itself, which it does not do here; where there
    is none it goes on without. That saves half of what importing a simulator takes.
    """
    absent = "trimesh" not in sys.modules
    if absent:
        sys.modules["trimesh"] = None  # type: ignore[assignment]  # how Python is told that there is no such module
    try:
        from sapien.wrapper.urdf_loader import URDFLoader
    finally:
        if absent:
            del sys.modules["trimesh"]
    return URDFLoader


def _weigh(link: Any, model: ObjectModel, scale: float) -> None:
    """A trigger's link that does not weigh what those of annotated switches do gets what they would at its size.

    With true masses, or those of a URDF in metres, no hand would move them; without any they would weigh next to
    nothing and go astray.
    """
    mass, inertia = MASS * scale**3, np.full(3, INERTIA * scale**5)
    if link._mass != mass or not np.array_equal(link._inertia, inertia):
        size = float(np.linalg.norm(np.subtract(model.bounds_max, model.bounds_min))) * scale / SIZE
        link.set_mass_and_inertia(MASS * size**3, sapien.Pose(), np.full(3, INERTIA * size**5))


def _give_stops(record: Any, model: ObjectModel, scale: float) -> None:
    """A trigger's joint without limits gets those of the model; SAPIEN cannot set them once the object is built."""
    for link in model.trigger_links:
        if record.name == link.joint and not np.isfinite(record.limits).all():
            unit = scale if link.joint_type == "prismatic" else 1.0
            record.joint_type, record.limits = link.joint_type, [[link.lower * unit, link.upper * unit]]
