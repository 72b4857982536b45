"""Operations on what a map is made of: each by itself, and two people's put together."""

from __future__ import annotations

import math

import pytest

from service.domain.errors import InvalidRequest, LayerNotFound, RegionNotFound
from service.domain.map_state import (
    BaseReading,
    ErasedRegion,
    LayerState,
    MapState,
    differences,
    moved_by,
    pose_of,
    subjects,
)
from service.domain.operations import (
    AddLayer,
    CutLayer,
    EraseRegion,
    MoveLayer,
    Operation,
    RemoveLayer,
    RenameLayer,
    ReplaceLayer,
    RestoreRegion,
    SetDrawing,
    SetLayers,
    SetRecipe,
    ShiftLayer,
    ShowLayer,
    apply_all,
    effective,
)
from service.domain.recipe import Recipe
from service.domain.region import Region
from service.domain.together import overlap
from service.domain.transform import Transform

HERE = pose_of(Transform.from_xyz_yaw(1.0, 2.0, 0.0, 0.5).tolist())
SQUARE = Region(((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)))
READING = BaseReading("drw_1", "a" * 64, {"state": "given"})


def a_layer(number: int) -> LayerState:
    return LayerState(
        f"lyr_{number}", f"layer {number}", f"scn_{number}", f"plc_{number}", {"points": "all"}, HERE
    )


def a_state(layers: int = 3) -> MapState:
    return MapState(READING, Recipe(), tuple(a_layer(k) for k in range(layers)))


def told(operation: Operation, state: MapState | None = None) -> list[tuple[str, str]]:
    before = state or a_state()
    return [(one.subject, one.change) for one in differences(before, operation.apply(before))]


def test_each_operation_changes_what_it_names_and_nothing_else() -> None:
    assert told(AddLayer(a_layer(9))) == [("layer.lyr_9", "added"), ("scan.scn_9", "added")]
    assert told(RemoveLayer("lyr_1")) == [("layer.lyr_1", "removed"), ("scan.scn_1", "removed")]
    assert told(ShowLayer("lyr_1", visible=False)) == [("layer.lyr_1", "hidden")]
    assert told(RenameLayer("lyr_1", "press")) == [("layer.lyr_1", "renamed")]
    assert told(CutLayer("lyr_1", {"points": "target"})) == [("layer.lyr_1", "cut")]
    assert told(ShiftLayer("lyr_1", x_m=0.5)) == [("layer.lyr_1", "moved")]
    assert told(SetRecipe({"voxel_size_m": 0.1})) == [("recipe.voxel_size_m", "set")]
    assert told(SetDrawing(BaseReading("drw_2", "b" * 64, {}))) == [("drawing", "set")]
    assert told(EraseRegion("ers_1", SQUARE)) == [("region.ers_1", "erased")]
    replaced = told(ReplaceLayer("lyr_1", "scn_9", "plc_9", None, HERE))
    assert replaced == [("layer.lyr_1", "replaced"), ("scan.scn_1", "removed"), ("scan.scn_9", "added")]


def test_a_shift_moves_along_the_maps_axes_and_turns_about_the_scans_origin() -> None:
    state = ShiftLayer("lyr_0", x_m=0.5, y_m=-0.25, z_m=0.1, yaw_rad=0.2).apply(a_state())
    layer = state.layer("lyr_0")
    assert layer is not None
    wanted = Transform.from_xyz_yaw(1.5, 1.75, 0.1, 0.7)
    assert moved_by(layer.T_map_scan, pose_of(wanted.tolist())) == pytest.approx((0.0, 0.0), abs=1e-7)
    metres, radians = moved_by(HERE, layer.T_map_scan)
    assert metres == pytest.approx(math.hypot(0.5, 0.25, 0.1))
    assert radians == pytest.approx(0.2)


def test_the_order_of_layers_stays_where_one_is_replaced_or_moved() -> None:
    steps = [ReplaceLayer("lyr_0", "scn_9", "plc_9", None, HERE), MoveLayer("lyr_1", HERE)]
    assert [x.layer_id for x in apply_all(a_state(), steps).layers] == ["lyr_0", "lyr_1", "lyr_2"]


