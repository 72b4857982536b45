"""USD files that refer: to themselves, to each other in a package, and to what is none of their business."""

from __future__ import annotations

import zipfile
from contextlib import suppress
from pathlib import Path

import pytest

from service.domain.bounds import Bounds
from service.domain.errors import FileEmpty, FileMalformed
from worker.formats import usd_layers
from worker.formats.usd import load_usd
from worker.geometry.scan.mesh_sampling import Mesh

MESH = (
    'def Mesh "m"\n{\n int[] faceVertexCounts=[3]\n int[] faceVertexIndices=[0,1,2]\n'
    " point3f[] points=[(0,0,0),(7,0,0),(0,9,0)]\n}\n"
)
VARIANT = (
    'def "a" (variantSets="v" variants={{string v="x"}}) '
    '{{variantSet "v"={{"x" (references=@{}@</m>) {{}}}}}}'
)


def layer(body: str, metadata: str = "") -> str:
    return f"#usda 1.0\n({metadata})\n{body}"


def corners(path: Path) -> int:
    surface = load_usd(path, bounds=Bounds()).surface
    assert isinstance(surface, Mesh)
    return len(surface.vertices)


def a_file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scan.usda"
    path.write_text(text)
    return path


def a_package(tmp_path: Path, entries: dict[str, str]) -> Path:
    """Write a USDZ: stored, each entry on a multiple of 64 bytes."""
    path = tmp_path / "scan.usdz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as package:
        for name, text in entries.items():
            info = zipfile.ZipInfo(name)
            at = package.fp.tell() + 30 + len(name)  # type: ignore[union-attr]  # open for writing
            info.extra = b"\x00\x00" + (pad := (-at - 4) % 64).to_bytes(2, "little") + bytes(pad)
            package.writestr(info, text)
    return path


@pytest.mark.parametrize(
    "referring",
    [
        ("", "subLayers=[@{}@]"),
        ('def "a" (references = @{}@</m>) {{}}', ""),
        ('def "a" (payload = @{}@</m>) {{}}', ""),
        ('def "a" (append references = [@{}@</m>]) {{}}', ""),
        (VARIANT, ""),
    ],
    ids=["layer", "reference", "payload", "list", "variant"],
)  # fmt: skip
@pytest.mark.parametrize("packed", [False, True])
def test_no_other_file_of_the_machine_is_read(
    tmp_path: Path, referring: tuple[str, str], packed: bool  # noqa: FBT001 - a parameter
) -> None:  # fmt: skip
    secret = tmp_path / "others" / "secret.usda"
    secret.parent.mkdir()
    secret.write_text(layer(MESH))
    for name in (str(secret), "../others/secret.usda", "./others/secret.usda", f"file:{secret}"):
        text = layer(referring[0].format(name), referring[1].format(name))
        path = a_package(tmp_path, {"a.usda": text}) if packed else a_file(tmp_path, text)
        with pytest.raises((FileEmpty, FileMalformed)):
            load_usd(path, bounds=Bounds())


def test_a_package_reads_its_own_layers(tmp_path: Path) -> None:
    first = layer('def "a" (references = @./parts/b.usda@</m>) {}', "subLayers=[@c.usda@]")
    path = a_package(tmp_path, {"a.usda": first, "parts/b.usda": layer(MESH), "c.usda": layer(MESH)})
    assert corners(path) == 6


def test_a_file_may_refer_to_its_own_parts(tmp_path: Path) -> None:
    assert corners(a_file(tmp_path, layer(MESH + 'def "a" (references = </m>) {}'))) == 6


def doubling(depth: int, arc: str) -> str:
    parts = [
        f'def Xform "a{k}"\n{{\n def Xform "l" ({arc} = </a{k + 1}>) {{}}\n'
        f' def Xform "r" ({arc} = </a{k + 1}>) {{}}\n}}\n'
        for k in range(depth)
    ]  # fmt: skip
    return layer("".join(parts) + MESH.replace('"m"', f'"a{depth}"'))


@pytest.mark.parametrize("arc", ["references", "payload", "inherits", "specializes"])
def test_parts_that_double_without_end_are_refused(tmp_path: Path, arc: str) -> None:
    with pytest.raises(FileMalformed, match="parts"):
        load_usd(a_file(tmp_path, doubling(40, arc)), bounds=Bounds())


def test_parts_count_as_often_as_they_are_referred_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = a_file(tmp_path, doubling(3, "references"))
    weight = 1 + (1 + 2 * (1 + 1 + 2 * (1 + 1 + 2 * (1 + 1)))) + (1 + 2 * (1 + 1 + 2 * 2)) + (1 + 2 * 2) + 1
    monkeypatch.setattr(usd_layers, "MOST_PARTS", weight)
    assert corners(path) == 3  # an Xform stays one, whatever it is made of
    monkeypatch.setattr(usd_layers, "MOST_PARTS", weight - 1)
    with pytest.raises(FileMalformed, match="parts"):
        load_usd(path, bounds=Bounds())


@pytest.mark.parametrize("other", ["a", "b"])
def test_parts_that_refer_to_themselves_are_cut(tmp_path: Path, other: str) -> None:
    text = f'def "a" (references = </{other}>) {{}}\ndef "b" (references = </a>) {{}}'
    with pytest.raises((FileEmpty, FileMalformed)):
        load_usd(a_file(tmp_path, layer(text)), bounds=Bounds())
    with suppress(FileMalformed):
        assert corners(a_file(tmp_path, layer(MESH + text))) == 3
