"""Image files of a detector: PNG, TIFF, JPEG or FITS, as index values 0..4096 or as light on that scale."""

import math
import struct
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from gse.errors import TableError

INDEX_BITS = 12
MAX_FILE_BYTES = 512_000_000
MAX_PIXELS = 67_108_864
"""8192 x 8192: larger than any detector of a star sensor, small enough for any host."""

_FITS_SUFFIXES = (".fits", ".fit", ".fts")
KNOWN_SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", *_FITS_SUFFIXES)
_DEPTHS = {"1": 8, "L": 8, "P": 8, "RGB": 8, "RGBA": 8, "LA": 8, "I;16": 16, "I;16B": 16, "I;16L": 16, "I": 16, "F": 16}
_EXPECTED = "expected gray of 8, 12 or 16 bits, or colour of 8"
_BITS_PER_SAMPLE = 258
"""The TIFF tag."""
_EXIF, _FOCAL_LENGTH_IN_35MM_FILM = 0x8769, 41989
_COLOURS = 3
_MOST_COUNTS = 1 << 16
_MOST_OF_FRACTIONS = 2.0
"""Fractions of full scale go over 1 where a picture was sharpened or divided by a flat field; counts go far over 2."""
_BROKEN = (OSError, SyntaxError, ValueError, TypeError, KeyError, IndexError, EOFError, struct.error, MemoryError)
"""What Pillow and astropy raise on damaged files."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What an image file holds: counts (rows, columns) as stored, its rows in the order of the file.

    ``bits`` is how many bits of the counts are significant. ``is_jpeg``: the counts were compressed with loss.
    ``focal_length_px`` is what EXIF says of the lens, None where it says nothing.
    """

    counts: NDArray[Any]
    bits: int
    is_jpeg: bool = False
    focal_length_px: float | None = None

    def index_values(self) -> NDArray[np.uint16]:
        """Index values, whole numbers of 0..4096; a pixel that holds no number is dark."""
        numbers, bits = self.counts, self.bits
        if numbers.dtype.kind == "f":
            numbers = np.nan_to_num(numbers, nan=0.0, posinf=2.0**bits - 1, neginf=0.0)
        if numbers.dtype == np.uint8:
            return np.left_shift(numbers.astype(np.uint16), INDEX_BITS - bits, dtype=np.uint16)
        if numbers.dtype == np.uint16 and bits >= INDEX_BITS:
            return np.asarray(np.minimum(numbers >> (bits - INDEX_BITS), 1 << INDEX_BITS), dtype=np.uint16)
        scaled = np.floor(numbers * self.step)
        return np.asarray(np.clip(scaled, 0, 1 << INDEX_BITS), dtype=np.uint16)

    def light(self) -> NDArray[np.float32]:
        """The counts on the scale of the index values, not rounded; a pixel that holds no number is as the median."""
        light = self.counts.astype(np.float32)
        light *= np.float32(self.step)
        if self.counts.dtype.kind == "f" and not (finite := np.isfinite(light)).all():
            light = np.nan_to_num(light, nan=float(np.median(light[finite])), posinf=2.0**INDEX_BITS, neginf=0.0)
        return np.minimum(light, 1 << INDEX_BITS, out=light)

    @property
    def step(self) -> float:
        """The index value of one count."""
        return 2.0 ** (INDEX_BITS - self.bits)


def read_picture(path: Path, bits: int | None = None) -> Picture:
    """The picture that an image file holds; colours become brightness.

    ``bits`` is how many bits of the stored values count. Without it that is the file's depth, but 12 where a file of
    16 bits holds nothing over 4096. TableError otherwise, with what came and what was expected.
    """
    suffix = path.suffix.lower()
    if suffix not in KNOWN_SUFFIXES:
        raise TableError(f"{path} is not an image of a known format: expected {', '.join(KNOWN_SUFFIXES)}")
    if path.exists() and not path.is_file():
        raise TableError(f"{path} is a folder, a pipe or a device: expected an image file")
    try:
        size = path.stat().st_size
    except OSError as error:
        raise TableError(f"cannot read {path}: {error.strerror}") from error
    if size > MAX_FILE_BYTES:
        raise TableError(f"{path} is larger than {MAX_FILE_BYTES} bytes: this is not an image of a star sensor")
    picture = _read_fits(path) if suffix in _FITS_SUFFIXES else _read_picture(path)
    if picture.counts.dtype.kind == "f":
        _check_floats(path, picture.counts)
    if picture.counts.dtype.itemsize > 2:
        _check_scale(path, picture.counts)
    return replace(picture, bits=_significant_bits(picture) if bits is None else min(bits, 8 * picture.counts.itemsize))


