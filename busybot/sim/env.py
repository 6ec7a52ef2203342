"""BusyBoard as a Gymnasium environment (paper section 3); `import busybot` registers it (`sim.registration`).

`PixelActions` and `ImageObservations` give its actions and observations other shapes, as libraries for learning agents
want them: they wrap the environment, one around the other, and Gymnasium's own wrappers go around them. As
`busybot/BoardPixels-v0` the environment is wrapped in both.
"""

import math
from collections.abc import Mapping
from typing import Any, TypeVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from pydantic import ValidationError

from busybot.boards.config import BoardConfig
from busybot.boards.directions import DIRECTIONS
from busybot.boards.generate import generate_boards
from busybot.boards.scenes import SCENES
from busybot.boards.spec import BoardSpec
from busybot.boards.worlds import BUILT
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.common.rng import generator
from busybot.episodes import episode as recorded
from busybot.episodes.camera import Rays, project
from busybot.episodes.episode import Image, Step
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.sim.interaction import Grasp, InteractionConfig, interact, look
from busybot.sim.policy import Action, PolicyFactory
from busybot.sim.scene.board_scene import BoardScene, BoardState, Simulator
from busybot.sim.scene.real_camera import REACH, true_depth
from busybot.sim.scene.render import SIGHT, RenderConfig

Observation = dict[str, Any]
Config = TypeVar("Config", bound=FrozenModel)
Core = dict[str, Any]
"""An action of the environment itself."""
State = tuple[BoardSpec, BoardState, int, int]
"""Of a board at rest: the board, its state, the number of steps taken, and the seed of a real camera's pictures."""
STEP_TRUTH = ("success", "acted_object", "changed_pixels", "executed", "distance")
"""What `info` says of a step."""
OPTIONS = ("board", "index")
"""What `reset` takes as options, one of them."""


