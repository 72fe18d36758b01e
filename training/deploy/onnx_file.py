"""A policy as an ONNX graph, with its observation and its history inside.

Inputs:   `signals`, shape (preview + 7,): the reference now and at the next steps [N m], sine and
          cosine of the rotor's angle n q_m, measured joint torque [N m], measured velocities of
          motor and load [rad/s], and the motor torque commanded in the step before [N m];
          `history`, shape (4 history,), as the step before gave it; and `begin`, shape (1,): 1 in
          the first step of an episode, in which the history does not count, else 0.
Outputs:  `torque`, shape (1,), to be added to that of the base controller [N m]; `next_history`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk import parse_json, parsing, write_bytes
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.deploy.exported import Exported, facts_of
from cjt_gym.training.deploy.layout import LIMIT, PER_SAMPLE, Layout

OPSET: Final = 17
IR_VERSION: Final = 10
OPERATORS: Final = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}


class Graph:
    """Collects the nodes and the constants of a graph."""

    def __init__(self) -> None:
        """Begin an empty graph."""
        from onnx import helper, numpy_helper

        self._helper, self._numpy = helper, numpy_helper
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, values: Any, kind: Any = np.float32) -> str:
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

    def limited(self, source: str, most: float, name: str = "") -> str:
        """Add a limit to plus and minus a number."""
        ends = (self.constant(-most), self.constant(most))
        return self.add("Clip", source, *ends, name=name)


def write_onnx(policy: Exported, path: str | Path) -> Path:
    """Write the graph and return its path.

    Raises:
        ConfigurationError: The package onnx is not installed.
    """
    try:
        from onnx import TensorProto, checker, helper
    except ImportError as error:
        raise ConfigurationError(
            "An export to ONNX needs the package onnx. Install it:  pip install 'cjt-gym[onnx]'"
        ) from error
    layout, network, graph = policy.layout, policy.on_its_joint, Graph()
    observation = _observation(graph, layout)
    clip = min(network.clip, float(np.finfo(np.float32).max))
    x = graph.add("Sub", observation, graph.constant(network.mean))
    x = graph.limited(graph.add("Mul", x, graph.constant(network.scale)), clip)
    for layer in network.layers:
        product = graph.add("MatMul", graph.constant(layer.weight), x)
        x = graph.add("Add", product, graph.constant(layer.bias))
        if layer.activation != "none":
            x = graph.add(OPERATORS[layer.activation], x)
    graph.add("Mul", graph.limited(x, 1.0), graph.constant([layout.action]), name="torque")

    def vector(name: str, size: int) -> Any:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, [size])

    width = PER_SAMPLE * layout.history
    inputs = [vector("signals", layout.preview + 7), vector("history", width), vector("begin", 1)]
    outputs = [vector("torque", 1), vector("next_history", width)]
    made = helper.make_graph(graph.nodes, "policy", inputs, outputs, graph.constants)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", OPSET)])
    model.ir_version, model.producer_name = IR_VERSION, "cjt-gym"
    helper.set_model_props(model, {"cjt_gym": json.dumps(facts_of(policy))})
    checker.check_model(model)
    return write_bytes(path, model.SerializeToString())


def _observation(graph: Graph, layout: Layout) -> str:
    """Add what makes an observation of the inputs; name the new history."""
    count, width = layout.preview + 1, PER_SAMPLE * layout.history
    reference = graph.part("signals", 0, count)
    rotor = graph.part("signals", count, count + 2)
    now = graph.part("signals", 0, 1)
    tau = graph.part("signals", count + 2, count + 3)
    torque = graph.constant([layout.torque])
    sample = graph.add(
        "Div",
        graph.part("signals", count + 2, count + 6),
        graph.constant([layout.torque, layout.velocity, layout.velocity, layout.torque]),
    )
    sample = graph.limited(sample, LIMIT)
    shifted = graph.add("Concat", sample, graph.part("history", 0, width - PER_SAMPLE), axis=0)
    first = graph.add("Tile", sample, graph.constant([layout.history], np.int64))
    is_first = graph.add("Greater", "begin", graph.constant([0.5]))
    graph.add("Where", is_first, first, shifted, name="next_history")
    scaled = graph.limited(graph.add("Div", reference, torque), LIMIT)
    error = graph.limited(graph.add("Div", graph.add("Sub", now, tau), torque), LIMIT)
    return graph.add("Concat", scaled, error, rotor, "next_history", axis=0)


class OnnxStepper:
    """An exported graph at work, by onnxruntime on one thread; as `Stepper`."""

    def __init__(self, path: str | Path) -> None:
        """Open a graph.

        Raises:
            ConfigurationError: onnxruntime is not installed, or the file is not of ours.
        """
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
        self._history = np.zeros(PER_SAMPLE * self.layout.history, np.float32)
        self.reset()

    def _check_shapes(self) -> None:
        """Raise ValueError unless the graph takes and gives what its layout makes."""
        width = PER_SAMPLE * self.layout.history
        wanted = {"signals": [self.layout.preview + 7], "history": [width], "begin": [1]}
        given = {put.name: put.shape for put in self._session.get_inputs()}
        made = [put.shape for put in self._session.get_outputs()]
        if given != wanted or made != [[1], [width]]:
            raise ValueError(f"it takes {given} and gives {made}, which its layout does not make")

    def reset(self) -> None:
        """Forget the past."""
        self._begin = np.ones(1, np.float32)

    def step(
        self, reference: Any, tau: float, q_m: float, dq_m: float, dq_l: float, command: float
    ) -> float:
        """Return the motor torque [N m]; see `Stepper.step`."""
        rotor = self.layout.n * q_m
        rest = [np.sin(rotor), np.cos(rotor), tau, dq_m, dq_l, command]
        signals: NDArray[np.float32] = np.array([*np.atleast_1d(reference), *rest], np.float32)
        given = {"signals": signals, "history": self._history, "begin": self._begin}
        torque, self._history = self._session.run(None, given)
        self._begin = np.zeros(1, np.float32)
        return float(torque[0])