def _check_floats(path: Path, numbers: NDArray[Any]) -> None:
    brightest = float(np.max(numbers, where=np.isfinite(numbers), initial=-np.inf))
    if brightest == -np.inf:
        raise TableError(f"{path} holds no number in any pixel")
    if 0 < brightest < _MOST_OF_FRACTIONS:
        raise TableError(f"{path} holds fractions up to {brightest:.3g}: expected counts, so scale it to 0..4095")


def _check_scale(path: Path, numbers: NDArray[Any]) -> None:
    """Refuse sums of many exposures, for example: half of the picture or more is over the end of the scale."""
    middle = float(np.median(np.nan_to_num(numbers[::4, ::4])))
    if middle >= _MOST_COUNTS:
        raise TableError(
            f"{path} holds counts of {middle:.3g} in its background: scale it to {_MOST_COUNTS - 1} at most"
        )


def _significant_bits(picture: Picture) -> int:
    numbers = picture.counts
    if picture.bits == 16 and np.max(numbers, where=np.isfinite(numbers), initial=0) <= 1 << INDEX_BITS:
        return INDEX_BITS
    return picture.bits


def _read_picture(path: Path) -> Picture:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged metadata, and of a size that is checked here
            with Image.open(path, formats=("PNG", "TIFF", "JPEG")) as picture:
                _check_size(path, *picture.size)
                depth, is_jpeg = _depth(picture, path), picture.format == "JPEG"
                picture.draft("L", None)  # of a JPEG only the brightness is unpacked
                gray = picture if depth > 8 or picture.mode == "L" else picture.convert("L")
                return Picture(np.asarray(gray), depth, is_jpeg, _focal_length_px(picture))
    except UnidentifiedImageError as error:
        raise TableError(f"{path} is not a PNG, TIFF or JPEG image of a known kind: {_EXPECTED}") from error
    except Image.DecompressionBombError as error:
        raise TableError(_too_large(path)) from error
    except _BROKEN as error:
        raise _damaged(path, error) from error


def _focal_length_px(picture: Image.Image) -> float | None:
    """The focal length by EXIF's equivalent for film of 36 x 24 mm, whose diagonals correspond."""
    equivalent_mm = picture.getexif().get_ifd(_EXIF).get(_FOCAL_LENGTH_IN_35MM_FILM)
    if not isinstance(equivalent_mm, int) or not 1 <= equivalent_mm <= 10_000:
        return None
    return equivalent_mm * math.hypot(*picture.size) / math.hypot(36, 24)


def _depth(picture: Image.Image, path: Path) -> int:
    if picture.mode not in _DEPTHS:
        raise TableError(f"{path} holds pixels of kind {picture.mode}: {_EXPECTED}")
    depth = _DEPTHS[picture.mode]
    tags = getattr(picture, "tag_v2", None)
    if tags is None:
        return depth
    bits = int(tags.get(_BITS_PER_SAMPLE, (depth,))[0])
    if depth == 8 < bits:
        # Pillow reads some of these, and some wrong.
        raise TableError(f"{path} holds colours of {bits} bits: {_EXPECTED}")
    return depth if depth == 8 else min(bits, 16)


def _read_fits(path: Path) -> Picture:
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyWarning

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AstropyWarning)  # what cannot be read raises besides
            with path.open("rb") as file, fits.open(file, memmap=False) as units:
                for unit in units:
                    if unit.is_image and (size := _size_of(unit.header)) is not None:
                        _check_size(path, *size)
                        data = np.asarray(unit.data)
                        counts = data.astype(data.dtype.newbyteorder("="))
                        if counts.ndim == 3:
                            counts = counts[0] if len(counts) == 1 else counts.mean(axis=0, dtype=np.float32)
                        return Picture(counts, 8 if data.dtype.itemsize == 1 else 16)
    except (*_BROKEN, fits.VerifyError) as error:
        raise _damaged(path, error) from error
    raise TableError(f"{path} holds no image: expected one of two dimensions, with one plane or three colours")


def _size_of(header: Any) -> tuple[int, int] | None:
    """Columns, and rows of all planes, of an image of one plane or of three colours; None of anything else."""
    planes = int(header["NAXIS3"]) if header.get("NAXIS") == 3 else 1
    if header.get("NAXIS") not in (2, 3) or planes not in (1, _COLOURS):
        return None
    return int(header["NAXIS1"]), int(header["NAXIS2"]) * planes


def _check_size(path: Path, columns: int, rows: int) -> None:
    if columns * rows > MAX_PIXELS:
        raise TableError(_too_large(path))
    if columns < 1 or rows < 1:
        raise TableError(f"{path} holds no pixels")


def _too_large(path: Path) -> str:
    return f"{path} holds more than {MAX_PIXELS} pixels: this is not an image of a star sensor"


def _damaged(path: Path, error: BaseException) -> TableError:
    reason = (str(error) or type(error).__name__).splitlines()[0][:120]
    return TableError(f"{path} is damaged or no image: {reason}")