class BusyBoardEnv(gymnasium.Env[Observation, Core]):
    """A toy board with hidden relations between switches and lamps, doors and toys.

    ## Observation space
    A `Dict`:

    | key | type | range | meaning |
    |---|---|---|---|
    | `rgb` | uint8 (H, W, 3) | 0..255 | the camera's image |
    | `depth` | float32 (H, W) | 0..far; scenes: more | distance along the optical axis, board units; 0: nothing hit |

    ## Action space
    A `Dict`:

    | key | type | range | meaning |
    |---|---|---|---|
    | `position` | float32 (3,) | x, y on the board (-2..2), z in -0.1..2 | suction point, board frame, board units |
    | `direction` | Discrete(18) | 0..17 | index into `busybot.boards.directions.DIRECTIONS` |

    The gripper takes hold of what is visible at the position, moves along the direction and then the opposite one
    until something changes (`busybot.sim.interaction`). A position in the air or out of sight is a miss.

    ## Reward
    1 if more than `interaction.delta` pixels of the image changed, else 0 (paper equation 1).

    ## End of an episode
    Never terminated; truncated after `max_steps` actions.

    ## Ground truth
    Only in `info`: `board` (the BoardSpec), `trigger_states`, `responder_states`, `success` (a trigger changed its
    state), `acted_object`, `changed_pixels`, `executed` (directions tried), `distance` (units).

    ## Arguments
    `assets`: `procedural` or a folder of objects; `boards`: how boards are drawn (`BoardConfig`, its `seed` and number
    of boards are ignored); `render`, `interaction`: see their classes; `max_steps`. Each configuration may be a plain
    dictionary, as `boards={"split": "novel-object"}`. `reset(options={"board": spec})`
    plays a given board, otherwise the seed draws one; `reset(options={"index": i})` takes board i of
    the last seed that was given, or of 0. The
    spaces are those of the boards that are drawn: a given one that is larger, or seen from farther away, is refused.

    ## Versions
    * v0: first version.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}

    def __init__(
        self,
        assets: str | Library = "procedural",
        boards: BoardConfig | Mapping[str, Any] | None = None,
        render: RenderConfig | Mapping[str, Any] | None = None,
        interaction: InteractionConfig | Mapping[str, Any] | None = None,
        max_steps: int = 30,
        render_mode: str | None = None,
    ):
        self.render_mode = render_mode
        self.max_steps = max_steps
        self._boards = _config(BoardConfig, "boards", boards)
        self._view = _config(RenderConfig, "render", render)
        self._interaction = _config(InteractionConfig, "interaction", interaction)
        self._library = assets if isinstance(assets, Library) else find(assets)
        self._simulator: Simulator | None = None
        self._scene: BoardScene | None = None
        self._given_seed: int | None = None
        scene, shape = SCENES.get(self._boards.world), (self._view.height, self._view.width)
        width, height = scene.size if scene else BoardSpec.model_fields["size"].default
        far = max(self._view.far, SIGHT * scene.distance) if scene else self._view.far
        self._most = (width, height, far)
        self.observation_space = spaces.Dict(
            {
                "rgb": spaces.Box(0, 255, (*shape, 3), np.uint8),
                "depth": spaces.Box(0, far, shape, np.float32),
            }
        )
        high = np.array([width / 2, height / 2, 2], np.float32)
        low = np.array([-high[0], -high[1], -0.1], np.float32)
        self.action_space = spaces.Dict(
            {"position": spaces.Box(low, high, dtype=np.float32), "direction": spaces.Discrete(len(DIRECTIONS))}
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        given, index = _asked_for(options or {})
        if given is not None:
            self._check_fits(given)
        super().reset(seed=seed)
        self._given_seed = self._given_seed if seed is None else seed
        board = self._draw(index) if given is None else given
        if self._simulator is None:
            self._simulator = Simulator(self._library, self._view)
        self._scene = self._simulator.board(board)
        self._rays = Rays(self._scene.camera)
        self._seed = self._np_random_seed or 0
        self._image, self._steps = self._look(0), 0
        return self._observation(), self._truth(None)

    def step(self, action: Core) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        scene = self._playing()
        try:
            position, direction = np.asarray(action["position"], np.float32), int(action["direction"])
            known = position.shape == (3,) and np.isfinite(position).all() and 0 <= direction < len(DIRECTIONS)
            known = known and direction == action["direction"]
        except (LookupError, TypeError, ValueError, OverflowError):  # a tuple, no such key, or no number there
            known = False
        if not known:
            raise BusybotError(f"the action {action} is not one", "see `env.action_space`")
        step, after = interact(scene, self.grasp(position), direction, self._interaction, self._image)
        self._image = after or self._image
        self._steps += 1
        return self._observation(), float(step.reward), False, self._steps >= self.max_steps, self._truth(step)

    def render(self) -> np.ndarray | None:
        """The present image, uint8 (H, W, 3), in mode `rgb_array`.

        Raises:
            BusybotError: no episode was begun.
        """
        self._playing()
        return self._image.rgb.copy() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        self._scene = None
        self._simulator = None

    def grasp(self, position: np.ndarray) -> Grasp:
        """What the gripper would hold at a position in the board frame."""
        scene = self._playing()
        pixels, depth = project(position, scene.camera)
        if not np.isfinite(pixels).all():  # at the camera itself
            return Grasp(None, position, (0, 0))
        column, row = (int(value) for value in np.floor(pixels))
        inside = depth > 0 and 0 <= column < self._view.width and 0 <= row < self._view.height
        assert self._image.segmentation is not None
        if not inside or abs(float(depth) - float(true_depth(self._image)[row, column])) > REACH:
            edge = (min(max(column, 0), self._view.width - 1), min(max(row, 0), self._view.height - 1))
            return Grasp(None, position, edge)
        return Grasp(scene.trigger_at(int(self._image.segmentation[row, column])), position, (column, row))

    @property
    def rays(self) -> Rays:
        """The camera's viewing rays, and with them the camera."""
        self._playing()
        return self._rays

    def position_at(self, row: int, column: int) -> np.ndarray:
        """What the camera sees at a pixel, board frame, float32 (3,); the camera's own place where it sees nothing.

        Raises:
            BusybotError: the picture has no such pixel.
        """
        self._playing()
        if not (0 <= row < self._view.height and 0 <= column < self._view.width):
            what = f"there is no pixel in row {row}, column {column}"
            raise BusybotError(what, f"the picture has {self._view.height} rows and {self._view.width} columns")
        assert self._image.depth is not None
        return np.asarray(self._rays.point(self._image.depth, (column, row)), np.float32)

    def save_state(self) -> State:
        """The exact state: the board, its trigger states, the number of steps taken, and the seed of what a real camera
        adds to its pictures."""
        scene = self._playing()
        return scene.spec, scene.save(), self._steps, self._seed

    def restore_state(self, state: State | tuple[BoardSpec, BoardState, int]) -> Observation:
        """Go back to a saved state and return its observation; the same actions then have the same outcomes.

        A state of an earlier version tells no seed: a real camera's pictures are then those of the present one.
        """
        board, saved, steps, *seed = state
        if self._scene is None or self._scene.spec != board:
            self.reset(options={"board": board})
        scene = self._playing()
        scene.restore(saved)
        self._seed = seed[0] if seed else self._seed
        self._image, self._steps = self._look(steps), steps
        return self._observation()

    def _check_fits(self, board: BoardSpec) -> None:
        """Refuse a board on which observations and actions would leave their spaces."""
        most, sight = self._most, self._view.of_board(board).far
        if max(board.size[0] - most[0], board.size[1] - most[1], sight - most[2]) < 1e-6:
            return
        told = f"the board is {board.size[0]:g} x {board.size[1]:g} and seen as far as {sight:.1f}"
        held = f"{most[0]:g} x {most[1]:g} and {most[2]:.1f}"
        hint = f'boards={{"world": "{board.world}"}}'
        if board.world not in SCENES:
            hint = f'render={{"far": {math.ceil(sight)}}}, if the board is not too large'
        raise BusybotError(f"{told}; this environment's spaces are for {held}", f"make the environment with {hint}")

    def _draw(self, index: int | None) -> BoardSpec:
        """One board, drawn from the environment's seed; of a given number, from the last seed that was given, or 0."""
        number = int(self.np_random.integers(2**31)) if index is None else index
        drawn = self._given_seed if index is not None else self._np_random_seed
        rng = generator(drawn or 0, self._boards.split, number, "env")
        seed = int(rng.integers(2**62))
        # the first board of a real board's or a scene's group always has the same relations
        size = self._boards.group_size if self._boards.world in BUILT else 1
        config = self._boards.model_copy(update={"seed": seed, "boards": size, "group_size": size})
        return list(generate_boards(config, self._library))[rng.integers(size)]

    def _look(self, frame: int) -> Image:
        return look(self._playing(), self._seed, frame)

    def _observation(self) -> Observation:
        assert self._image.depth is not None
        return {"rgb": self._image.rgb.copy(), "depth": self._image.depth.copy()}

    def _truth(self, step: Step | None) -> dict[str, Any]:
        scene = self._playing()
        now = {"trigger_states": scene.trigger_states(), "responder_states": scene.responder_states()}
        done = {} if step is None else {name: getattr(step, name) for name in STEP_TRUTH}
        return {"board": scene.spec, **now, **done}

    def _playing(self) -> BoardScene:
        if self._scene is None:
            raise BusybotError("the environment has no board yet", "call reset() first")
        return self._scene


