"""What runs on the microcontroller of a board with three switches and three LEDs, in MicroPython.

Each LED shows its switch's state; which one that is, is one of the six wirings of the twin in `boards/real_board.py`.
Whenever something changes a line for `states.jsonl` is printed for the switches and one for the LEDs.
"""

import time

from machine import Pin

WIRING = 0
"""Which one: 0 to 5."""
WIRINGS = ((0, 1, 2), (1, 0, 2), (1, 2, 0), (2, 1, 0), (0, 0, 1), (2, 1, 2))
"""Of each LED the switch."""
SWITCHES, LEDS = (2, 3, 4), (16, 17, 18)
"""Numbers of the pins as the Pico's map has them, `GP2` and so on."""
BOUNCE_MS = 20
"""So long a switch's contact may rattle."""


def run(rounds=None):
    """Show and log states, without end or so many times."""
    switches = [Pin(number, Pin.IN, Pin.PULL_UP) for number in SWITCHES]
    leds = [Pin(number, Pin.OUT) for number in LEDS]
    told = None
    while rounds is None or rounds > 0:
        states = [1 - switch.value() for switch in switches]  # a closed switch pulls its pin down
        if states != told:
            shown = [states[switch] for switch in WIRINGS[WIRING]]
            for number, led in enumerate(leds):
                led.value(shown[number])
            ms = time.time_ns() // 1_000_000  # its floats have 24 bits, too few for a time
            for device, values in (("switches", states), ("leds", shown)):
                print(f'{{"ts": {ms // 1000}.{ms % 1000:03d}, "device": "{device}", "values": {values}}}')
            told = states
        time.sleep(BOUNCE_MS / 1000)
        rounds = None if rounds is None else rounds - 1


if __name__ == "__main__":
    run()
