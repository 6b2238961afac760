"""Many clients and hostile ones against the real program: it goes on, agrees with all of them, and stays small.

A short run here; `make soak` sends 10,000 messages and drags for 60 s (`KALSCOPE_DRAG`).
"""

from __future__ import annotations

import math
import os
import random
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.app.wire import CAMERA, PATIENCE, Guest, client, packed
from tests.support.effort import FUZZ
from tests.support.program import end, labels, port_of, running, token_of
from websockets.exceptions import ConnectionClosed

from kalscope_app.views.window import MAP_POINTED

DRAG_S = float(os.environ.get("KALSCOPE_DRAG", "1"))
MESSAGES = 120 if FUZZ == 1 else 400 * FUZZ
MIB, BUTTON = 2**20, "GuiButtonMessage"


class Program:
    """The real program on the demo, and its memory."""

    def __init__(self, process, url, log):
        self.process, self.log = process, log
        self.port, self.token = port_of(url), token_of(url)

    def rss(self):
        """Resident memory, bytes."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return 1024 * int(status.split("VmRSS:")[1].split()[0])

    def mistakes(self):
        """What the log says of Kalscope's own errors."""
        logs = self.log.parent.glob("kalscope.log*")
        return [line for log in logs for line in log.read_text().splitlines() if "ERROR kalscope" in line]


@pytest.fixture
def program(tmp_path):
    log = tmp_path / "kalscope.log"
    with running(tmp_path, "--log", str(log)) as (process, url):
        yield Program(process, url, log)


def settled(program):
    """A new client that has seen every widget."""
    guest = Guest(program.port, program.token)
    guest.read_until(lambda: any(made["type"] == "GuiSliderMessage" for made in guest.widgets.values()))
    while guest.read(timeout=0.5):
        pass
    return guest


def everything_on(guest):
    """All that a hostile client knows of the screen: widgets, forms, nodes of the scene and commands.

    Buttons that start a job are left out: a thousand fits are honest work, and take their time.
    """
    quick, made = {"Reset", "Show the first steps", "Copy", "Record", "Disconnect"}, guest.widgets
    widgets = [one for one in made if made[one]["type"] != BUTTON or made[one]["props"]["label"] in quick]
    nodes, commands = ["", "/node", *sorted(guest.nodes)], [*guest.commands, "unknown"]
    return SimpleNamespace(widgets=widgets, values=dict(guest.values), nodes=nodes, commands=commands)


# --- fuzz -------------------------------------------------------------------------------------------------


def junk(rng, depth=0):
    """Any value that msgpack can carry."""
    kinds = [
        lambda: None,
        lambda: rng.random() < 0.5,
        lambda: rng.choice([0, 1, -1, 2**31, -(2**63), 2**64 - 1]),
        lambda: rng.choice([0.5, math.nan, math.inf, -math.inf, 1e308, -1e-308]),
        lambda: "".join(chr(rng.randrange(1, 0x2FF)) for _ in range(rng.randrange(20))),
        lambda: rng.randbytes(rng.randrange(20)),
        lambda: "x" * rng.choice([1000, 100_000]),
    ]
    if depth < 3:
        kinds += [
            lambda: [junk(rng, depth + 1) for _ in range(rng.randrange(4))],
            lambda: {str(i): junk(rng, depth + 1) for i in range(rng.randrange(4))},
        ]
    return rng.choice(kinds)()


NUMBERS = [0.0, -1.0, 3.7, 1e-308, 1e308, -1e308, math.nan, math.inf, -math.inf, 2**63, -(2**63)]
"""What a position or a slider may be told."""


def odd_value(rng, now):
    """A value of the kind that a widget holds, at or beyond its limits; or junk."""
    if rng.random() < 0.4:
        return junk(rng)
    if isinstance(now, list):  # two thumbs, a vector
        return [rng.choice(NUMBERS) for _ in range(rng.choice([len(now), len(now) + 1, 0]))]
    if isinstance(now, str):  # a menu, a group of buttons, a text box
        return rng.choice([now, now + "x", "", "x" * 9_999, "x" * 10_001, "<b>", "a\0b", "../x", "nan", "1e999"])
    return rng.choice([*NUMBERS, True, False])


