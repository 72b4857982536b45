"""What a DXF's blocks, bulges and formatted texts become, against ezdxf one by one."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from ezdxf.math import bulge_to_arc
from ezdxf.tools.text import fast_plain_mtext
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from tests.formats.cad_plans import new_drawing, saved
from worker.formats.dxf import load_dxf
from worker.formats.dxf_bulges import bulged_path
from worker.formats.dxf_entities import lines_of
from worker.geometry.drawing.linework.linework import Linework


def _load(path: Path) -> Linework:
    return load_dxf(path, bounds=Bounds())


def test_references_place_as_ezdxf_explodes_them(tmp_path: Path) -> None:
    doc = new_drawing(6)
    inner, outer = doc.blocks.new("INNER"), doc.blocks.new("OUTER")
    inner.add_line((0, 0), (3, 1))
    inner.add_arc((1, 1), 2, 20, 100)
    outer.add_line((5, 5), (6, 9))
    outer.add_blockref("INNER", (2, 1), dxfattribs={"rotation": 30, "xscale": 2, "yscale": 2, "zscale": 2})
    model = doc.modelspace()
    for k in range(24):
        how = {"rotation": 17 * k, "xscale": (-1) ** (k // 2) * (1 + k), "yscale": 1 + k, "zscale": 1 + k}
        model.add_blockref(("INNER", "OUTER")[k % 2], (10 * k, 7), dxfattribs=how)
    grid = {"row_count": 2, "column_count": 3, "row_spacing": 4, "column_spacing": 5, "rotation": 40}
    model.add_blockref("INNER", (0, 50), dxfattribs=grid)
    drawn = _load(saved(doc, tmp_path / "blocks.dxf"))
    for _ in range(2):
        for insert in list(model.query("INSERT")):
            for one in insert.multi_insert() if insert.mcount > 1 else [insert]:
                for part in one.virtual_entities():
                    model.add_entity(part)
            model.delete_entity(insert)
    assert not model.query("INSERT")
    flat = _load(saved(doc, tmp_path / "exploded.dxf"))
    assert drawn.arcs is not None
    assert flat.arcs is not None
    lines, expected = (d.ends[d.kind[d.entity] == "line"].reshape(-1, 4) for d in (drawn, flat))
    assert np.allclose(_sorted(lines), _sorted(expected))
    assert np.allclose(_sorted(drawn.arcs[:, :3]), _sorted(flat.arcs[:, :3]))
    assert np.allclose(np.abs(drawn.arcs[:, 4]), math.radians(80))
    assert len(drawn.kind) == len(flat.kind) == 12 * 2 + 12 * 3 + 6 * 2


def _sorted(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return rows[np.lexsort(np.round(rows, 6).T)]


def test_bulges_are_the_arcs_that_ezdxf_computes() -> None:
    rng = np.random.default_rng(5)
    vertices = np.column_stack([rng.uniform(-9, 9, (40, 2)), rng.uniform(-3, 3, 40)])
    vertices[::7, 2] = 0.0
    vertices[11] = vertices[12] + (0, 0, 1)
    path, arcs = bulged_path(vertices)
    expected = [
        (centre.x, centre.y, radius)
        for a, b in itertools.pairwise(vertices.tolist())
        if a[2] and a[:2] != b[:2]
        for centre, _, _, radius in [bulge_to_arc(a[:2], b[:2], a[2])]
    ]
    assert np.allclose(arcs[:, :3], expected)
    assert np.allclose(arcs[:, 4], [4 * math.atan(a[2]) for a in _bent(vertices)])
    at = [int(np.flatnonzero((path == vertex[:2]).all(axis=1))[0]) for vertex in vertices]
    assert at == sorted(at)
    assert (np.diff(path, axis=0) != 0).any(axis=1).all()
    owner = [k for k, (a, b) in enumerate(itertools.pairwise(at)) if b > a + 1]
    for arc, k in zip(arcs, owner, strict=True):
        away = np.hypot(*(path[at[k] : at[k + 1] + 1] - arc[:2]).T)
        assert np.allclose(away, arc[2])
        assert at[k + 1] - at[k] == max(4, math.ceil(abs(arc[4]) / math.tau * 64))
    with pytest.raises(ValueError, match="bulge"):
        bulged_path(np.array([[0, 0, math.nan], [1, 0, 0]]))


def _bent(vertices: NDArray[np.float64]) -> list[list[float]]:
    return [a for a, b in itertools.pairwise(vertices.tolist()) if a[2] and a[:2] != b[:2]]


@pytest.mark.parametrize(
    "said",
    [
        "ROOM 1\\P12 m2",
        "{\\fArial|b0;x}\\Py\\\\Pz\\P",
        "a\\\\\\Pb",
        "\\P\\Pq",
        "a^Jb\\Pc",
        "",
        "\\S1/2;\\Pxx",
    ],
)
def test_lines_of_a_formatted_text_are_those_of_ezdxf(said: str) -> None:
    assert lines_of(said) == fast_plain_mtext(said, split=True)


def test_a_long_formatted_text_is_read_in_time_that_grows_with_its_length() -> None:
    said = "\\P".join(["{\\fArial|b0;x}" * 300] * 100)
    assert lines_of(said) == ["x" * 300] * 100
    assert len(lines_of("a\\P" * 500)) == 501
