"""A policy with its base controller as an ONNX graph: a whole controller, one step per run.

Inputs:   `reference`, shape (preview + 1,), wanted joint torque now and at the next steps; and each
          of shape (1,) `tau`, `q_m`, `q_g`, `q_l`, `dq_m`, `dq_g`, `dq_l`, as measured. The state
          `base`, `history`, `command`, as the step before gave it; `begin`, shape (1,): 1 in the
          first step of an episode, in which that state does not count, else 0.
Outputs:  `torque`, shape (1,), to command [N m], and the state `next_base`, `next_history`. The
          next `command` is `torque`, or what the drive applied instead of it.

Everything is in double precision but the network. Names, units and meaning are in the metadata.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from cjt_gym.baselines.linear_law import COMMAND, INPUTS, REFERENCE, SIGNALS, TAU
from cjt_gym.disk import parse_json, parsing, write_bytes
from cjt_gym.envs.observation import CLIP, PAST, PRESENT, Layout, Observed
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.deploy.base import BaseLaw
from cjt_gym.training.deploy.exported import Exported, facts_of

OPSET: Final = 17
IR_VERSION: Final = 10
STATE: Final = ("base", "history")
OPERATORS: Final = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}


class Graph:
    """Collects the nodes and the constants of a graph."""

    def __init__(self) -> None:
        from onnx import helper, numpy_helper

        self._helper, self._numpy = helper, numpy_helper
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, values: Any, kind: Any = np.float64) -> str:
        """Add a constant; return its name."""
        name = f"c{len(self.constants)}"
        self.constants.append(self._numpy.from_array(np.asarray(values, kind), name))
        return name

    def add(self, operator: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        """Add a node; return the name of its output."""
        output = name or f"v{len(self.nodes)}"
        self.nodes.append(self._helper.make_node(operator, list(inputs), [output], **attributes))
        return output

    def part(self, source: str, begin: int, end: int) -> str:
        """Add a slice of a vector."""
        ends = [self.constant([at], np.int64) for at in (begin, end)]
        return self.add("Slice", source, *ends)

    def limited(self, source: str, most: float, name: str = "", kind: Any = np.float64) -> str:
        """Add a limit to plus and minus a number."""
        most = min(most, float(np.finfo(kind).max))
        ends = (self.constant(-most, kind), self.constant(most, kind))
        return self.add("Clip", source, *ends, name=name)


def write_onnx(policy: Exported, path: str | Path) -> Path:
    """Write the graph and return its path."""
    try:
        from onnx import checker, helper
    except ImportError as error:
        raise ConfigurationError(
            "An export to ONNX needs the package onnx. Install it:  pip install 'cjt-gym[onnx]'"
        ) from error
    policy.check_whole("ONNX")
    graph = Graph()
    graph.add("Greater", "begin", graph.constant([0.5]), name="is_first")
    torque = graph.add("Mul", _action(graph, policy), graph.constant([policy.layout.action]))
    if policy.base is not None:
        torque = graph.add("Add", torque, _base(graph, policy.base))
    graph.limited(torque, policy.limit, name="torque")
    inputs, outputs = _declared(policy)
    made = helper.make_graph(graph.nodes, "controller", inputs, outputs, graph.constants)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", OPSET)])
    model.ir_version, model.producer_name = IR_VERSION, "cjt-gym"
    helper.set_model_props(model, {"cjt_gym": json.dumps(facts_of(policy))})
    checker.check_model(model)
    return write_bytes(path, model.SerializeToString())


def shapes_of(layout: Layout, order: int | None) -> tuple[dict[str, int], dict[str, int]]:
    """Return how many numbers each input and each output holds."""
    width = PAST * layout.history
    inputs = dict.fromkeys(INPUTS, 1) | {"reference": layout.preview + 1}
    inputs |= {"history": width, "command": 1, "begin": 1}
    outputs = {"torque": 1, "next_history": width}
    if order:
        inputs, outputs = inputs | {"base": order}, outputs | {"next_base": order}
    return inputs, outputs


def _declared(policy: Exported) -> tuple[list[Any], list[Any]]:
    """Return inputs and outputs with their meaning."""
    from onnx import TensorProto, helper

    texts = {name: f"{what} [{unit}]" for name, (unit, what) in INPUTS.items()}
    texts |= {
        "history": "next_history of the step before",
        "base": "next_base of the step before",
        "command": "motor torque that was commanded in the step before [N m]",
        "begin": "1 in the first step of an episode, else 0",
        "torque": "motor torque to command [N m]",
    }
    order = None if policy.base is None else len(policy.base.law.linear.c)
    inputs, outputs = (
        [
            helper.make_tensor_value_info(name, TensorProto.DOUBLE, [size], texts.get(name, ""))
            for name, size in sizes.items()
        ]
        for sizes in shapes_of(policy.layout, order)
    )
    return inputs, outputs


def _action(graph: Graph, policy: Exported) -> str:
    """Add the network, in single precision; return its action in double."""
    from onnx import TensorProto

    network = policy.on_its_joint
    observation = graph.add("Cast", _observation(graph, policy.layout), to=TensorProto.FLOAT)
    x = graph.add("Sub", observation, graph.constant(network.mean, np.float32))
    x = graph.add("Mul", x, graph.constant(network.scale, np.float32))
    x = graph.limited(x, network.clip, kind=np.float32)
    for layer in network.layers:
        product = graph.add("MatMul", graph.constant(layer.weight, np.float32), x)
        x = graph.add("Add", product, graph.constant(layer.bias, np.float32))
        if layer.activation != "none":
            x = graph.add(OPERATORS[layer.activation], x)
    limited = graph.limited(x, 1.0, kind=np.float32)
    return graph.add("Cast", limited, to=TensorProto.DOUBLE)


def _observation(graph: Graph, layout: Layout) -> str:
    """Add what makes an observation of the inputs; name the new history."""
    width = PAST * layout.history
    angle = graph.add("Mul", "q_m", graph.constant([layout.n]))
    ahead = graph.add("Add", angle, graph.constant([0.5 * math.pi]))
    made = {
        "error": graph.add("Sub", graph.part("reference", 0, 1), "tau"),
        "sine": graph.add("Sin", angle),
        "cosine": graph.add("Sin", ahead),  # few runtimes have Cos in double
        "command": graph.add("Where", "is_first", graph.constant([0.0]), "command"),
    }
    observed = graph.add("Concat", *(made.get(name, name) for name in Observed._fields), axis=0)
    observed = graph.limited(graph.add("Div", observed, graph.constant(layout.divisors)), CLIP)
    now = graph.part(observed, 0, PRESENT)
    sample = graph.part(observed, PRESENT, PRESENT + PAST)
    shifted = graph.add("Concat", sample, graph.part("history", 0, width - PAST), axis=0)
    first = graph.add("Tile", sample, graph.constant([layout.history], np.int64))
    graph.add("Where", "is_first", first, shifted, name="next_history")
    scaled = graph.limited(graph.add("Div", "reference", graph.constant([layout.torque])), CLIP)
    return graph.add("Concat", scaled, now, "next_history", axis=0)


def _base(graph: Graph, base: BaseLaw) -> str:
    """Add the base controller and its next state; return its command."""
    law, order = base.law.linear, len(base.law.linear.c)
    zero = graph.constant([0.0])
    now = graph.part("reference", 0, 1)
    signals = [now, *SIGNALS[TAU:COMMAND], zero]
    w = graph.add("Concat", *signals, axis=0)
    direct = graph.add("MatMul", graph.constant(law.d[None, :]), w)
    if not order:
        return graph.limited(direct, base.law.limit)
    signals[COMMAND] = "tau"
    signals[REFERENCE] = now if base.law.follows else "tau"
    still = graph.add("Concat", *signals, axis=0)
    rest = graph.add("MatMul", graph.constant(law.at_rest()), still)
    x = graph.add("Where", "is_first", rest, "base")
    wanted = graph.add("Add", graph.add("MatMul", graph.constant(law.c[None, :]), x), direct)
    command = graph.limited(wanted, base.law.limit)
    applied = graph.add("Mul", command, graph.constant(law.b[:, COMMAND]))
    driven = graph.add("Add", graph.add("MatMul", graph.constant(law.b), w), applied)
    graph.add("Add", graph.add("MatMul", graph.constant(law.a), x), driven, name="next_base")
    return command


class OnnxStepper:
    """An exported graph at work, by onnxruntime on one thread; as `Stepper`."""

    def __init__(self, path: str | Path) -> None:
        try:
            import onnxruntime
        except ImportError as error:
            raise ConfigurationError(
                "Running an ONNX file needs onnxruntime. Install it:  pip install 'cjt-gym[onnx]'"
            ) from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        with parsing(f"{path} must be a policy that cjt-gym exported", ConfigurationError):
            providers = ["CPUExecutionProvider"]
            self._session = onnxruntime.InferenceSession(str(path), options, providers=providers)
            text = self._session.get_modelmeta().custom_metadata_map["cjt_gym"]
            facts = parse_json(text, "its metadata", ConfigurationError)
            self.facts, self.layout = facts, Layout(**facts["layout"])
            self._check_shapes()
        self.reset()

    def _check_shapes(self) -> None:
        """Raise ValueError unless the graph takes and gives what its layout makes."""
        given = {put.name: put.shape for put in self._session.get_inputs()}
        made = {put.name: put.shape for put in self._session.get_outputs()}
        order = given.get("base", [None])[0]
        wanted = [{n: [size] for n, size in s.items()} for s in shapes_of(self.layout, order)]
        if [given, made] != wanted:
            raise ValueError(f"it takes {given} and gives {made}, which its layout does not make")
        state = {name: np.zeros(given[name]) for name in STATE if name in given}
        self._state, self._outputs = state, [f"next_{name}" for name in state]

    def reset(self) -> None:
        """Forget the past."""
        self._begin, self.command = np.ones(1), 0.0

    def step(self, reference: Any, *measured: float) -> float:
        """Return the motor torque to command [N m]; see `Stepper.step`."""
        signals = {"reference": np.array(reference, float).reshape(-1)}
        names = list(INPUTS)[1:]
        signals |= {n: np.array([x], float) for n, x in zip(names, measured, strict=True)}
        signals |= {"command": np.array([self.command]), "begin": self._begin}
        torque, *state = self._session.run(["torque", *self._outputs], signals | self._state)
        self._state = dict(zip(self._state, state, strict=True))
        self._begin, self.command = np.zeros(1), float(torque[0])
        return self.command