def test_a_region_erases_what_stands_there_and_not_what_comes_later() -> None:
    state = EraseRegion("ers_1", SQUARE).apply(a_state(2))
    assert [sorted(one.layers) for one in state.erased] == [["lyr_0", "lyr_1"]]
    state = AddLayer(a_layer(5)).apply(state)
    assert "lyr_5" not in state.erased[0].layers
    state = ReplaceLayer("lyr_0", "scn_9", "plc_9", None, HERE).apply(state)
    assert sorted(state.erased[0].layers) == ["lyr_1"]
    moved = MoveLayer("lyr_1", pose_of(Transform.identity().tolist())).apply(state)
    assert moved.erased[0].layers["lyr_1"] == HERE, "a layer moved later takes its hole along"
    assert RestoreRegion("ers_1").apply(moved).erased == ()
    assert RemoveLayer("lyr_1").apply(moved).erased[0].layers == {}


def test_a_region_survives_its_json() -> None:
    one = ErasedRegion("ers_1", SQUARE, drawing=False, layers={"lyr_1": HERE})
    assert ErasedRegion.from_json(one.to_json()) == one


def test_what_is_not_there_is_refused_by_name() -> None:
    with pytest.raises(LayerNotFound, match=r"no layer lyr_x; there is lyr_0, lyr_1, lyr_2"):
        RemoveLayer("lyr_x").apply(a_state())
    with pytest.raises(RegionNotFound, match=r"no erased region ers_x; there is none"):
        RestoreRegion("ers_x").apply(a_state())
    with pytest.raises(InvalidRequest, match="plc_1 is a layer already"):
        AddLayer(a_layer(1)).apply(a_state())
    with pytest.raises(InvalidRequest, match="voxel_size_m"):
        SetRecipe({"voxel_size_m": -1.0}).apply(a_state())


@pytest.mark.parametrize(
    ("yours", "theirs", "shared"),
    [
        (MoveLayer("lyr_0", pose_of(Transform.identity().tolist())), RemoveLayer("lyr_1"), set()),
        (ShiftLayer("lyr_0", x_m=1.0), RemoveLayer("lyr_0"), {"layer.lyr_0"}),
        (ShiftLayer("lyr_0", x_m=1.0), RenameLayer("lyr_0", "press"), {"layer.lyr_0"}),
        (AddLayer(a_layer(8)), AddLayer(a_layer(9)), set()),
        (SetRecipe({"floor": True}), SetRecipe({"ceiling": True}), set()),
        (SetRecipe({"floor": True}), SetRecipe({"floor": True}), set()),
        (SetRecipe({"voxel_size_m": 0.1}), SetRecipe({"voxel_size_m": 0.2}), {"recipe.voxel_size_m"}),
        (RemoveLayer("lyr_0"), RemoveLayer("lyr_0"), set()),
        (
            SetLayers((a_layer(1), a_layer(0), a_layer(2))),
            SetLayers((a_layer(2), a_layer(0), a_layer(1))),
            {"order"},
        ),
        (
            SetDrawing(BaseReading("drw_2", "b" * 64, {})),
            SetRecipe({"map_from_drawing": {"x_m": 1.0, "y_m": 0.0, "yaw_rad": 0.0}}),
            {"drawing", "recipe.map_from_drawing"},
        ),
        (EraseRegion("ers_1", SQUARE), EraseRegion("ers_2", SQUARE), set()),
    ],
)
def test_two_changes_of_one_state_overlap_where_they_are_about_the_same(
    yours: Operation, theirs: Operation, shared: set[str]
) -> None:
    base = a_state()
    mine, others = (one.apply(base) for one in (yours, theirs))
    assert overlap(base, mine, others) == overlap(base, others, mine) == shared


def test_the_same_scan_twice_is_an_overlap() -> None:
    base = a_state()
    twice = LayerState("lyr_other", "n", "scn_9", "plc_other", None, HERE)
    mine, others = (AddLayer(one).apply(base) for one in (a_layer(9), twice))
    assert overlap(base, mine, others) == {"scan.scn_9"}
    assert subjects(differences(base, mine)) == {"layer.lyr_9", "scan.scn_9"}


def test_of_what_is_asked_only_what_changes_something_is_kept() -> None:
    form: list[Operation] = [
        SetDrawing(READING),
        SetRecipe({**Recipe().to_json(), "floor": True}),
        ShowLayer("lyr_0", visible=True),
        SetLayers(a_state().layers),
        RenameLayer("lyr_1", "press"),
    ]
    assert effective(a_state(), form) == [SetRecipe({"floor": True}), RenameLayer("lyr_1", "press")]
