"""Presses every link in turn and claims what changed right after it moved."""

import json
import sys


def ask(answer):
    print(json.dumps(answer), flush=True)
    return json.loads(sys.stdin.readline())


board = json.loads(sys.stdin.readline())
links = [link for one in board["objects"] for link in one.get("links", [])]
claims, direction, left = set(), dict.fromkeys(links, "forward"), board["actions_left"]
while left and links:
    for link in links[:left]:
        seen = ask({"link": link, "direction": direction[link]})
        if seen["moved"]:
            claims |= {(link, one["object"]) for one in seen["changed"]}
        else:  # it rests at its end, or it is held
            direction[link] = "back" if direction[link] == "forward" else "forward"
        left = seen["actions_left"]
print(json.dumps({"know": [{"link": link, "controls": responder} for link, responder in sorted(claims)]}), flush=True)
