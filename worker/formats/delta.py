"""A file as what it adds to another file that the receiver has: `zstd --patch-from`."""

from __future__ import annotations

from pathlib import Path

from backports import zstd

_LEVEL = 12
_MOST_WINDOW_LOG = 31


def write_delta(path: Path, *, old: Path, new: Path) -> None:
    """Write a zstd frame at `path` that gives `new` to whoever has `old`, and nothing to anybody else.

    Same files, same bytes. Decoded by ``zstd -d --long=31 --patch-from=OLD``, and by any decoder that takes
    `old` as a raw prefix; the frame's checksum refuses another `old`.

    Parameters
    ----------
    path : Path
        File to write; an existing one is replaced.
    old, new : Path
        Both are held in memory while this runs.

    Notes
    -----
    As RFC 8878 with the prefix of RFC 9842. The frame is a single segment: its window is all of `new`, so
    that `old` is in reach to the end, and who decodes it has to allow that window (``--long=31``; by
    default zstd takes 128 MiB, or as much as OLD has). Long distances are looked for: what moved in the file
    by many megabytes is found again. Two clouds of 1 GB take 3.4 GB here and 2 GB where they are decoded.
    """
    before, after = old.read_bytes(), new.read_bytes()
    parameter = zstd.CompressionParameter
    options: dict[int, int] = {
        parameter.compression_level: _LEVEL,
        parameter.window_log: min(_MOST_WINDOW_LOG, max(17, (len(before) + len(after)).bit_length())),
        parameter.enable_long_distance_matching: 1,
        parameter.checksum_flag: 1,
    }
    prefix = zstd.ZstdDict(before, is_raw=True).as_prefix
    path.write_bytes(zstd.compress(after, options=options, zstd_dict=prefix))