def hostile_frame(rng, known, honest):
    """A message as a browser sends it, with some of it exchanged for junk; now and then bytes flipped or cut."""
    kind, fields = rng.choice(honest)
    fields, widgets = dict(fields), known.widgets
    if "uuid" in fields and rng.random() < 0.9:
        fields["uuid"] = rng.choice(widgets)
    if "source_component_uuid" in fields:
        fields["source_component_uuid"] = rng.choice(widgets)
    if kind == "CommandTriggerMessage":
        fields["uuid"] = rng.choice(known.commands)
    if "name" in fields and rng.random() < 0.9:
        fields["name"] = rng.choice(known.nodes)
    for place in ("start_position", "end_position", "ray_origin", "ray_direction"):
        if fields.get(place) is not None and rng.random() < 0.2:
            fields[place] = [rng.choice(NUMBERS) for _ in range(3)]
    for name in fields:
        if rng.random() < min(0.3, 1.0 / len(fields)):  # of a long message some must stay whole
            fields[name] = junk(rng)
    if kind == "GuiUpdateMessage" and rng.random() < 0.7:
        name = rng.choice(["value", "value", "removed", "update_cb", "props", "min"])
        fields["updates"] = {name: odd_value(rng, known.values.get(str(fields["uuid"])))}
    frame = bytearray(packed(kind, **fields))
    if rng.random() < 0.15:
        frame[rng.randrange(len(frame))] = rng.randrange(256)
    if rng.random() < 0.05:
        del frame[rng.randrange(len(frame)) :]
    return bytes(frame)


NODE = {"name": "", "instance_index": None, "modifier": None, "owner": ""}
RAY = {"ray_origin": (0.0, 0.0, 60.0), "ray_direction": (0.01, 0.0, -1.0)}
DRAGGED = {"start_position": (0.0, 0.0, 0.0), "start_screen_pos": (0.5, 0.5), "button": "left"}
DRAGGED |= {"end_position": (0.3, 0.4, 0.0), "end_screen_pos": (0.6, 0.6)}
"""What a scene sends that has nodes to click and to drag; ours has none."""
UPLOAD = {"source_component_uuid": "", "transfer_uuid": "t"}
FILE = {"filename": "../../x", "mime_type": "", "part_count": 1, "size_bytes": 3}

HONEST = [
    ("GuiUpdateMessage", {"uuid": "", "updates": {"value": 0.5}}),
    ("GuiFormSubmitMessage", {"uuid": ""}),
    ("GuiFormDirtyMessage", {"uuid": ""}),
    ("GuiButtonHoldMessage", {"uuid": "", "frequency": 10.0}),
    ("CommandTriggerMessage", {"uuid": ""}),
    ("ViewerCameraMessage", CAMERA),
    ("ScenePointerMessage", {**RAY, "event_type": "click", "screen_pos": ((0.5, 0.5),), "modifier": None}),
    ("SceneNodeClickMessage", {**NODE, **RAY, "screen_pos": (0.5, 0.5)}),
    *(("SceneNodeDragMessage", {**NODE, **DRAGGED, "phase": phase}) for phase in ("start", "update", "end")),
    ("RunJavascriptMessage", {"source": "alert(1)"}),
    *((kind, {}) for kind in ("ShareUrlRequest", "ShareUrlDisconnect", "ResetGuiMessage")),
    ("FileTransferStartUpload", {**UPLOAD, **FILE}),
    ("FileTransferPart", {**UPLOAD, "part_index": 0, "content": b"1\n2"}),
]


def send_hostile(program, rng, known):
    """Send all messages, each handled before the next, on a new connection after each end; how many were ended."""
    sent = ended = 0
    while sent < MESSAGES:
        with suppress(ConnectionClosed), client(program.port, token=program.token) as hostile:
            hostile.send(packed("ViewerCameraMessage", **CAMERA))
            ended += 1
            while sent < MESSAGES:
                sent += 1
                hostile.send(hostile_frame(rng, known, HONEST))
                hostile.ping(ack_on_close=True).wait(PATIENCE)
            ended -= 1
    return ended


