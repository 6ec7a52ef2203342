"""Rerun, the goal of the board's task: its image, and which responders do not look like it yet."""

import rerun as rr

from busybot.episodes.episode import Episode
from busybot.view.palette import WRONG
from busybot.view.rerun_camera import marks, stored_picture
from busybot.view.scene import remaining_responders

SPACE = "goal"


def log_goal(recording: rr.RecordingStream, episode: Episode) -> None:
    """The goal image, for the whole episode."""
    recording.log(f"{SPACE}/image", stored_picture(episode.goals, 0), static=True)


def log_remaining(recording: rr.RecordingStream, episode: Episode, frame: int) -> None:
    """A box around every responder that looks different in the frame."""
    if episode.goal is not None and (frame == 0 or episode.frame_of[frame] != episode.frame_of[frame - 1]):
        boxes = episode.goal.boxes[remaining_responders(episode, frame)]
        recording.log(f"{SPACE}/remaining", marks(episode, boxes, WRONG))
