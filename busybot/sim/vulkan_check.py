"""Checks that SAPIEN renders here: `python -m busybot.sim.vulkan_check` renders a tiny image and prints a JSON object.

A bad Vulkan driver can crash the process, at exit too, or hang: so `run` asks in a process of its own with a time
limit. With `--cuda` PyTorch computes on the GPU before and after: there are hosts on which either works alone and both
together hang. Importing this module imports nothing but the standard library: the set-up runs it from outside of
`.venv`.
"""

import ctypes
import json
import os
import subprocess
import sys
from ctypes import Structure, c_char, c_uint8, c_uint32, c_uint64, c_void_p
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SIZE = 16
BESIDE = "--cuda"
NO_ANSWER: dict[str, Any] = {"renders": False, "device": None, "driver": None, "error": None}
STRUCTURE_PROPERTIES2 = 1000059001
STRUCTURE_DRIVER = 1000196000
STRUCTURE_INSTANCE = 1
KIND, OF_CORES = 4, 4
"""Where a device's numbers say what kind it is, and VK_PHYSICAL_DEVICE_TYPE_CPU."""
VULKAN_1_2 = (1 << 22) | (2 << 12)


def run(python: str = sys.executable, time_limit_s: float = 60.0, cuda: bool = False) -> dict[str, Any]:
    """Probe in a new process of `python`.

    Args:
        cuda: while PyTorch uses the GPU in the same process.

    Returns:
        `renders` (bool), `device` and `driver` (names, or None when unknown), `error` (None when it renders).
    """
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    try:
        done = subprocess.run(
            [python, "-m", "busybot.sim.vulkan_check", *([BESIDE] if cuda else [])],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=time_limit_s,
            env=os.environ | {"PYTHONPATH": path},
        )
    except subprocess.TimeoutExpired:
        return NO_ANSWER | {"error": f"the probe did not end within {time_limit_s:g} s"}
    except OSError as error:
        return NO_ANSWER | {"error": f"the probe did not start: {error}"}
    for line in reversed(done.stdout.splitlines()):
        if line.startswith("{"):
            return NO_ANSWER | json.loads(line)
    words = [line for line in done.stderr.splitlines() if line.strip()]
    last = words[-1].strip() if words else "no message"
    return NO_ANSWER | {"error": f"the probe ended with code {done.returncode}: {last}"}


def probe() -> dict[str, Any]:
    """Render a red box in this process; what `run` returns. Errors of SAPIEN come back as text."""
    answer = dict(NO_ANSWER)
    try:
        import sapien
    except ImportError as error:
        return NO_ANSWER | {"error": f"sapien cannot be imported: {error}"}
    try:
        name = render_device()
        # Without a usable device this raises, or crashes the process.
        renderer = sapien.render.RenderSystem(*([sapien.Device(name)] if name else []))
        answer["device"] = renderer.device.name
        answer["driver"] = driver_of(renderer.device.name)
        answer["renders"] = _red_box_is_seen(sapien, renderer)
        answer["error"] = None if answer["renders"] else "the picture of a red box is not as it should be"
    except Exception as error:  # whatever the driver or SAPIEN says belongs into the answer
        answer["error"] = f"{type(error).__name__}: {error}"
    return answer


def probe_beside_cuda() -> dict[str, Any]:
    """As `probe`, between two sums of PyTorch on the GPU."""
    import torch

    ones = torch.ones(SIZE, SIZE, device="cuda")
    if ones.sum().item() != SIZE**2:
        return NO_ANSWER | {"error": "PyTorch does not compute on the GPU as it should"}
    answer = probe()
    if ones.sum().item() != SIZE**2:
        return answer | {"renders": False, "error": "PyTorch does not compute as before once a picture is drawn"}
    return answer


def render_device() -> str | None:
    """SAPIEN's name of the device on which this process draws; None where it is to take what Vulkan offers.

    Beside a GPU `auto` draws on the cores, where Vulkan has a driver for them: on some hosts networks and pictures
    together hang on one GPU. What is named is taken. Raises as `common.device.choose`.
    """
    from busybot.common.device import AUTO, chosen, gpu, gpus

    if chosen() == AUTO and not gpus():
        return None
    if chosen() == AUTO and draws_on_cores():
        return "cpu"
    number = gpu()
    return "cpu" if number is None else f"cuda:{number}"