def test_whatever_a_client_sends_the_next_one_is_served_as_before(program):
    with settled(program) as before:
        before.read_until(lambda: MAP_POINTED in labels(before))
        kinds = types_of(before)
    target = everything_on(before)
    assert len(target.commands) > 3
    rss_before, rng = program.rss(), random.Random(9)
    ended = send_hostile(program, rng, target)
    grown = program.rss() - rss_before
    with settled(program) as after:
        assert ended > 0
        after.read_until(lambda: types_of(after) == kinds)
        assert [uuid for uuid in after.values if not within_range(after, uuid)] == []
        uuid = after.find("log₁₀ q")
        after.set(uuid, 0.5 * (after.widgets[uuid]["props"]["min"] + after.widgets[uuid]["props"]["max"]))
        with settled(program) as other:
            other.read_until(lambda: other.values[uuid] == pytest.approx(after.values[uuid]))
    print(f"{MESSAGES} messages, {ended} connections ended, memory grew by {grown / MIB:.1f} MiB")
    assert grown < 200 * MIB  # most of it in the first 2,000: modules and tables that the first use loads
    assert program.mistakes() == []
    status, _, errors = end(program.process)
    assert (status, "Traceback" in errors) == (0, False)


def types_of(guest):
    return {made["type"] for made in guest.widgets.values()}


def within_range(guest, uuid):
    """Whether a widget shows a value of its kind and range."""
    made, value = guest.widgets[uuid], guest.values[uuid]
    props = made.get("props", {})
    if made["type"] in ("GuiDropdownMessage", "GuiButtonGroupMessage"):
        return value in props["options"]
    if made["type"] in (types := {"GuiCheckboxMessage": bool, "GuiTextMessage": str}):
        return isinstance(value, types[made["type"]])
    numbers, (low, high) = value if isinstance(value, list) else [value], (props.get("min"), props.get("max"))
    return None in (low, high) or all(low <= number <= high for number in numbers)


# --- many at once -----------------------------------------------------------------------------------------


def test_ten_clients_that_drag_at_once_end_with_the_same_values(program):
    guests = [settled(program) for _ in range(10)]
    try:
        uuids = [guests[0].find(f"log₁₀ {name}") for name in ("q", "r")]
        guests[0].set(uuids[0], 0.25)
        guests[0].values[uuids[0]] = "moved by another"
        guests[0].read_until(lambda: guests[0].values[uuids[0]] == 0.25)  # viser tells all but the sender
        until = time.monotonic() + DRAG_S
        hands = [threading.Thread(target=drag, args=(guest, uuids, i, until)) for i, guest in enumerate(guests)]
        for hand in hands:
            hand.start()
        for hand in hands:
            hand.join()
        while sum(guest.read(timeout=1.0 / len(guests)) for guest in guests):  # the repetition comes after 0.3 s
            assert time.monotonic() < until + PATIENCE
        with settled(program) as late:
            for uuid in uuids:
                wait_until_equal([*guests, late], uuid)
                assert within_range(late, uuid)
    finally:
        for guest in guests:
            guest.connection.close()
    assert program.mistakes() == []
    assert end(program.process)[0] == 0


def drag(guest, uuids, seed, until):
    """Move two sliders as a hand does, 20 times a second, and read what comes meanwhile."""
    rng = random.Random(seed)
    limits = {uuid: (guest.widgets[uuid]["props"]["min"], guest.widgets[uuid]["props"]["max"]) for uuid in uuids}
    while time.monotonic() < until:
        uuid = rng.choice(uuids)
        guest.set(uuid, round(rng.uniform(*limits[uuid]), 2))
        next_move = time.monotonic() + 0.05
        while (left := next_move - time.monotonic()) > 0:
            guest.read(timeout=left)


def wait_until_equal(guests, uuid):
    """Take in what comes until a widget has one value on all screens; a busy program may still be at it."""
    deadline = time.monotonic() + PATIENCE
    while len(values := {guest.values[uuid] for guest in guests}) > 1:
        assert time.monotonic() < deadline, f"the screens keep {values}"
        for guest in guests:
            guest.read(timeout=0.1)
