from __future__ import annotations

import pytest

from worker.geometry.drawing.linework.layer_names import role_of


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("A-WALL-EXTR", "wall"),
        ("InternalWalls", "wall"),
        ("Außenwände", "wall"),
        ("TRENNWAND", "wall"),
        ("Mauerwerk", "wall"),
        ("Murs porteurs", "wall"),
        ("CLOISONS", "wall"),
        ("MURATURA sezioni - section wall", "wall"),
        ("Pareti", "wall"),
        ("TABIQUERÍA", "wall"),
        ("Muros", "wall"),
        ("建筑-墙", "wall"),
        ("内壁", "wall"),
        ("間仕切", "wall"),
        ("XREF|A-WALL", "wall"),
        ("ground$0$WALL", "wall"),
        ("S-COLS", "column"),
        ("Stützen", "column"),
        ("PILASTRI struttura - structure", "column"),
        ("柱", "column"),
        ("MURATURE tratteggi - wall hatch", "hatch"),
        ("A-WALL-PATT", "hatch"),
        ("Murs - hachures", "hatch"),
        ("I-WALL-DEMO", "other"),
        ("Wandbelag", "other"),
        ("muro di cinta", "other"),
        ("壁芯", "grid"),
        ("DOTE", "grid"),
        ("幕墙", "window"),
        ("Curtain Wall", "window"),
        ("PORTE - doors", "door"),
        ("Puertas", "door"),
        ("建具", "door"),
        ("楼梯", "stair"),
        ("A-FLOR-STRS", "stair"),
        ("Wandschrank", "furniture"),
        ("PUB_DIM", "dimension"),
        ("QUOTE - dimension", "dimension"),
        ("walls_text", "text"),
        ("A-ANNO-TTLB", "text"),
    ],
)
def test_a_name_tells_what_its_layer_holds(name: str, role: str) -> None:
    told = role_of(name)
    assert told is not None
    assert told.role == role


@pytest.mark.parametrize("name", ["0", "Layer1", "L-12", "", "Wohnung", "SEZIONI medie - small section"])
def test_a_name_that_tells_nothing_is_not_guessed(name: str) -> None:
    assert role_of(name) is None
