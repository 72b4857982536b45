"""What a file holds: it cannot be read, or says too little."""

from __future__ import annotations

from service.domain.errors.tree import Rejected, Unfulfilled


class UnsupportedMedia(Rejected):
    """The file's own bytes are of no kind that is read here, whatever its name says."""

    title = "This kind of file is not read"


class FileEmpty(Rejected):
    """The file has no bytes, or holds no point or pixel."""

    title = "The file is empty"


class FileTruncated(Rejected):
    """The file ends before its own header says it should: the copy or the upload was cut short."""

    title = "The file is cut short"


class FileMalformed(Rejected):
    """The file breaks the rules of its own format; `detail` tells where."""

    title = "The file cannot be read"


class HeaderMismatch(Rejected):
    """The file's header promises something else than its bytes hold."""

    title = "The file's header contradicts its bytes"


class NotFinite(Rejected):
    """The file holds coordinates that are not finite numbers (NaN or infinity)."""

    title = "The file holds values that are not numbers"


class ImageTooLarge(Rejected):
    """The image has more pixels than are read; `max_pixels` tells how many are."""

    title = "The image is too large"


class TooManyPoints(Rejected):
    """The point cloud has more points than are read; `max_points` tells how many are."""

    title = "The point cloud is too large"


class CoordinatesTooLarge(Rejected):
    """The map lies so far from its origin, or the scan reaches so far, that float32 cannot tell voxels apart.

    Of a map, choose a `T_map_drawing` nearer to the origin, or a larger voxel size. Of a scan, give the unit
    of its file, or cut off what lies far away; coordinates that no place on Earth has tell of a damaged file.
    """

    title = "The coordinates are too large"


class ScaleUnknown(Rejected):
    """The drawing's scale is not known, so no map in metres can be made from it.

    Give metres per pixel, a ratio with its dpi, or a known length.
    """

    title = "The scale of the drawing is unknown"


class PageNotFound(Rejected):
    """The document has no page of this number, or has several and none was named."""

    title = "No such page"


class PageNeeded(Rejected):
    """The document has several pages, and none was chosen.

    `pages` lists them with their sizes: ask again with the page that shows the floor plan, counted from 1.
    """

    title = "A page has to be chosen"


class FileEncrypted(Rejected):
    """The document opens only with a password, which is never asked for here.

    Save it without a password (print it to a new PDF) and upload that.
    """

    title = "The document is encrypted"


class DrawingTooComplex(Rejected):
    """The drawing holds more strokes, texts or nested parts than are read.

    Export the one floor that is needed, or print the sheet as a PNG image.
    """

    title = "The drawing is too complex"


class ReadingTooCostly(Rejected):
    """Reading the file took more CPU, memory or time than a file that promises so much may take.

    It was stopped. `limit` tells at which limit (`cpu`, `memory` or `wall`); `cpu_limit_s`,
    `memory_limit_bytes` and `wall_limit_s` how much it may take; `cpu_used_s`, `memory_used_bytes` and
    `wall_used_s` how much it had taken; `points`, `pixels` and `cad_bytes` what the file promises by its
    header and its size. Export what is needed of it: one floor, fewer points, a lower resolution. A file that
    is small and costs so much is damaged, or was made to do harm.
    """

    title = "Reading the file costs too much"


class NoWallsFound(Unfulfilled):
    """Nothing on the drawing was recognised as a wall."""

    title = "No walls were found"


class ReaderCrashed(Rejected):
    """The program that reads this kind of file crashed on it: the file is damaged, or breaks the format.

    Open it in the program that made it, repair it, and export it again. `signal` tells how the reader ended.
    """

    title = "The file crashes its reader"


class NotADrawing(Unfulfilled):
    """The picture has continuous tones, as a photo has: it is no drawing that walls could be read from.

    Scan the drawing, or photograph it so that the sheet fills the picture. `paper` is the share that is as
    bright as bare paper, `tones` the share that lies in the midst of middle tones.
    """

    title = "The picture is not a drawing"