class PixelActions(gymnasium.ActionWrapper[Observation, np.ndarray, Core], RecordConstructorArgs):
    """Act on a pixel: the position is what the depth image shows there.

    ## Action space
    `MultiDiscrete([H, W, 18])`: row and column of the image, and the direction's index.
    """

    def __init__(self, env: gymnasium.Env[Observation, Core]):
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        height, width = _board(env).observation_space["depth"].shape  # type: ignore[index]
        self.action_space = spaces.MultiDiscrete([height, width, len(DIRECTIONS)])

    def action(self, action: np.ndarray) -> Core:
        """The core environment's action. A pixel where the camera sees nothing lies at the camera: a miss."""
        try:
            values = np.asarray(action)
            with np.errstate(invalid="ignore"):  # what is no number, or too large
                whole = values.astype(np.int64)
            known = self.action_space.contains(whole) and np.array_equal(whole, values)
        except (TypeError, ValueError, OverflowError):
            known = False
        if not known:
            raise BusybotError(f"the action {action} is not one", f"it must lie in {self.action_space}")
        row, column, direction = (int(value) for value in action)
        return {"position": _board(self.env).position_at(row, column), "direction": direction}


class ImageObservations(gymnasium.ObservationWrapper[np.ndarray, Any, Observation], RecordConstructorArgs):
    """One array instead of a dictionary, with the channels first, as convolutions want it.

    ## Observation space
    `rgb`: uint8 (3, H, W). `depth`: float32 (1, H, W), board units. `rgbd`: float32 (4, H, W), colours from 0 to 1,
    then depth.
    """

    def __init__(self, env: gymnasium.Env[Observation, Any], kind: str = "rgb"):
        RecordConstructorArgs.__init__(self, kind=kind)
        super().__init__(env)
        if kind not in ("rgb", "depth", "rgbd"):
            raise BusybotError(f"there are no observations {kind!r}", "choose rgb, depth or rgbd")
        self.kind = kind
        assert isinstance(env.observation_space, spaces.Dict)
        depth = env.observation_space["depth"]
        assert isinstance(depth, spaces.Box)
        shape, far = depth.shape, float(depth.high.max())
        shown: dict[str, spaces.Space[np.ndarray]] = {
            "rgb": spaces.Box(0, 255, (3, *shape), np.uint8),
            "depth": spaces.Box(0, far, (1, *shape), np.float32),
            "rgbd": spaces.Box(0, max(far, 1.0), (4, *shape), np.float32),
        }
        self.observation_space = shown[kind]

    def observation(self, observation: Observation) -> np.ndarray:
        """The wrapped environment's observation as one array."""
        colours, depth = np.moveaxis(observation["rgb"], -1, 0), observation["depth"][None]
        if self.kind != "rgbd":
            return np.ascontiguousarray(colours if self.kind == "rgb" else depth)
        return np.concatenate([colours.astype(np.float32) / 255, depth])