def _red_box_is_seen(sapien: Any, renderer: Any) -> bool:
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), renderer])
    sapien.render.set_camera_shader_dir("trivial")
    builder = scene.create_actor_builder()
    material = sapien.render.RenderMaterial(base_color=[1.0, 0.0, 0.0, 1.0])
    builder.add_box_visual(half_size=[0.2, 0.2, 0.2], material=material)
    builder.build_static().set_pose(sapien.Pose([1.0, 0.0, 0.0]))
    camera = scene.add_camera("probe", SIZE, SIZE, 1.0, 0.1, 10.0)
    scene.set_ambient_light([1.0, 1.0, 1.0])
    scene.update_render()
    camera.take_picture()
    picture = camera.get_picture("Color")
    middle, corner = picture[SIZE // 2, SIZE // 2], picture[0, 0]
    return bool(middle[0] > 0.5 and middle[1] < 0.2 and corner[0] < 0.2)


def driver_of(device: str) -> str | None:
    """Name and version of the Vulkan driver of the device with this name, as the driver states them, or None."""
    return next((driver for name, driver, _ in vulkan_devices() if name == device), None)


def draws_on_cores() -> bool:
    """Whether Vulkan has a driver that draws without a GPU."""
    return any(kind == OF_CORES for _, _, kind in vulkan_devices())


@cache
def vulkan_devices() -> tuple[tuple[str, str, int], ...]:
    """Name, driver with its version, and kind (VkPhysicalDeviceType) of all that Vulkan offers."""
    for library in (os.environ.get("SAPIEN_VULKAN_LIBRARY_PATH"), "libvulkan.so.1"):
        try:
            found = _devices(ctypes.CDLL(library)) if library else ()
        except (OSError, AttributeError):
            continue
        if found:
            return found
    return ()


class _Driver(Structure):
    """VkPhysicalDeviceDriverProperties."""

    _fields_ = [
        ("type", c_uint32),
        ("next", c_void_p),
        ("id", c_uint32),
        ("name", c_char * 256),
        ("info", c_char * 256),
        ("conformance", c_uint8 * 4),
    ]


class _Properties(Structure):
    """VkPhysicalDeviceProperties2; the limits after the name are only room for what the driver writes."""

    _fields_ = [
        ("type", c_uint32),
        ("next", c_void_p),
        ("numbers", c_uint32 * 5),
        ("name", c_char * 256),
        ("rest", c_uint8 * 2048),
    ]


class _Application(Structure):
    """VkApplicationInfo, with only the version of Vulkan set."""

    _fields_ = [("type", c_uint32), ("names", c_uint64 * 4), ("engine", c_uint32), ("version", c_uint32)]


class _Instance(Structure):
    """VkInstanceCreateInfo without layers and extensions."""

    _fields_ = [
        ("type", c_uint32),
        ("next", c_void_p),
        ("flags", c_uint32),
        ("application", c_void_p),
        ("layers", c_uint64 * 2),
        ("extensions", c_uint64 * 2),
    ]


def _devices(vulkan: ctypes.CDLL) -> tuple[tuple[str, str, int], ...]:
    """What `vulkan_devices` tells, as this library does."""
    application = _Application(version=VULKAN_1_2)
    create = _Instance(type=STRUCTURE_INSTANCE, application=ctypes.addressof(application))
    instance, count = c_void_p(), c_uint32()
    if vulkan.vkCreateInstance(ctypes.byref(create), None, ctypes.byref(instance)) != 0:
        return ()
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    devices = (c_void_p * count.value)()
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    found = []
    for device in devices:
        answer = _Driver(type=STRUCTURE_DRIVER)
        properties = _Properties(type=STRUCTURE_PROPERTIES2, next=ctypes.addressof(answer))
        vulkan.vkGetPhysicalDeviceProperties2(c_void_p(device), ctypes.byref(properties))
        driver = f"{answer.name.decode()} {answer.info.decode()}".strip()
        found.append((properties.name.decode(), driver, int(properties.numbers[KIND])))
    vulkan.vkDestroyInstance(instance, None)
    return tuple(found)


if __name__ == "__main__":
    print(json.dumps(probe_beside_cuda() if BESIDE in sys.argv[1:] else probe()), flush=True)
    # A failed render device can crash the interpreter at its end; the answer is out, so end at once.
    os._exit(0)
