"""Every format that is read: the one table from which all else takes its lists.

Refusals, the API's description, the command line's help, what reading may cost, and `docs/formats.md`; a test
holds that each has its reader. How to add one: CONTRIBUTING.md, "Recipes".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum


class Purpose(StrEnum):
    """What a file is uploaded as."""

    DRAWING = "drawing"
    SCAN = "scan"


class Group(StrEnum):
    """What formats that are listed together are called; one of the last group is called by its own name."""

    IMAGES = "images"
    FILES = "files"
    POINT_CLOUDS = "point clouds"
    MESHES = "meshes"
    ROBOTS_MAPS = ""


@dataclass(frozen=True)
class Media:
    """Hold what a file is.

    Parameters
    ----------
    name : str
        For people, with its article: "a PNG image".
    media_type : str
        Its registered (or usual) media type.
    fits : Purpose, optional
        What it can be uploaded as; None for a kind that is not read.
    advice : str
        What to do with a kind that is not read.
    called : tuple of str
        The words by which people ask for it, as they stand in a list: "LAS", "LAZ".
    extensions : tuple of str
        How the names of such files usually end; nothing is decided by them.
    groups : tuple of Group
        Where it stands in a list.
    begins : tuple of bytes
        The first bytes that tell it; where no such bytes do, a rule of `service.domain.media` does.
    needs_others : bool
        Whether it is read with a file that lies beside it, so only by the command line.
    least_point_bytes : int, optional
        Of a format of points: the fewest bytes that it writes one in.
    most_pixels_per_byte : int, optional
        Of a format of pixels: the most pixels that a byte of it holds.
    is_cad : bool
        Whether its reading takes time by the file's size, as that of strokes and models does.
    memory_bound : str, optional
        The field of `Bounds` that tells the memory of the process in which a library reads it.
    """

    name: str
    media_type: str
    fits: Purpose | None = None
    advice: str = ""
    called: tuple[str, ...] = ()
    extensions: tuple[str, ...] = ()
    groups: tuple[Group, ...] = ()
    begins: tuple[bytes, ...] = ()
    needs_others: bool = False
    least_point_bytes: int | None = None
    most_pixels_per_byte: int | None = None
    is_cad: bool = False
    memory_bound: str | None = None


PNG = Media(
    "a PNG image",
    "image/png",
    Purpose.DRAWING,
    called=("PNG",),
    extensions=(".png",),
    groups=(Group.IMAGES,),
    begins=(b"\x89PNG\r\n\x1a\n",),
    most_pixels_per_byte=256,
)
JPEG = Media(
    "a JPEG image",
    "image/jpeg",
    Purpose.DRAWING,
    called=("JPEG",),
    extensions=(".jpg", ".jpeg"),
    groups=(Group.IMAGES,),
    begins=(b"\xff\xd8\xff",),
    most_pixels_per_byte=256,
)
TIFF = Media(
    "a TIFF image",
    "image/tiff",
    Purpose.DRAWING,
    called=("TIFF",),
    extensions=(".tif", ".tiff"),
    groups=(Group.IMAGES,),
    begins=(b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+"),
    most_pixels_per_byte=256,
)
BMP = Media(
    "a BMP image",
    "image/bmp",
    Purpose.DRAWING,
    called=("BMP",),
    extensions=(".bmp",),
    groups=(Group.IMAGES,),
    most_pixels_per_byte=8,
)
WEBP = Media(
    "a WebP image",
    "image/webp",
    Purpose.DRAWING,
    called=("WebP",),
    extensions=(".webp",),
    groups=(Group.IMAGES,),
    most_pixels_per_byte=256,
)
PGM = Media(
    "a PGM image of a robot's map",
    "image/x-portable-graymap",
    Purpose.DRAWING,
    called=("PGM",),
    extensions=(".pgm",),
    groups=(Group.IMAGES,),
    most_pixels_per_byte=1,
)
PDF = Media(
    "a PDF document",
    "application/pdf",
    Purpose.DRAWING,
    called=("PDF",),
    extensions=(".pdf",),
    groups=(Group.FILES,),
    begins=(b"%PDF-",),
    most_pixels_per_byte=256,
    is_cad=True,
)
DXF = Media(
    "a DXF drawing",
    "image/vnd.dxf",
    Purpose.DRAWING,
    called=("DXF",),
    extensions=(".dxf",),
    groups=(Group.FILES,),
    begins=(b"AutoCAD Binary DXF",),
    is_cad=True,
)
DWG = Media(
    "a DWG drawing",
    "image/vnd.dwg",
    Purpose.DRAWING,
    called=("DWG",),
    extensions=(".dwg",),
    groups=(Group.FILES,),
    begins=(b"AC10",),
    is_cad=True,
    memory_bound="max_dwg_memory_bytes",
)
SVG = Media(
    "an SVG drawing",
    "image/svg+xml",
    Purpose.DRAWING,
    called=("SVG",),
    extensions=(".svg",),
    groups=(Group.FILES,),
    is_cad=True,
)
IFC = Media(
    "an IFC or STEP model",
    "application/x-step",
    Purpose.DRAWING,
    called=("IFC",),
    extensions=(".ifc",),
    groups=(Group.FILES,),
    begins=(b"ISO-10303-21;",),
    is_cad=True,
    memory_bound="max_model_memory_bytes",
)
ROS_MAP_ZIP = Media(
    "a ZIP of a ROS map",
    "application/vnd.groundplan.ros-map+zip",
    Purpose.DRAWING,
    called=("a ZIP of a ROS map.yaml with its image",),
    extensions=(".zip",),
    groups=(Group.ROBOTS_MAPS,),
    most_pixels_per_byte=256,
)
ROS_MAP = Media(
    "a ROS map.yaml",
    "application/vnd.groundplan.ros-map",
    Purpose.DRAWING,
    called=("a ROS map.yaml beside its image",),
    extensions=(".yaml",),
    groups=(Group.ROBOTS_MAPS,),
    needs_others=True,
)
BUILDING_YAML = Media(
    "an Open-RMF building.yaml",
    "application/vnd.groundplan.building",
    Purpose.DRAWING,
    called=("an Open-RMF building.yaml",),
    extensions=(".yaml",),
    groups=(Group.ROBOTS_MAPS,),
    is_cad=True,
)
PLY = Media(
    "a PLY point cloud",
    "application/vnd.groundplan.ply",
    Purpose.SCAN,
    called=("PLY",),
    extensions=(".ply",),
    groups=(Group.POINT_CLOUDS, Group.MESHES),
    begins=(b"ply\n", b"ply\r"),
    least_point_bytes=3,
)
PCD = Media(
    "a PCD point cloud",
    "application/vnd.groundplan.pcd",
    Purpose.SCAN,
    called=("PCD",),
    extensions=(".pcd",),
    groups=(Group.POINT_CLOUDS,),
    begins=(b"# .PCD",),
    least_point_bytes=1,
)
LAS = Media(
    "a LAS or LAZ point cloud",
    "application/vnd.las",
    Purpose.SCAN,
    called=("LAS", "LAZ"),
    extensions=(".las", ".laz"),
    groups=(Group.POINT_CLOUDS,),
    begins=(b"LASF",),
    least_point_bytes=1,
)
E57 = Media(
    "an E57 point cloud",
    "model/e57",
    Purpose.SCAN,
    called=("E57",),
    extensions=(".e57",),
    groups=(Group.POINT_CLOUDS,),
    begins=(b"ASTM-E57",),
    least_point_bytes=2,
)
XYZ = Media(
    "a list of numbers (XYZ, PTS or CSV)",
    "text/plain",
    Purpose.SCAN,
    called=("XYZ", "PTS", "CSV"),
    extensions=(".xyz", ".pts", ".csv"),
    groups=(Group.POINT_CLOUDS,),
    least_point_bytes=6,
)
OBJ = Media(
    "an OBJ model",
    "model/obj",
    Purpose.SCAN,
    called=("OBJ",),
    extensions=(".obj",),
    groups=(Group.MESHES,),
    least_point_bytes=8,
)
GLB = Media(
    "a GLB model",
    "model/gltf-binary",
    Purpose.SCAN,
    called=("GLB",),
    extensions=(".glb",),
    groups=(Group.MESHES,),
    begins=(b"glTF",),
    least_point_bytes=2,
)
STL = Media(
    "an STL model",
    "model/stl",
    Purpose.SCAN,
    called=("STL",),
    extensions=(".stl",),
    groups=(Group.MESHES,),
    least_point_bytes=12,
)
USD = Media(
    "a USD model",
    "model/vnd.usd",
    Purpose.SCAN,
    called=("USDC", "USDA"),
    extensions=(".usdc", ".usda", ".usd"),
    groups=(Group.MESHES,),
    begins=(b"PXR-USDC", b"#usda "),
    least_point_bytes=2,
)
USDZ = Media(
    "a USDZ model",
    "model/vnd.usdz+zip",
    Purpose.SCAN,
    called=("USDZ",),
    extensions=(".usdz",),
    groups=(Group.MESHES,),
    least_point_bytes=2,
)

FORMATS: tuple[Media, ...] = (
    PNG,
    JPEG,
    TIFF,
    BMP,
    WEBP,
    PGM,
    PDF,
    DXF,
    DWG,
    SVG,
    IFC,
    ROS_MAP_ZIP,
    ROS_MAP,
    BUILDING_YAML,
    PLY,
    PCD,
    LAS,
    E57,
    XYZ,
    OBJ,
    GLB,
    STL,
    USD,
    USDZ,
)
"""All of them, in the order of every list."""


def listed(purpose: Purpose, *, with_others: bool = False) -> str:
    """Return what can be uploaded for a purpose, for people: "PNG or JPEG images, PDF or DXF files".

    Parameters
    ----------
    with_others : bool, optional
        Whether files that need others beside them are listed as well: the command line takes them.

    Examples
    --------
    >>> listed(Purpose.SCAN).split(", or ")[0]
    'PLY, PCD, LAS, LAZ, E57, XYZ, PTS or CSV point clouds'
    """
    taken = [one for one in FORMATS if one.fits is purpose and (with_others or not one.needs_others)]
    parts = []
    for group in Group:
        words = [word for one in taken if group in one.groups for word in one.called]
        parts += [f"{_any_of(words)} {group}"] if words and group else words
    return _any_of(parts, before_last=", or ")


def _any_of(words: Sequence[str], *, before_last: str = " or ") -> str:
    return before_last.join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
