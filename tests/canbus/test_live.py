"""A run as a viewer sees it while it goes on."""

from __future__ import annotations

import contextlib
import json
import threading
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("foxglove")

from dataclasses import replace

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from cjt_gym.canbus.live import LiveView
from cjt_gym.cli import main
from cjt_gym.disk import to_toml
from cjt_gym.errors import ConfigurationError
from tests.canbus.bench import config, document


class Viewer(threading.Thread):
    """Connects, subscribes to every topic, and keeps what comes."""

    def __init__(self, address: str) -> None:
        super().__init__(daemon=True)
        self.address = address
        self.topics: dict[int, str] = {}
        self.seen: dict[str, list[bytes]] = {}
        self.is_ready = threading.Event()
        self.start()

    def run(self) -> None:
        with (
            contextlib.suppress(ConnectionClosed),
            connect(self.address, subprotocols=["foxglove.sdk.v1"]) as socket,
        ):
            for message in socket:
                self.take(socket, message)

    def take(self, socket: Any, message: Any) -> None:
        if isinstance(message, bytes):  # opcode, subscription, time, data
            topic = self.topics[int.from_bytes(message[1:5], "little")]
            self.seen.setdefault(topic, []).append(message[13:])
            return
        told = json.loads(message)
        if told["op"] == "advertise":
            new = {c["id"]: c["topic"] for c in told["channels"] if c["id"] not in self.topics}
            self.topics |= new
            asked = [{"id": number, "channelId": number} for number in new]
            socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
            if any(topic.startswith("/cjt_gym/record") for topic in new.values()):
                self.is_ready.set()


def test_channels_limits_and_the_fault_reach_a_viewer() -> None:
    view = LiveView([config(limits={"tau": {"value": 40.0, "unit": "N m"}})], 0)
    viewer = Viewer(view.address)
    view.begin(["t", "q_m", "tau"], {"joint": "orange"})
    assert viewer.is_ready.wait(5.0)
    k = 0
    while "/cjt_gym/record" not in viewer.seen and k < 500:  # until the subscription is there
        view.see([0.01 * k, 1.5, float("nan")])
        viewer.join(0.01)
        k += 1
    view.see([0.01 * k + 1.0, 2.5, 3.0])
    view.end({"fault": {"kind": "missing", "text": "Nothing is heard of it."}})
    view.close()
    viewer.join(5.0)
    rows = [json.loads(message) for message in viewer.seen["/cjt_gym/record"]]
    assert rows[0]["q_m"] == 1.5
    assert "tau" not in rows[0]
    assert (rows[-1]["q_m"], rows[-1]["tau"]) == (2.5, 3.0)
    limits = json.loads(viewer.seen["/cjt_gym/limits"][-1])
    assert limits["tau_cmd"] == {"low": -40.0, "high": 40.0}
    assert b"missing: Nothing is heard of it." in viewer.seen["/cjt_gym/faults"][-1]


def test_the_command_shows_its_run_and_refuses_what_it_cannot_serve(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, out = tmp_path / "joint.toml", tmp_path / "run.csv"
    path.write_text(to_toml(document()))
    seen = []
    monkeypatch.setattr(LiveView, "see", lambda view, row: seen.append(row))
    words = ["hardware", str(path), "--emulated", "--duration", "0.1", "--controller", "open_loop"]
    assert main([*words, "--live", "0", "--out", str(out)]) == 0
    assert "Live at ws://127.0.0.1:" in capsys.readouterr().err
    assert len(seen) == len(out.read_text().splitlines()) - 1
    for wrong, text in ((["--live"], "--arm or --emulated"), (["--live", "-1"], "<= 65535")):
        more = [] if len(wrong) == 1 else ["--emulated", "--out", str(tmp_path / "x.csv")]
        assert main(["hardware", str(path), *wrong, *more]) == 2
        error = capsys.readouterr().err
        assert text in error
        assert error.count("\n") == 1


def test_a_port_that_is_taken_is_told() -> None:
    with LiveView([config()], 0) as view:
        port = int(view.address.rpartition(":")[2])
        with pytest.raises(ConfigurationError, match=f"port {port}.*--live PORT"):
            LiveView([config()], port)


def test_joints_of_a_list_have_a_topic_each() -> None:
    with LiveView([replace(config(), name=name) for name in ("hip", "knee")], 0) as view:
        viewer = Viewer(view.address)
        view.begin(["t", "hip/q_m", "knee/q_m"], {})
        assert viewer.is_ready.wait(5.0)
    viewer.join(5.0)
    assert {f"/cjt_gym/{of}/{name}" for of in ("record", "limits") for name in ("hip", "knee")} < {
        *viewer.topics.values()
    }
