"""Text recognition: crops of single lines of text to what they say. Comes with the extra `ocr`."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Recognise = Callable[[Sequence[NDArray[np.uint8]]], list[tuple[str, float]]]
"""Upright grey crops of one line each to text and confidence (0 to 1)."""

_HEIGHT, _LEAST_WIDTH, _MOST_WIDTH, _WIDTH_STEP = 48, 96, 1920, 48
_BATCH = 8


def load_recogniser(*, threads: int = 1) -> Recognise | None:
    """Return a recogniser of lines of text, or None where the extra `ocr` is not installed.

    The model is the one inside the wheel of rapidocr (PP-OCR, Latin, Chinese and Japanese letters); nothing
    is downloaded. One thread, a fixed order and fixed widths: the same crops give the same text.

    Parameters
    ----------
    threads : int, default 1
        Threads of the network.
    """
    model = _model()
    if model is None:
        return None
    import onnxruntime  # noqa: PLC0415, the extra may be absent, and loading takes a moment

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.enable_cpu_mem_arena = False
    session = onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
    letters = ["", *session.get_modelmeta().custom_metadata_map["character"].splitlines(), " "]
    name = session.get_inputs()[0].name

    def recognise(crops: Sequence[NDArray[np.uint8]]) -> list[tuple[str, float]]:
        out: list[tuple[str, float]] = [("", 0.0)] * len(crops)
        prepared = [_prepared(crop) for crop in crops]
        order = sorted(range(len(crops)), key=lambda i: (prepared[i].shape[1], i))
        for start in range(0, len(order), _BATCH):
            chosen = order[start : start + _BATCH]
            batch = np.zeros((len(chosen), 3, _HEIGHT, prepared[chosen[-1]].shape[1]), dtype=np.float32)
            for row, i in enumerate(chosen):
                batch[row, :, :, : prepared[i].shape[1]] = prepared[i]
            for i, scores in zip(chosen, session.run(None, {name: batch})[0], strict=True):
                out[i] = _decoded(scores, letters)
        return out

    return recognise


def _model() -> Path | None:
    """Return the recogniser's model inside the installed wheel, without importing the package."""
    if importlib.util.find_spec("onnxruntime") is None:
        return None
    spec = importlib.util.find_spec("rapidocr")
    places = [] if spec is None else list(spec.submodule_search_locations or [])
    models = sorted(m for place in places for m in (Path(place) / "models").glob("*_rec_*.onnx"))
    return models[-1] if models else None


def _prepared(crop: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return a crop 48 pixels high, padded to a multiple of 48 pixels, from -1 to 1."""
    wide = min(_MOST_WIDTH, max(8, round(crop.shape[1] * _HEIGHT / crop.shape[0])))
    resized = cv2.resize(crop, (wide, _HEIGHT), interpolation=cv2.INTER_LINEAR).astype(np.float32)
    padded = np.zeros((_HEIGHT, max(_LEAST_WIDTH, -(-wide // _WIDTH_STEP) * _WIDTH_STEP)), dtype=np.float32)
    padded[:, :wide] = resized / 127.5 - 1.0
    return padded


def _decoded(scores: NDArray[np.float32], letters: list[str]) -> tuple[str, float]:
    """Return text and mean confidence of (T, L) scores: repeats and blanks are dropped (CTC)."""
    best = scores.argmax(axis=1)
    kept = (best != 0) & (best != np.concatenate([[-1], best[:-1]]))
    if not kept.any():
        return "", 0.0
    text = "".join(letters[i] if i < len(letters) else "" for i in best[kept])
    return text.strip(), float(scores.max(axis=1)[kept].mean())