class PolicyAgent:
    """A policy that needs no more than the environment tells, as an agent on one board of it.

    It is given what any agent sees, and told what the gripper did (`executed`). Make one after each `reset`.

    Args:
        env: `busybot/Board-v0`, wrapped or not, as long as its observations are those of the environment.
        factory: of the policy, for example `interact.policy.policy_factory.LearnedPolicyFactory("procedural")`.
        seed: of what the policy draws.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], factory: PolicyFactory, seed: int = 0):
        self._env = _board(env)
        self._policy = factory.make_policy(self._env.rays)
        self._rng = generator(seed, "agent", 0, f"policy/{factory.name}")
        self._seen: recorded.Observation | None = None
        self._action: Action | None = None

    def act(self, observation: Observation) -> Core | None:
        """The action of the environment itself that the policy chooses; None if it has nothing more to do."""
        self._seen = self._seen or self._observed(observation)
        self._action = self._policy.select_action(self._seen, self._rng)
        if self._action is None:
            return None
        column, row = self._action.pixel
        return {"position": self._env.position_at(row, column), "direction": self._action.directions[0]}

    def observe(self, observation: Observation, reward: float, executed: tuple[int, ...]) -> None:
        """Tell what came of the last action, as `step` returned it."""
        assert self._action is not None, "act first"
        shown = self._observed(observation)
        if self._seen is None or shown.differs(self._seen):  # the same object as long as no pixel changes
            self._seen = shown
        self._policy.observe(self._action, executed, int(reward), self._seen)

    def _observed(self, observation: Observation) -> recorded.Observation:
        return recorded.Observation(observation["rgb"], observation["depth"], self._env.rays.camera)


def _asked_for(options: Mapping[str, Any]) -> tuple[BoardSpec | None, int | None]:
    """The board and the index of `reset`'s options, of which at most one is there."""
    hint = 'options={"board": spec} plays a BoardSpec, options={"index": i} board i of the seed'
    for name in options:
        if name not in OPTIONS:
            raise BusybotError(f"reset: there is no option {name!r}", hint)
    board, index = (options.get(name) for name in OPTIONS)
    if board is not None and index is not None:
        raise BusybotError("reset: the options board and index exclude each other", hint)
    if board is not None and not isinstance(board, BoardSpec):
        what = f"reset: option board: {type(board).__name__} is no BoardSpec"
        raise BusybotError(what, "BoardSpec.model_validate reads plain values")
    if index is not None and (isinstance(index, bool) or not isinstance(index, int | np.integer) or index < 0):
        raise BusybotError(f"reset: option index: {index!r} is no number of a board", "count from 0")
    return board, None if index is None else int(index)


def _config(kind: type[Config], name: str, given: Config | Mapping[str, Any] | None) -> Config:
    """A configuration as it is, or of plain values."""
    if isinstance(given, kind):
        return given
    try:
        return kind.model_validate({} if given is None else given)
    except ValidationError as error:
        raise BusybotError(f"{name}: {first_fault(error)}", f"see `{kind.__module__}.{kind.__name__}`") from None


def _board(env: gymnasium.Env[Any, Any]) -> BusyBoardEnv:
    core = env.unwrapped
    if not isinstance(core, BusyBoardEnv):
        raise BusybotError(f"{core} is not a BusyBoard", "wrap busybot/Board-v0")
    return core
